// From a scene to events with their owners, and to the truth at any moment.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "emseg/simulation/sensor.hpp"

namespace emseg::simulation {

struct SimulationOptions {
  double duration = 1;          // s, from time 0
  double largest_motion = 0.5;  // px that anything seen may move in a step
  double largest_step = 10e-3;  // s
  double smallest_step = 1e-5;  // s
  double latency_jitter = 0;    // s, mean of the delay with which the readout stamps an event
  double readout_interval = 0;  // s, least time between two events on the bus; 0: no limit
  int threads = 0;              // 0: one per core; the events do not depend on it
};

struct SimulatedEvents {
  std::vector<std::uint16_t> x, y;
  std::vector<std::int64_t> t;  // us, never decreasing
  std::vector<std::uint8_t> p;
  std::vector<std::int16_t> owner;
};

// Throws std::invalid_argument where the scene or an option is not sound.
SimulatedEvents simulate(const Scene& scene, const SensorOptions& sensor, const SimulationOptions& options);

// What is seen at a moment, per pixel, row by row.
struct Truth {
  std::vector<float> intensity;
  std::vector<std::int16_t> label;  // of the surface with the largest share; 0 for the sky
  std::vector<float> depth;         // m along the optical axis; 0 for the sky
  std::vector<float> flow_x;        // px that what is seen moves over the interval; NaN for the sky
  std::vector<float> flow_y;
};

// The truth at each moment; its flow is that over the next `interval` seconds.
std::vector<Truth> render_truth(const Scene& scene, std::span<const double> moments, double interval,
                                int threads = 0);

}  // namespace emseg::simulation
