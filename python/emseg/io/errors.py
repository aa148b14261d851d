"""The one error of reading."""

from __future__ import annotations

from os import PathLike

__all__ = ["ReadError"]


class ReadError(ValueError):
    """A file cannot be read as events: names the file, the place in it, and what was expected.

    Args:
        path: The file.
        problem: What is wrong and what was expected.
        place: Where in the file: a line, a key, a byte.
    """

    def __init__(self, path: str | PathLike[str], problem: str, *, place: str | None = None) -> None:
        self.path, self.problem, self.place = path, problem, place
        line = ": ".join(part for part in (place, problem) if part)
        # One line, whatever other people's libraries say.
        super().__init__(f"{path}: {' '.join(line.split())}")

    def __reduce__(self) -> tuple[object, ...]:
        # Errors cross process borders, and Exception would forget the keyword.
        return _restore, (self.path, self.problem, self.place)


def _restore(path: str, problem: str, place: str | None) -> ReadError:
    return ReadError(path, problem, place=place)
