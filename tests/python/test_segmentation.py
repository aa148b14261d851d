"""segment: its energy against the reference's evaluation, its invariances, and what it returns."""

from __future__ import annotations

import re
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from engine_and_reference import (
    AS_PUBLISHED,
    event_array,
    lens,
    reference_camera,
    reference_graph,
    reference_model,
    reference_window,
    scattered_events,
)
from hypothesis import given, settings
from hypothesis import strategies as st

import emseg
from emseg import reference
from emseg.config import explain
from emseg.metrics import one_to_one_accuracy
from emseg.segmentation import known_motions
from emseg.tracking import TrackedMotion

PLAIN = {**AS_PUBLISHED, "noise_label": "off"}
CONFIGS = {
    "published": emseg.Config(**PLAIN, data_term="published", lambda_label=2000.0),
    "logarithmic": emseg.Config(**PLAIN, data_term="logarithmic", lambda_label=2000.0),
    "heavy data": emseg.Config(
        **{**PLAIN, "sigma": 0.7}, lambda_data=2.5, lambda_smooth=17.0, lambda_label=500.0
    ),
    "rotations": emseg.Config(**PLAIN, hybrid_model_combination="3d", lambda_label=2000.0),
    "affine": emseg.Config(**PLAIN, hybrid_model_combination="affine", lambda_label=2000.0),
}


COST_MARGIN = 1e-3  # by which float32 may move a cost


@cache
def two_motions(seed: int = 0) -> tuple[emseg.EventArray, np.ndarray]:
    """A textured scene that moves, and a smaller one before it that moves otherwise; labels 0 and 1.

    Every point of the texture is brighter or darker than what is around it: its events are of one sign.
    """
    rng = np.random.default_rng(seed)
    count, width, height = 6000, 160, 120
    label = (rng.random(count) < 0.35).astype(int)
    scene = rng.uniform((4, 4), (156, 116), (250, 2))
    thing = rng.uniform((60, 40), (100, 80), (80, 2))
    scene = scene[(np.abs(scene - (80, 60)) > 24).any(axis=1)]
    t = 500_000 + np.sort(rng.integers(0, 40_000, count))
    point = np.where(label == 0, rng.integers(0, len(scene), count), rng.integers(0, len(thing), count))
    start = np.concatenate([scene, thing])[point + label * len(scene)]
    velocity = np.array([(120.0, -60.0), (-150.0, 140.0)])[label]
    pixel = np.rint(start + velocity * ((t - 520_000) * 1e-6)[:, None]).astype(int)
    inside = ((pixel >= 0) & (pixel < (width, height))).all(axis=1)
    events = event_array(*pixel[inside].T, t[inside], width=width, height=height, p=point[inside] % 2)
    return events, label[inside]


def evaluate(found: emseg.Segmentation, config: emseg.Config, label_cost: float) -> tuple[int, int]:
    """The energy of labels and models by the reference, and how far rounding may put the engine's off it.

    The engine's images are float32, so that a cost within 1e-3 of a half may round to the other side.
    """
    window = reference_window(found.events, found.camera, t_ref=found.t_ref)
    costs = reference.data_costs(
        [reference_model(model) for model in found.models],
        window,
        data_term=config.data_term,
        lambda_data=config.lambda_data,
        sigma=config.sigma,
        reference=found.reference_sharpness,
    )
    energy = reference.labeling_energy(
        found.labels,
        np.rint(costs).astype(np.int64),
        reference_graph(found.events),
        lambda_smooth=round(config.lambda_smooth),
        label_cost=np.full(len(found.models), round(label_cost)),
    )
    own = costs[np.arange(len(found.labels)), found.labels]
    doubtful = np.count_nonzero(np.abs(own - np.floor(own) - 0.5) < COST_MARGIN)
    return energy, doubtful


@pytest.mark.parametrize("labelling", ["exact", "bands"])
@pytest.mark.parametrize("distorted", [False, True], ids=["pinhole", "lens"])
@pytest.mark.parametrize("name", list(CONFIGS))
def test_energy_is_the_references_of_the_same_labels_and_models(name, distorted, labelling):
    events, _ = two_motions()
    config = replace(CONFIGS[name], labelling=labelling, max_events_per_window=None)
    camera = lens(160, 120) if distorted else None
    found = emseg.segment(events, camera, config)
    assert len(found.models) > 1
    assert config.lambda_label is not None
    energy, doubtful = evaluate(found, config, config.lambda_label)
    assert doubtful < 0.01 * len(events)
    assert abs(found.energy - energy) <= doubtful


def test_the_default_cost_of_a_label_grows_with_the_window_as_documented():
    events, _ = two_motions()
    (per_event,) = re.findall(r"([0-9.]+) an event", explain("lambda_label"))
    for part in (events, events[: len(events) // 2]):
        config = emseg.Config(**PLAIN)
        found = emseg.segment(part, config=config)
        energy, doubtful = evaluate(found, config, float(per_event) * len(part))
        assert abs(found.energy - energy) <= doubtful


@pytest.mark.parametrize("name", list(CONFIGS))
def test_energy_never_rises_and_ends_where_the_trace_does(name):
    events, _ = two_motions()
    found = emseg.segment(events, config=CONFIGS[name])
    assert (np.diff(found.energy_trace) <= 0).all()
    assert found.energy == found.energy_trace[-1]


@pytest.mark.parametrize("name", ["published", "logarithmic", "affine"])
def test_two_motions_come_apart(name):
    events, truth = two_motions()
    found = emseg.segment(events, config=CONFIGS[name])
    assert one_to_one_accuracy(truth, found.labels) > 0.97
    assert [model.label for model in found.models] == [0, 1]


def test_alternation_betters_models_that_start_a_pixel_off():
    events, truth = two_motions()
    off = [emseg.MotionModel("translation", velocity) for velocity in ((150.0, -85.0), (-125.0, 115.0))]
    config = emseg.Config(**PLAIN, hybrid_model_combination="2d")
    once = emseg.segment(events, config=replace(config, num_iter_segmentation=1), pool=off)
    found = emseg.segment(events, config=config, pool=off)
    assert found.energy <= once.energy < once.energy_trace[0]
    for model, start, velocity in zip(found.models, off, ((120.0, -60.0), (-150.0, 140.0)), strict=True):
        assert np.linalg.norm(model.params - velocity) < np.linalg.norm(start.params - velocity)
    assert one_to_one_accuracy(truth, found.labels) > 0.97


@pytest.mark.parametrize("data_term", ["published", "logarithmic"])
def test_bands_and_exact_labels_are_nearly_as_good_for_the_same_models(data_term):
    events, _ = two_motions()
    pool = [emseg.MotionModel("translation", v) for v in ((125.0, -60.0), (-150.0, 140.0), (0.0, 0.0))]
    plain = emseg.Config(**PLAIN, data_term=data_term, hybrid_model_combination="2d")
    found = [
        emseg.segment(events, config=replace(plain, labelling=labelling), pool=pool)
        for labelling in ("bands", "exact")
    ]
    bands, exact = (one.energy_trace[0] for one in found)
    assert abs(bands - exact) < 2e-4 * exact
    assert (found[0].labels == found[1].labels).mean() > 0.99


# What is known beforehand -----------------------------------------------------------------------------------


SCENE, THING = (emseg.MotionModel("translation", v) for v in ((120.0, -60.0), (-150.0, 140.0)))
DEAR = emseg.Config(lambda_label=250_000.0, threads=1)  # a label costs 120 for every event of the thing


def expected_thing(model: emseg.MotionModel, t: int) -> TrackedMotion:
    """The thing, which is in the middle of the view at t_ref, 520 000 µs, as it was at t if it moved so."""
    at = np.stack(np.meshgrid(np.arange(60, 101, 4), np.arange(40, 81, 4)), axis=-1).reshape(-1, 2)
    return TrackedMotion(model, (at + model.params * ((t - 520_000) * 1e-6)).astype(np.float32), t)


def test_an_object_that_is_tracked_is_found_where_a_label_would_cost_too_much():
    events, truth = two_motions()
    segmenter = emseg.Segmenter(events.width, events.height, config=DEAR)
    assert len(segmenter.find_motions(events).models) == 1
    assert len(segmenter.find_motions(events, candidates=[SCENE, THING]).models) == 1
    tracked = [TrackedMotion(THING)]
    found = segmenter.find_motions(events, candidates=[SCENE], tracked=tracked)
    assert one_to_one_accuracy(truth, found.labels) > 0.95
    other = emseg.Segmenter(events.width, events.height, config=replace(DEAR, threads=3))
    assert same_result(other.find_motions(events, candidates=[SCENE], tracked=tracked), found)


@pytest.mark.parametrize("t", [520_000, 480_000])
def test_an_object_that_turned_since_it_was_seen_is_found_by_its_place(t):
    events, truth = two_motions()
    segmenter = emseg.Segmenter(events.width, events.height, config=DEAR)
    before = emseg.MotionModel("translation", (-40.0, 60.0))  # 5 px off over the window
    assert (
        len(segmenter.find_motions(events, candidates=[SCENE], tracked=[TrackedMotion(before)]).models) == 1
    )
    tracked = [expected_thing(before, t)]
    found = segmenter.find_motions(events, candidates=[SCENE], tracked=tracked, t_ref=520_000)
    assert one_to_one_accuracy(truth, found.labels) > 0.95
    assert np.linalg.norm(found.models[1].params[:2] - THING.params) * 0.04 < 0.5
    other = emseg.Segmenter(events.width, events.height, config=replace(DEAR, threads=3))
    assert same_result(other.find_motions(events, candidates=[SCENE], tracked=tracked, t_ref=520_000), found)


def test_places_are_of_their_time():
    """What was seen earlier is expected where its motion has brought it."""
    events, _ = two_motions()
    segmenter = emseg.Segmenter(events.width, events.height, config=emseg.Config(threads=1))

    def found(known):
        return segmenter.find_motions(events, candidates=[SCENE], tracked=[known], t_ref=520_000)

    now, earlier = expected_thing(THING, 520_000), expected_thing(THING, 320_000)
    assert np.abs(now.places - earlier.places).max() > 20
    assert same_result(found(now), found(earlier))
    assert found(replace(now, t=320_000)).energy > found(now).energy


def test_places_that_are_no_points_are_refused():
    events, _ = two_motions()
    segmenter = emseg.Segmenter(events.width, events.height)
    for shape in ((4,), (4, 3), (0,)):
        known = TrackedMotion(THING, np.zeros(shape, np.float32))
        with pytest.raises(ValueError, match=r"places must be an \(n, 2\) array"):
            segmenter.find_motions(events, tracked=[known])


def test_what_is_known_is_tracked_or_a_candidate_but_not_both():
    events, _ = two_motions()
    segmenter = emseg.Segmenter(events.width, events.height)
    found = segmenter.find_motions(events)
    tracker = segmenter.tracker()
    known = known_motions(found, tracker.motions())
    assert (known["candidates"], known["tracked"]) == (found.models, [])
    tracker.assign(events, found.labels, found.models, found.t_ref)
    known = known_motions(found, tracker.motions())
    (thing,) = known["tracked"]
    assert np.linalg.norm(thing.model.params[:2] - THING.params) < 15
    assert thing.t == found.t_ref
    low, high = np.quantile(thing.places, (0.02, 0.98), axis=0)
    np.testing.assert_allclose([low, high], [(60, 40), (100, 80)], atol=4)
    both = [model.native() for model in known["candidates"]] + [thing.model.native()]
    assert sorted(both) == sorted(model.native() for model in found.models)
    # What is known may be said of the next window at once.
    assert len(segmenter.find_motions(events, **known).models) == len(found.models)


# Windows of more events than motions and labels are found on ----------------------------------------------


def test_a_thinned_window_is_nearly_as_well_segmented_as_a_full_one():
    events, truth = two_motions()
    full = emseg.segment(events, config=emseg.Config(max_events_per_window=None))
    assert full.thinned == 0
    for most, least in ((len(events) // 2, 0.95), (len(events) // 3, 0.93)):
        found = emseg.segment(events, config=emseg.Config(max_events_per_window=most))
        assert found.thinned == len(events) - most
        assert found.labels.shape == truth.shape
        assert [model.label for model in found.models] == [0, 1]
        assert one_to_one_accuracy(truth, found.labels) >= least
        for model, other in zip(found.models, full.models, strict=True):
            assert np.linalg.norm(model.params[:2] - other.params[:2]) * events.duration * 1e-6 < 0.5


def test_windows_of_no_more_events_than_allowed_are_not_thinned():
    events, _ = two_motions()
    full = emseg.segment(events, config=emseg.Config(max_events_per_window=None))
    just = emseg.segment(events, config=emseg.Config(max_events_per_window=len(events)))
    assert just.thinned == 0
    assert same_result(just, full)


@pytest.mark.parametrize("threads", [2, 7])
def test_threads_change_nothing_in_a_thinned_window(threads):
    events, _ = two_motions()
    config = emseg.Config(max_events_per_window=2000, threads=1)
    one = emseg.segment(events, config=config)
    assert same_result(one, emseg.segment(events, config=replace(config, threads=threads)))


@pytest.mark.parametrize("most", [1, 2, 50])
def test_a_window_may_be_thinned_to_next_to_nothing(most):
    events, _ = two_motions()
    found = emseg.segment(events, config=emseg.Config(max_events_per_window=most))
    assert found.thinned == len(events) - most
    assert set(np.unique(found.labels)) <= {-1, *(model.label for model in found.models)}
    assert (np.diff(found.energy_trace) <= 0).all()


# Invariances ----------------------------------------------------------------------------------------------


def same_result(a: emseg.Segmentation, b: emseg.Segmentation) -> bool:
    return bool(
        np.array_equal(a.labels, b.labels)
        and a.models == b.models
        and (a.energy, a.energy_trace) == (b.energy, b.energy_trace)
    )


@settings(max_examples=5, deadline=None)
@given(st.integers(-(2**60), 2**60))
def test_a_shift_in_time_changes_nothing(shift):
    events, _ = two_motions()
    shifted = event_array(
        events.x, events.y, events.t + shift, width=events.width, height=events.height, p=events.p
    )
    before, after = emseg.segment(events), emseg.segment(shifted)
    assert same_result(before, after)
    assert after.t_ref == before.t_ref + shift


@pytest.mark.parametrize("threads", [2, 7])
@pytest.mark.parametrize("name", ["published", "logarithmic", "affine"])
def test_threads_change_nothing(name, threads):
    events, _ = two_motions()
    config = CONFIGS[name]
    one = emseg.segment(events, config=replace(config, threads=1))
    assert same_result(one, emseg.segment(events, config=replace(config, threads=threads)))


def test_a_segmenter_used_before_gives_the_same_as_a_fresh_one():
    events, _ = two_motions()
    segmenter = emseg.Segmenter(events.width, events.height)
    segmenter.segment(two_motions(1)[0])
    assert same_result(segmenter.segment(events), emseg.segment(events))


def test_swapped_polarities_change_nothing():
    events, _ = two_motions()
    swapped = event_array(
        events.x, events.y, events.t, width=events.width, height=events.height, p=1 - events.p
    )
    ignored = emseg.Config(polarity="ignored")
    assert same_result(emseg.segment(events, config=ignored), emseg.segment(swapped, config=ignored))
    opposed, negative = emseg.segment(events), emseg.segment(swapped)
    assert (opposed.labels == negative.labels).mean() > 0.999


@settings(max_examples=5, deadline=None)
@given(st.permutations(range(2)))
def test_the_order_of_the_pool_only_renames(order):
    """Which model comes first matters neither to the energy nor, but for ties, to the labels."""
    events, truth = two_motions()
    pool = [emseg.MotionModel("translation", v) for v in ((120.0, -60.0), (-150.0, 140.0))]
    config = emseg.Config(**PLAIN, hybrid_model_combination="2d")
    plain = emseg.segment(events, config=config, pool=pool)
    renamed = emseg.segment(events, config=config, pool=[pool[i] for i in order])
    assert renamed.energy == plain.energy
    assert (renamed.labels == plain.labels).mean() > 0.999
    assert one_to_one_accuracy(truth, renamed.labels) > 0.97


@settings(max_examples=5, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_the_order_of_simultaneous_events_hardly_matters(seed):
    """It decides only which of them is before the other in the graph."""
    events, truth = two_motions()
    coarse = (events.t // 100) * 100
    order = np.lexsort((np.random.default_rng(seed).random(len(coarse)), coarse))
    size = {"width": events.width, "height": events.height}
    before = emseg.segment(event_array(events.x, events.y, coarse, p=events.p, **size))
    shuffled = emseg.segment(
        event_array(events.x[order], events.y[order], coarse[order], p=events.p[order], **size)
    )
    assert len(shuffled.models) == len(before.models)
    assert (shuffled.labels == before.labels[order]).mean() > 0.995
    assert one_to_one_accuracy(truth[order], shuffled.labels) > 0.95


# What is returned -----------------------------------------------------------------------------------------


def test_what_a_segmentation_holds():
    events, _ = two_motions()
    found = emseg.segment(events)
    assert found.labels.dtype == np.int32
    assert found.labels.shape == (len(events),)
    assert set(np.unique(found.labels)) <= {-1, *(model.label for model in found.models)}
    assert [model.label for model in found.models] == list(range(len(found.models)))
    sizes = [np.count_nonzero(found.labels == model.label) for model in found.models[1:]]
    assert sizes == sorted(sizes, reverse=True)
    assert (found.start, found.stop) == (0, len(events))
    assert found.t_ref == (int(events.t[0]) + int(events.t[-1])) // 2
    assert found.timings
    assert all(seconds >= 0 for seconds in found.timings.values())
    image = found.label_image()
    assert image.shape == (events.height, events.width)
    last = {
        (int(x), int(y)): int(label) for x, y, label in zip(events.x, events.y, found.labels, strict=True)
    }
    assert all(image[y, x] == label for (x, y), label in last.items())
    assert np.count_nonzero(image != -1) <= len(last)
    with pytest.raises(KeyError, match="no label 99"):
        found.model_of(99)


def test_images_of_labels_add_up():
    events, _ = two_motions()
    found = emseg.segment(events)
    single = [found.iwe(model.label, sigma=0.0) for model in found.models]
    np.testing.assert_allclose(found.iwe(sigma=0.0), np.sum(single, axis=0), atol=1e-4)
    for model, image in zip(found.models, single, strict=True):
        assert model.label is not None
        own = found.events_of(model.label)
        assert image.sum() == pytest.approx(len(own), rel=0.05)  # few leave the frame
        expected = reference.iwe(reference_model(model), reference_window(own, t_ref=found.t_ref), sigma=0.0)
        np.testing.assert_allclose(image, expected, atol=1e-4)


def test_a_still_camera_has_a_background_that_does_not_move():
    """One thing that moves before nothing: it is an object, and what little lies around is background."""
    events, truth = two_motions()
    thing = events[truth == 1]
    thing = event_array(thing.x, thing.y, thing.t, p=thing.p, width=320, height=240)
    found = emseg.segment(thing)
    assert found.models[0].label == 0
    np.testing.assert_array_equal(found.models[0].params, 0.0)
    assert np.count_nonzero(found.labels == 1) > 0.9 * len(thing)
    (box,) = found.boxes
    assert box["track"] == 1
    assert 30 < box["w"] < 55
    assert 30 < box["h"] < 55


def test_boxes_lie_on_the_sensor_where_the_lens_shows_them():
    """A patch near a corner while the camera turns: its box is around where the lens shows it at t_ref."""
    camera = lens(160, 120)
    rng = np.random.default_rng(0)
    rotation = emseg.MotionModel("rotation", [0.6, -0.8, 1.0], label=1)
    dt = np.sort(rng.uniform(-0.08, 0.08, 2000))
    place = rng.uniform((20, 80), (50, 105), (2000, 2))
    frame = reference.ImageFrame(160, 120, reference_camera(camera))
    seen = reference.warp_points(reference_model(rotation), place, -dt, frame)
    pixel = np.rint(reference_camera(camera).distort(seen)).astype(int)
    events = event_array(*pixel.T, np.rint(dt * 1e6), width=160, height=120)
    found = emseg.Segmentation(
        events,
        np.ones(2000, np.int32),
        [emseg.MotionModel("translation", label=0), rotation],
        energy=0.0,
        energy_trace=[0.0],
        reference_sharpness=1.0,
        timings={},
        t_ref=0,
        camera=camera,
    )
    shown = reference_camera(camera).distort(place)
    low, high = np.quantile(shown, (0.01, 0.99), axis=0)
    (box,) = found.boxes
    np.testing.assert_allclose([box["x"], box["y"]], low, atol=1.0)
    np.testing.assert_allclose([box["w"], box["h"]], high - low + 1, atol=1.0)


def test_noise_is_marked_and_everything_else_keeps_its_label():
    events, _ = two_motions()
    size = {"width": events.width, "height": events.height}
    stray = scattered_events(5, 150, duration=40_000, **size)
    t = np.concatenate([events.t, stray.t - 500_000])
    order = np.argsort(t, kind="stable")
    mixed = event_array(
        np.concatenate([events.x, stray.x])[order],
        np.concatenate([events.y, stray.y])[order],
        t[order],
        p=np.concatenate([events.p, stray.p])[order],
        **size,
    )
    is_stray = (np.arange(len(t)) >= len(events))[order]
    # As motions: among objects, what lies apart from its motion's parts is -1 too.
    plain = emseg.segment(mixed, config=emseg.Config(noise_label="off", background="widest"))
    marked = emseg.segment(mixed, config=emseg.Config(background="widest"))
    assert (plain.labels >= 0).all()
    noise = marked.labels == -1
    np.testing.assert_array_equal(marked.labels[~noise], plain.labels[~noise])
    assert marked.energy == plain.energy
    # Half the frame is covered by warped points, beside which a stray event is not alone.
    assert noise[is_stray].mean() > 0.15
    assert noise[~is_stray].mean() < 0.01
