"""Trained networks in files that hold numbers and text, never code: safetensors."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Any

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save

import emseg
from emseg.nets.build import NetworkPair, build_networks
from emseg.nets.settings import RunSettings

__all__ = ["TrainedNetworks", "load_networks", "save_networks"]

FORMAT = "emseg.nets/1"


@dataclass(frozen=True, eq=False)
class TrainedNetworks:
    """Networks, in evaluation mode, and what they came from.

    Attributes:
        networks: The pair.
        settings: Of the run that trained them.
        threshold: Probability from which a pixel counts as moving, as validation chose it.
        about: Version, commit, seed, figures and the like.
    """

    networks: NetworkPair
    settings: RunSettings
    threshold: float
    about: Mapping[str, Any]


def save_networks(path: str | PathLike[str], trained: TrainedNetworks) -> None:
    """Write networks with all that is needed to use them."""
    tensors = {name: tensor.contiguous().cpu() for name, tensor in trained.networks.state_dict().items()}
    metadata = {
        "format": FORMAT,
        "version": emseg.__version__,
        "settings": json.dumps(trained.settings.model_dump(mode="json")),
        "threshold": repr(trained.threshold),
        "about": json.dumps(dict(trained.about)),
    }
    target = Path(path)
    target.parent.mkdir(parents=True, exist_ok=True)
    work = target.with_name(f".{target.name}.part")
    work.write_bytes(save(tensors, metadata))
    work.replace(target)


def load_networks(path: str | PathLike[str], *, device: str | torch.device = "cpu") -> TrainedNetworks:
    """Read networks.

    Raises:
        ValueError: the file is none of ours, or damaged.
        OSError: no such file.
    """
    try:
        with safe_open(path, framework="pt") as file:
            metadata = file.metadata() or {}
            tensors = {name: file.get_tensor(name) for name in list(file.keys())}
    except SafetensorError as error:
        raise ValueError(f"{path}: no safetensors file: {error}") from None
    if metadata.get("format") != FORMAT:
        raise ValueError(
            f"{path}: format is {metadata.get('format')}, expected {FORMAT} of `emseg nets train`"
        )
    settings = RunSettings.from_mapping(json.loads(metadata["settings"]), str(path))
    networks = build_networks(settings.network)
    try:
        networks.load_state_dict(tensors)
    except RuntimeError as error:
        raise ValueError(
            f"{path}: does not fit its settings: {str(error).splitlines()[-1].strip()}"
        ) from None
    networks.requires_grad_(False).eval().to(device)
    return TrainedNetworks(networks, settings, float(metadata["threshold"]), json.loads(metadata["about"]))
