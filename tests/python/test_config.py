"""Config: frozen, typed, refuses what it does not know, and survives YAML."""

from __future__ import annotations

import copy
import pickle
import re
from dataclasses import FrozenInstanceError, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from engine_and_reference import AS_PUBLISHED
from hypothesis import given, settings
from hypothesis import strategies as st

from emseg import _core
from emseg.config import Config, ConfigError, explain
from emseg.segmentation import engine_options


def test_defaults() -> None:
    assert Config.auto() == Config()
    assert Config() == Config.from_mapping({})
    assert Config() != Config(sigma=2.0)
    with pytest.raises(FrozenInstanceError, match="sigma"):
        Config().sigma = 2.0  # type: ignore[misc]
    assert hash(Config()) == hash(Config())


def test_copies_are_equal_and_checked() -> None:
    config = Config.preset("thesis/evimo")
    assert pickle.loads(pickle.dumps(config)) == copy.deepcopy(config) == copy.copy(config) == config
    assert replace(config, sigma=2).sigma == 2.0
    with pytest.raises(ConfigError, match=r"sigma: is 0\.0, expected a number ≥ 0\.1 ≤ 10 px"):
        replace(config, sigma=0.0)
    with pytest.raises(ConfigError, match="sigmo: unknown key, did you mean 'sigma'"):
        replace(config, sigmo=1.0)  # type: ignore[call-arg]


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("sigma", 0.0, "0.0, expected a number ≥ 0.1 ≤ 10 px"),
        ("sigma", 10.5, "10.5, expected a number ≥ 0.1 ≤ 10 px"),
        ("sigma", float("nan"), "nan, expected a number"),
        ("sigma", None, "None, expected a number ≥ 0.1 ≤ 10 px"),
        ("sigma", "1.0", "'1.0', expected a number"),
        ("sigma", [1.0], "[1.0], expected a number"),
        ("lambda_smooth", -1.0, "-1.0, expected a number ≥ 0 ≤ 1e+06"),
        ("lambda_smooth", 10**400, "000, expected a number ≥ 0 ≤ 1e+06"),
        ("lambda_data", 0.0, "0.0, expected a number > 0 ≤ 1e+06"),
        ("lambda_label", float("inf"), "inf, expected a number ≥ 0 ≤ 1e+12, or null"),
        ("lambda_edge", -0.5, "-0.5, expected a number ≥ 0 ≤ 255"),
        ("lambda_edge", 256, "256, expected a number ≥ 0 ≤ 255"),
        ("lambda_edge", None, "None, expected a number ≥ 0 ≤ 255"),
        ("num_events_per_image", 5, "5, expected a whole number ≥ 10 ≤ 1e+08 events, or null"),
        ("num_events_per_image", 20.5, "20.5, expected a whole number"),
        ("num_events_per_image", 20.0, "20.0, expected a whole number"),
        ("bracket_row", True, "True, expected a whole number ≥ 1 ≤ 32"),
        ("data_term", "log", "'log', expected 'logarithmic' or 'published'"),
        ("data_term", 0, "0, expected 'logarithmic' or 'published'"),
        ("hybrid_model_combination", 7, "7, expected 0..6 or a name"),
        ("hybrid_model_combination", True, "True, expected '2d' or '3d'"),
        ("hybrid_model_combination", "5d", "'5d', expected '2d' or '3d'"),
        ("labelling", "fast", "'fast', expected 'bands' or 'exact'"),
        ("max_events_per_window", 0, "0, expected a whole number ≥ 1 ≤ 1e+08 events, or null"),
        ("polarity", "signed", "'signed', expected 'opposed' or 'ignored'"),
        ("footprint", "disc", "'disc', expected 'scattered' or 'point'"),
        ("flicker", True, "True, expected 'left_out' or 'kept'"),
        ("background", "largest", "'largest', expected 'scene' or 'widest'"),
        ("threads", -1, "-1, expected a whole number ≥ 0 ≤ 1024"),
    ],
)
def test_bad_values_are_named(key: str, value: Any, message: str) -> None:
    with pytest.raises(ConfigError, match=re.escape(message)) as caught:
        Config.from_mapping({key: value}, origin="my.yaml")
    assert str(caught.value).startswith(f"my.yaml: {key}: is ")
    assert "\n" not in str(caught.value)
    with pytest.raises(ValueError, match=re.escape(message)) as at_once:
        Config(**{key: value})
    assert f"my.yaml: {at_once.value}" == str(caught.value)


def test_two_window_rules_are_refused() -> None:
    with pytest.raises(ConfigError, match=r"num_events_per_image is 100 and window_duration is 0\.1"):
        Config.from_mapping({"num_events_per_image": 100, "window_duration": 0.1})


@pytest.mark.parametrize(("key", "near"), [("lambda_smoth", "lambda_smooth"), ("BracketRows", "BracketRow")])
def test_unknown_keys_name_the_nearest(key: str, near: str, tmp_path: Path) -> None:
    path = tmp_path / "my.yaml"
    path.write_text(f"{key}: 3\n")
    with pytest.raises(ConfigError, match=rf"my\.yaml: {key}: unknown key, did you mean '{near}'\?"):
        Config.from_yaml(path)
    with pytest.raises(ConfigError, match=f"^{key}: unknown key, did you mean '{near}'"):
        Config(**{key: 3})


def test_numpy_scalars_and_whole_floats() -> None:
    config = Config(num_events_per_image=np.int64(100), sigma=np.float32(2), lambda_smooth=3)
    assert (config.num_events_per_image, config.sigma, config.lambda_smooth) == (100, 2.0, 3.0)
    kinds = [type(value) for value in (config.num_events_per_image, config.sigma, config.lambda_smooth)]
    assert kinds == [int, float, float]
    assert Config(hybrid_model_combination=np.int32(2)).hybrid_model_combination == "4d"  # type: ignore[arg-type]
    assert Config(hybrid_model_combination="2D+4D") == Config()  # type: ignore[arg-type]


PUBLISHED_FILE = """%YAML:1.0
---
num_events_per_image: 20000
LAMBDA_data: 1
LAMBDA_smooth: 40.
LAMBDA_label: 8.0000000000000000e+03
BracketRow: 7
BracketCol: 7
Affine_trans2d_max: 3e4
Affine_scale_max: 0.5
Affine_theta_max: 1.5
NUM_ITER_SEGMENTATION: 5
NUM_ITER_LABELING: 2
HybridModelCombination: 2
division_exponent: 7
"""


def test_published_files_are_read(tmp_path: Path) -> None:
    path = tmp_path / "fast_drone.yaml"
    path.write_text(PUBLISHED_FILE)
    config = Config.from_yaml(path)
    their_own = {
        "data_term": "published",
        "noise_label": "off",
        "max_events_per_window": None,
        **AS_PUBLISHED,
    }
    assert replace(config, **their_own) == Config.preset("eed/fast_drone")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("LAMBDA_smooth: 3\nlambda_smooth: 4\n", "lambda_smooth: is given twice"),
        ("sigma: 1\nsigma: 2\n", "line 2: sigma is given twice"),
        ("sigma: [1\n", "line 2: no valid YAML"),
        ("sigma: {a: 1}\n", "sigma: is {'a': 1}, expected a number"),
        ("- 1\n", "holds a list, expected lines 'key: value'"),
        ("3: 1\n", "3: unknown key"),
        ("sigma: 1\nx: !!python/object:os.system {}\n", "line 2: no valid YAML"),
    ],
)
def test_bad_yaml(text: str, message: str, tmp_path: Path) -> None:
    path = tmp_path / "my.yaml"
    path.write_text(text)
    with pytest.raises(ConfigError, match=message) as caught:
        Config.from_yaml(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert "\n" not in str(caught.value)


def test_missing_and_unreadable_files(tmp_path: Path) -> None:
    (tmp_path / "binary.yaml").write_bytes(b"\xff\xfe\x00")
    for name, message in (("none.yaml", "no such file"), (".", "cannot be opened"), ("binary.yaml", "text")):
        with pytest.raises(ConfigError, match=message):
            Config.from_yaml(tmp_path / name)
    (tmp_path / "empty.yaml").touch()
    assert Config.from_yaml(tmp_path / "empty.yaml") == Config()


@settings(max_examples=40, deadline=None)
@given(
    st.fixed_dictionaries(
        {},
        optional={
            "num_events_per_image": st.none() | st.integers(10, 10**6),
            "lambda_data": st.floats(1e-6, 1e6),
            "lambda_label": st.none() | st.floats(0, 1e12),
            "lambda_edge": st.floats(0, 255),
            "affine_trans2d_max": st.floats(1e-3, 1e6),
            "data_term": st.sampled_from(["logarithmic", "published"]),
            "labelling": st.sampled_from(["bands", "exact"]),
            "polarity": st.sampled_from(["opposed", "ignored"]),
            "footprint": st.sampled_from(["scattered", "point"]),
            "flicker": st.sampled_from(["left_out", "kept"]),
            "background": st.sampled_from(["scene", "widest"]),
            "max_events_per_window": st.none() | st.integers(1, 10**8),
            "hybrid_model_combination": st.sampled_from(["2d", "all", "auto", 0, 4, 6]),
            "seed": st.integers(0, 2**63 - 1),
        },
    )
)
def test_yaml_round_trip(tmp_path_factory: pytest.TempPathFactory, values: dict[str, Any]) -> None:
    config = Config(**values)
    path = tmp_path_factory.mktemp("yaml") / "config.yaml"
    text = config.to_yaml(path)
    assert path.read_text(encoding="utf-8") == text
    assert Config.from_yaml(path) == config


# engine.md's table: num_events, smooth, label, bracket, trans2d_max, data
PUBLISHED_TABLE = {
    "eed/fast_drone": (20_000, 40, 8000, 7, 30_000, 1),
    "eed/light_variations": (30_000, 30, 8000, 7, 5000, 1),
    "eed/occlusions": (20_000, 30, 4000, 6, 5000, 1),
    "eed/what_is_background": (30_000, 40, 8000, 6, 10_000, 1),
    "distsurf/car": (15_000, 30, 8000, 6, 5000, 1),
    "distsurf/hand": (15_000, 30, 8000, 6, 5000, 1),
    "evimo/box00": (15_000, 30, 8000, 6, 5000, 1),
    "evimo/table01": (30_000, 25, 8000, 8, 5000, 1),
    "hkust/cast": (15_000, 43, 8000, 8, 20_000, 1),
    "hkust/corridor": (30_000, 40, 10_000, 6, 20_000, 1),
    "thesis/hands": (15_000, 30, 8000, 8, 5000, 1),
    "thesis/fast_drone": (20_000, 40, 8000, 8, 5000, 1),
    "thesis/evimo": (30_000, 25, 8000, 8, 5000, 1),
    "thesis/slow_cam": (25_000, 25, 8000, 6, 5000, 2),
    "thesis/fast_cam": (30_000, 22, 10_000, 7, 5000, 2),
    "published": (None, 30, 8000, 6, 5000, 1),
}


def test_every_preset_is_as_published() -> None:
    assert set(Config.presets()) == set(PUBLISHED_TABLE)
    for name, (events, smooth, label, bracket, translation, data) in PUBLISHED_TABLE.items():
        config = Config.preset(name)
        assert config.num_events_per_image == events
        assert (config.lambda_smooth, config.lambda_label) == (smooth, label)
        assert config.bracket_row == config.bracket_col == bracket
        assert (config.affine_trans2d_max, config.lambda_data) == (translation, data)
        assert config.affine_scale_max == (0.8 if name == "distsurf/hand" else 0.5)
        assert (config.affine_theta_max, config.division_exponent) == (1.5, 7)
        assert (config.num_iter_segmentation, config.num_iter_labeling) == (5, 2)
        assert (config.hybrid_model_combination, config.data_term) == ("4d", "published")
        assert config.max_events_per_window is None
        assert (config.polarity, config.footprint, config.flicker) == ("ignored", "point", "kept")
        assert (config.background, config.sigma, config.noise_label) == ("widest", 1.0, "off")
        assert config.lambda_edge == 0


def test_unknown_preset() -> None:
    with pytest.raises(ConfigError, match="unknown preset 'eed/fast', did you mean 'eed/fast_drone'"):
        Config.preset("eed/fast")


def test_every_field_is_explained() -> None:
    for field in fields(Config):
        assert re.fullmatch(r"[A-Z].+ \[.+\]", explain(field.name))
        assert "None" not in explain(field.name)
    assert explain("sigma").endswith("[px, ≥ 0.1 ≤ 10; arXiv 2012.08730]")
    assert "events, ≥ 10" in explain("num_events_per_image")
    assert "logarithmic | published" in explain("data_term")


def test_fingerprint_ignores_only_threads() -> None:
    assert Config(threads=3).fingerprint() == Config().fingerprint()
    changes: dict[str, Any] = {
        "lambda_edge": 1.0,
        "sigma": 2.0,
        "seed": 1,
        "noise_label": "off",
        "window_duration": 0.1,
    }
    prints = {Config(**{key: value}).fingerprint() for key, value in changes.items()}
    assert len(prints | {Config().fingerprint()}) == len(changes) + 1


def test_the_engines_defaults_are_the_configs() -> None:
    """Every setting of the engine, by its name: what Config() hands over is what C++ would take by itself."""
    handed, own = engine_options(Config()), _core.SegmenterOptions()
    names = [name for name in dir(own) if not name.startswith("_")]
    assert {"lambda_smooth", "affine_trans2d_max", "kinds", "labelling", "max_events"} <= set(names)
    assert {name: getattr(handed, name) for name in names} == {name: getattr(own, name) for name in names}


@pytest.mark.parametrize(
    "name",
    ["lambda_smooth", "lambda_speed", "lambda_edge", "bracket_row", "affine_theta_max", "sigma", "threads"],
)
def test_a_setting_reaches_the_engine(name: str) -> None:
    change: dict[str, Any] = {name: 3}
    config = Config(**change)
    assert getattr(engine_options(config), name) == 3 != getattr(_core.SegmenterOptions(), name)


@pytest.mark.parametrize("count", [None, 1, 12_345])
def test_the_most_events_of_a_window_reach_the_engine(count: int | None) -> None:
    assert engine_options(Config(max_events_per_window=count)).max_events == count


@pytest.mark.parametrize(
    ("name", "value"), [("polarity", "ignored"), ("footprint", "point"), ("flicker", "kept")]
)
def test_how_events_are_taken_reaches_the_engine(name: str, value: str) -> None:
    change: dict[str, Any] = {name: value}
    assert getattr(engine_options(Config(**change)), name) == value != getattr(_core.SegmenterOptions(), name)
    with pytest.raises(ValueError, match=f"unknown {name} 'other', expected"):
        _core.SegmenterOptions(**{name: "other"})


def test_the_way_of_labelling_reaches_the_engine() -> None:
    assert engine_options(Config()).labelling == "bands"
    assert engine_options(Config(labelling="exact")).labelling == "exact"
    with pytest.raises(ValueError, match="unknown labelling 'fast', expected bands or exact"):
        _core.SegmenterOptions(labelling="fast")
    with pytest.raises(ValueError, match="max_events is 0, expected 1 or more"):
        _core.SegmenterOptions(max_events=0)
