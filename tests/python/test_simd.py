"""Levels of instructions: the same results on each, chosen by the processor or by EMSEG_SIMD."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

from emseg import _core

RESULTS = """
import hashlib
import numpy as np
import emseg
from emseg import _core

rng = np.random.default_rng(3)
t = np.sort(rng.integers(0, 40_000, 6000))
home = rng.uniform((10, 10), (110, 80), (400, 2))[rng.integers(0, 400, len(t))]
x, y = np.rint(home + np.outer((t - 20_000) * 1e-6, (250.0, -120.0))).astype(int).clip(0, 89).T
events = emseg.EventArray(x, y, t, np.arange(len(t)) % 2, width=120, height=90)
digest = hashlib.sha256()
for kind in ("translation", "rotation", "similarity", "affine", "homography"):
    model, contrast = emseg.fit_motion(events, kind)
    digest.update(model.params.tobytes() + np.float64(contrast).tobytes())
    digest.update(emseg.iwe(events, model).tobytes() + emseg.warp(events, model).tobytes())
digest.update(emseg.segment(events).labels.tobytes())
print(_core.simd_level(), digest.hexdigest())
"""


def results(level: str) -> list[str]:
    environment = {**os.environ, "EMSEG_SIMD": level, "PYTHONPATH": os.pathsep.join(sys.path)}
    done = subprocess.run(
        [sys.executable, "-c", RESULTS], env=environment, capture_output=True, text=True, check=True
    )
    return done.stdout.split()


def test_every_level_gives_the_same_bits():
    levels = _core.simd_levels()
    found = {level: results(level) for level in levels}
    assert [name for name, _ in found.values()] == levels
    assert len({digest for _, digest in found.values()}) == 1
    assert results("")[0] == levels[-1]


def test_a_level_that_is_none_is_refused():
    with pytest.raises(subprocess.CalledProcessError) as refused:
        results("mmx")
    assert "EMSEG_SIMD is 'mmx', expected one of baseline" in refused.value.stderr
