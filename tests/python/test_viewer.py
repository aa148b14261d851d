"""The viewer's keys and slider, in a figure without a window."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("matplotlib")

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from emseg.video import Film
from emseg.viewer import Viewer


@pytest.fixture
def viewer() -> Viewer:
    """Frames that number themselves by their grey."""
    frames = [np.full((20, 40, 3), number, np.uint8) for number in range(5)]
    figure = Figure()
    FigureCanvasAgg(figure)
    return Viewer(Film(frames, frames_per_s=30, slowdown=1.0), figure)


def shown(viewer: Viewer) -> int:
    return int(viewer._image.get_array()[0, 0, 0])


def test_keys_step_through_the_frames(viewer: Viewer) -> None:
    assert shown(viewer) == 0
    for key, expected in [("right", 1), ("right", 2), ("left", 1), ("end", 4), ("right", 4), ("home", 0)]:
        viewer.press(key)
        assert (viewer.position, shown(viewer)) == (expected, expected)
    viewer.press("left")
    viewer.press("x")
    viewer.press(None)
    assert shown(viewer) == 0


def test_playing_ends_with_the_last_frame_and_begins_anew(viewer: Viewer) -> None:
    viewer.press(" ")
    assert viewer.playing
    for expected in (1, 2, 3, 4):
        assert viewer.playing
        viewer.tick()
        assert shown(viewer) == expected
    assert not viewer.playing
    viewer.press(" ")
    assert (viewer.playing, shown(viewer)) == (True, 0)
    viewer.press("right")
    assert not viewer.playing


def test_the_slider_shows_where_it_is(viewer: Viewer) -> None:
    viewer._slider.set_val(3)
    assert (viewer.position, shown(viewer)) == (3, 3)
    viewer.press("left")
    assert viewer._slider.val == 2
