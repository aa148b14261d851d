"""Simulated recordings with exact truth: scenes, the sensor, and a suite of scenes to develop and test on."""

from emseg.simulation.scene import Scene
from emseg.simulation.simulator import Simulation, Truth, simulate

__all__ = ["Scene", "Simulation", "Truth", "simulate"]
