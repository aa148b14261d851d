"""Pictures and video: shapes, colours and places; the picture files read back by other libraries."""

from __future__ import annotations

import dataclasses
import subprocess
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fake_segmenter import FakeSegmentation
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from emseg import video
from emseg.events import EventArray
from emseg.glyphs import text_mask
from emseg.render import (
    BOX_DTYPE,
    fitting_scale,
    iwe_picture,
    label_picture,
    motion_picture,
    polarity_picture,
    side_by_side,
    track_colour,
)
from emseg.video import VideoError, VideoWriter, film
from emseg.writers import ResultWriter, SequenceResult, load_result, write_png

EVENTS = EventArray([1, 2, 3, 4], [0, 1, 2, 3], [0, 10, 20, 30], [0, 1, 0, 1], width=7, height=5)


def moving(n: int = 3000, width: int = 30, height: int = 20, duration: int = 50_000) -> EventArray:
    k = np.arange(n)
    return EventArray(k % width, k % height, k * duration // n, k % 2, width=width, height=height)


def result_of(events: EventArray, window: int = 500) -> SequenceResult:
    with tempfile.TemporaryDirectory() as folder, ResultWriter(Path(folder)) as writer:
        for start in range(0, len(events), window):
            part = events[start : start + window]
            writer.add(FakeSegmentation(part, start, start + len(part)))
        writer.finish({}, events=len(events))
        return load_result(folder)[0]


def test_labels_have_their_colours() -> None:
    picture = label_picture(EVENTS, [0, 1, 2, -1], scale=1)
    assert picture.shape == (5, 7, 3)
    assert picture.dtype == np.uint8
    assert tuple(picture[1, 2]) == track_colour(1)
    assert tuple(picture[2, 3]) == track_colour(2)
    grey, noise, ground = (picture[y, x].astype(int).sum() for y, x in ((0, 1), (3, 4), (4, 6)))
    assert grey > noise > ground


def test_moving_events_are_drawn_over_background_and_noise() -> None:
    events = EventArray([1, 1, 1], [1, 1, 1], [0, 1, 2], [0, 0, 0], width=3, height=3)
    assert tuple(label_picture(events, [3, 0, -1], scale=1)[1, 1]) == track_colour(3)
    at_rest = label_picture(events[1:], [0, -1], scale=1)[1, 1]
    assert (at_rest == label_picture(events[1:], [0, 0], scale=1)[1, 1]).all()


def test_colours_of_neighbouring_tracks_differ() -> None:
    colours = [track_colour(k) for k in range(1, 8)]
    assert len(set(colours)) == 7
    assert track_colour(8) == track_colour(1)


def test_polarities_differ() -> None:
    picture = polarity_picture(EVENTS, scale=1)
    assert not (picture[0, 1] == picture[1, 2]).all()
    assert (picture[0, 1] == picture[2, 3]).all()


@pytest.mark.parametrize(
    ("width", "height", "scale"), [(346, 260, 3), (240, 180, 4), (640, 480, 2), (1280, 720, 1)]
)
def test_small_sensors_are_enlarged(width: int, height: int, scale: int) -> None:
    assert fitting_scale(width, height) == scale
    events = EventArray([0], [0], [0], [1], width=width, height=height)
    assert polarity_picture(events).shape == (height * scale, width * scale, 3)
    assert polarity_picture(events, caption="t").shape[0] > height * scale


@given(
    hnp.arrays(
        BOX_DTYPE,
        st.integers(0, 4),
        elements=st.tuples(st.integers(1, 10**6), *[st.floats(-1e6, 1e6, width=32)] * 4),
    ),
    st.text(max_size=60),
)
def test_any_box_and_caption_can_be_drawn(boxes: Any, caption: str) -> None:
    picture = label_picture(EVENTS, [0] * 4, boxes=boxes, caption=caption, scale=3)
    assert picture.shape[1:] == (21, 3)


def test_boxes_lie_where_they_should() -> None:
    events = EventArray([0], [0], [0], [1], width=60, height=40)
    boxes = np.array([(1, 20, 10, 30, 20)], BOX_DTYPE)
    picture = label_picture(events, [0], boxes=boxes, scale=2)
    for y, x in ((20, 40), (60, 40), (20, 100), (60, 100), (40, 40), (60, 70)):
        assert tuple(picture[y, x]) == track_colour(1)
    assert tuple(picture[45, 80]) != track_colour(1)


def test_labels_must_fit() -> None:
    with pytest.raises(ValueError, match=r"labels have shape \(3,\), expected \(4,\)"):
        label_picture(EVENTS, [0, 1, 2])
    with pytest.raises(ValueError, match="scale is 0"):
        polarity_picture(EVENTS, scale=0)


def test_iwe_pictures() -> None:
    iwe = np.zeros((4, 6), np.float32)
    assert len(np.unique(iwe_picture(iwe, scale=1).reshape(-1, 3), axis=0)) == 1
    iwe[1, 2], iwe[2, 3] = 4, 1
    picture = iwe_picture(iwe, scale=1).astype(int).sum(axis=2)
    assert picture[1, 2] > picture[2, 3] > picture[0, 0]


def test_motion_picture_colours_every_label() -> None:
    events = moving()
    picture = motion_picture(FakeSegmentation(events, 0, len(events)), scale=1)
    assert picture.shape == (20, 30, 3)
    red, _, blue = picture[0, 0].astype(int)  # label 1 is orange
    assert red > blue
    red, _, blue = picture[18, 28].astype(int)  # label 2 is blue
    assert blue > red
    assert motion_picture(FakeSegmentation(events, 0, len(events), models=[]), scale=1).shape == picture.shape


def test_text() -> None:
    assert text_mask("ab 1").shape == (7, 23)
    assert text_mask("").shape == (7, 0)
    assert (text_mask("A") == text_mask("a")).all()
    assert (text_mask("x", 3) == text_mask("x").repeat(3, 0).repeat(3, 1)).all()
    letters = "abcdefghijklmnopqrstuvwxyz0123456789.,:-+=/#()%_|×§"
    assert len({text_mask(letter).tobytes() for letter in letters}) == len(letters)


def test_side_by_side_fills_the_lower_one() -> None:
    left, right = np.zeros((4, 3, 3), np.uint8), np.full((6, 5, 3), 255, np.uint8)
    joined = side_by_side(left, right)
    assert joined.shape[0] == 6
    assert (joined[:4, :3] == 0).all()
    assert (joined[:, -5:] == 255).all()


@given(hnp.arrays(np.uint8, st.tuples(st.integers(1, 9), st.integers(1, 9), st.just(3))))
def test_png_reads_back(tmp_path_factory: pytest.TempPathFactory, picture: Any) -> None:
    cv2 = pytest.importorskip("cv2")
    path = tmp_path_factory.mktemp("png") / "a.png"
    write_png(path, picture)
    assert (cv2.imread(str(path), cv2.IMREAD_UNCHANGED)[..., ::-1] == picture).all()


def test_png_refuses_other_arrays(tmp_path: Path) -> None:
    for wrong in (np.zeros((3, 3), np.uint8), np.zeros((3, 3, 3)), np.zeros((0, 3, 3), np.uint8)):
        with pytest.raises(ValueError, match=r"expected uint8 \(h, w, 3\)"):
            write_png(tmp_path / "a.png", wrong)


def test_film_is_slowed_down_to_four_seconds() -> None:
    events = moving(duration=400_000)
    shown = film(events, result_of(events))
    assert (len(shown.frames), shown.frames_per_s) == (120, 30)
    assert shown.slowdown == pytest.approx(10, rel=1e-3)
    assert len({frame.shape for frame in shown.frames}) == 1


def test_film_of_long_and_empty_recordings() -> None:
    long = moving(duration=10_000_000)
    shown = film(long, result_of(long))
    assert (len(shown.frames), shown.slowdown) == (300, pytest.approx(1))
    empty = moving()[:0]
    assert len(list(film(empty, result_of(empty)).frames)) == 1
    with pytest.raises(ValueError, match="3000 events and 0 labels"):
        film(moving(), result_of(empty))


def test_boxes_move_evenly_between_windows() -> None:
    events = moving(n=300, duration=3000)
    result = result_of(events, window=100)
    tracks = result.tracks[result.tracks["track"] == 1].copy()
    tracks["x"] = [0, 10, 20]
    result = dataclasses.replace(result, tracks=tracks)
    first, second, last = (int(t) for t in tracks["t_us"])
    times = (first, (first + second) // 2, second, last)
    assert [video._boxes_at(events, result, t)["x"].tolist() for t in times] == [[0], [5], [10], [20]]
    without = dataclasses.replace(result, tracks=tracks[:1])
    assert len(video._boxes_at(events, without, second)) == 0
    assert len(video._boxes_at(events, without, -5)) == 0


def test_video_is_h264_in_even_sizes(tmp_path: Path) -> None:
    imageio_ffmpeg = pytest.importorskip("imageio_ffmpeg")
    path = tmp_path / "a.mp4"
    frames = [np.full((33, 65, 3), value, np.uint8) for value in (0, 120, 255)]
    with VideoWriter(path, frames_per_s=30) as writer:
        for frame in frames:
            writer.write(frame)
    told = subprocess.run(
        [imageio_ffmpeg.get_ffmpeg_exe(), "-i", str(path)], capture_output=True, text=True, check=False
    ).stderr
    assert "h264" in told
    assert "yuv420p" in told
    assert "66x34" in told
    reader = imageio_ffmpeg.read_frames(str(path))
    next(reader)
    levels = [np.frombuffer(frame, np.uint8).mean() for frame in reader]
    assert levels == pytest.approx([0, 120, 255], abs=6)


def hide(monkeypatch: pytest.MonkeyPatch, *modules: str) -> None:
    find_spec = video.importlib.util.find_spec
    monkeypatch.setattr(
        video.importlib.util, "find_spec", lambda name: None if name in modules else find_spec(name)
    )


def test_video_falls_back_to_opencv(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    cv2 = pytest.importorskip("cv2")
    hide(monkeypatch, "imageio_ffmpeg")
    with VideoWriter(tmp_path / "a.mp4", frames_per_s=30) as writer:
        for _ in range(3):
            writer.write(np.full((32, 64, 3), 200, np.uint8))
    assert "MPEG-4" in caplog.text
    assert cv2.VideoCapture(str(tmp_path / "a.mp4")).get(cv2.CAP_PROP_FRAME_COUNT) == 3


def test_video_without_encoder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    hide(monkeypatch, "imageio_ffmpeg", "cv2")
    writer = VideoWriter(tmp_path / "a.mp4", frames_per_s=30)
    with pytest.raises(VideoError, match=r"pip install 'emseg\[viz\]'"):
        writer.write(np.zeros((32, 64, 3), np.uint8))


def test_video_that_cannot_be_written(tmp_path: Path) -> None:
    pytest.importorskip("imageio_ffmpeg")

    def write() -> None:
        with VideoWriter(tmp_path / "none" / "a.mp4", frames_per_s=30) as writer:
            for _ in range(200):
                writer.write(np.zeros((480, 640, 3), np.uint8))

    with pytest.raises(VideoError, match=r"a\.mp4"):
        write()


def test_frames_must_have_one_size(tmp_path: Path) -> None:
    pytest.importorskip("imageio_ffmpeg")
    with VideoWriter(tmp_path / "a.mp4", frames_per_s=30) as writer:
        writer.write(np.zeros((32, 64, 3), np.uint8))
        with pytest.raises(ValueError, match="expected"):
            writer.write(np.zeros((32, 66, 3), np.uint8))
