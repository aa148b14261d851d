"""A window that shows a segmented recording: to play, to step through, to drag along."""

from __future__ import annotations

from typing import Any

from emseg.video import Film

__all__ = ["Viewer", "ViewerError", "open_window"]

_HELP = "space: play or stop   left, right: a frame   home, end: first, last   q: close"


class ViewerError(RuntimeError):
    """No window can be opened."""


class Viewer:
    """Shows the frames of a film in a figure of Matplotlib's.

    Args:
        film: What to show.
        figure: Where to show it.

    Attributes:
        position: Number of the frame that is shown.
        playing: Whether frames follow each other by themselves.
    """

    def __init__(self, film: Film, figure: Any) -> None:
        from matplotlib.widgets import Slider

        self._film = film
        self.position, self.playing = 0, False
        height, width = film.frames[0].shape[:2]
        figure.set_size_inches(width / figure.dpi, 1.12 * height / figure.dpi)
        figure.text(0.01, 0.015, _HELP, fontsize="small", color="0.4")
        axes = figure.add_axes((0, 0.1, 1, 0.9))
        axes.set_axis_off()
        self._image = axes.imshow(film.frames[0])
        last = max(len(film.frames) - 1, 1)
        place = figure.add_axes((0.1, 0.05, 0.8, 0.03))
        self._slider = Slider(place, "frame", 0, last, valinit=0, valstep=1, valfmt="%d")
        self._slider.on_changed(lambda value: self._show(int(value)))
        self._timer = figure.canvas.new_timer(interval=round(1000 / film.frames_per_s))
        self._timer.add_callback(self.tick)
        figure.canvas.mpl_connect("key_press_event", lambda event: self.press(event.key))
        figure.canvas.mpl_connect("close_event", lambda event: self._timer.stop())
        self._canvas = figure.canvas

    def go_to(self, position: int) -> None:
        """Show a frame, the first or last one where there is none of this number."""
        self._slider.set_val(min(max(position, 0), len(self._film.frames) - 1))

    def _show(self, position: int) -> None:
        self.position = min(position, len(self._film.frames) - 1)
        self._image.set_data(self._film.frames[self.position])
        self._canvas.draw_idle()

    def tick(self) -> None:
        """Go on by a frame; stop at the last one."""
        self.go_to(self.position + 1)
        if self.position == len(self._film.frames) - 1:
            self.play("stop")

    def play(self, what: str) -> None:
        """ "start" or "stop" playing."""
        self.playing = what == "start"
        if self.playing:
            self._timer.start()
        else:
            self._timer.stop()

    def press(self, key: str | None) -> None:
        """Do what a key stands for."""
        last = len(self._film.frames) - 1
        if key == " ":
            if self.position == last:
                self.go_to(0)
            self.play("stop" if self.playing else "start")
        steps = {"left": self.position - 1, "right": self.position + 1, "home": 0, "end": last}
        if key in steps:
            self.play("stop")
            self.go_to(steps[key])


def open_window(film: Film, title: str) -> None:
    """Show a film until the window is closed.

    Raises:
        ViewerError: Matplotlib is not installed, or has nowhere to open a window.
    """
    try:
        import matplotlib.pyplot as plt
    except ImportError:
        raise ViewerError("Matplotlib is not installed: pip install 'emseg[viz]'") from None
    figure = plt.figure(num=title)
    if figure.canvas.required_interactive_framework is None:
        plt.close(figure)
        raise ViewerError("no window can be opened here: it takes a display, and Tk, Qt or GTK for Python")
    viewer = Viewer(film, figure)
    viewer.play("start")
    plt.show()
