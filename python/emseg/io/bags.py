"""ROS bags: ROS 1, and ROS 2 stored in SQLite or mcap."""

from __future__ import annotations

import contextlib
import logging
import sqlite3
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Protocol

from emseg.io.bag_salvage import scan_mcap, scan_ros1
from emseg.io.errors import ReadError
from emseg.io.extras import require
from emseg.io.recording import Block, Frame, ImuSamples, ReadOptions, Source, at
from emseg.io.ros_messages import (
    EVENT_ARRAYS,
    EVENT_PACKETS,
    IMAGE,
    IMU,
    EventMessages,
    parse_image,
    parse_imu,
)

__all__ = ["ROS1", "ROS2", "Ros1Reader", "Ros2Reader"]

_log = logging.getLogger(__name__)

_ROS1_MAGIC: Final = b"#ROSBAG V"
_SQLITE_MAGIC: Final = b"SQLite format 3\0"
_MCAP_MAGIC: Final = b"\x89MCAP"
_EVENT_TYPES: Final = (*EVENT_ARRAYS, *EVENT_PACKETS)


@dataclass(frozen=True)
class _Topic:
    name: str
    message_type: str  # as package/msg/Name


class _Bag(Protocol):
    """A bag's topics, and their messages in order of their times."""

    topics: list[_Topic]

    def messages(self, topic: _Topic) -> Iterator[bytes]:
        """The raw messages of a topic."""

    def close(self) -> None:
        """Release the file."""


class Ros1Reader:
    """ROS 1 bags of dvs_msgs, prophesee_event_msgs or event_camera_msgs, with images and IMU."""

    name = "ROS 1 bag"

    def recognises(self, path: Path, head: bytes) -> bool:
        """Whether it opens with the format's version line."""
        return head.startswith(_ROS1_MAGIC)

    def open(self, path: Path, options: ReadOptions) -> Source:
        """See :meth:`emseg.io.Reader.open`."""
        return _BagSource(path, options, _indexed_or_salvaged(path, "ros1"), is_cdr=False)


class Ros2Reader:
    """ROS 2 bags (one .db3 or .mcap file) of the same messages."""

    name = "ROS 2 bag (.db3, .mcap)"

    def recognises(self, path: Path, head: bytes) -> bool:
        """Whether it opens as an mcap file does, or as an SQLite database."""
        return head.startswith((_MCAP_MAGIC, _SQLITE_MAGIC))

    def open(self, path: Path, options: ReadOptions) -> Source:
        """See :meth:`emseg.io.Reader.open`."""
        with path.open("rb") as file:
            is_mcap = file.read(len(_MCAP_MAGIC)) == _MCAP_MAGIC
        bag = _indexed_or_salvaged(path, "mcap") if is_mcap else _SqliteBag(path)
        return _BagSource(path, options, bag, is_cdr=True)


class _BagSource(Source):
    def __init__(self, path: Path, options: ReadOptions, bag: _Bag, *, is_cdr: bool) -> None:
        self._path, self._bag, self._is_cdr = path, bag, is_cdr
        topics = [topic for topic in bag.topics if topic.message_type in _EVENT_TYPES]
        self.streams = tuple(topic.name for topic in topics)
        chosen = [topic for topic in topics if options.stream in (None, topic.name)]
        if not chosen:
            listed = ", ".join(f"{topic.name} ({topic.message_type})" for topic in bag.topics) or "none"
            asked = f"topic {options.stream!r} of events" if options.stream else "topic of events"
            bag.close()
            raise ReadError(path, f"holds no {asked}; its topics: {listed}")
        self._events = chosen[0]
        self.size = options.size or self._first_size()

    def blocks(self) -> Iterator[Block]:
        messages = EventMessages(self._events.message_type, is_cdr=self._is_cdr)
        shift: int | None = None
        for number, raw in enumerate(self._bag.messages(self._events)):
            place = f"{self._events.name} message {number}"
            try:
                columns, _ = messages.parse(raw)
            except ValueError as error:
                raise ReadError(self._path, str(error), place=place) from None
            t = columns.t
            if not columns.is_absolute:  # the camera's own time: put beside that of frames and IMU
                if shift is None and len(t):
                    shift = columns.stamp - int(t[0])
                t = t + (shift or 0)
            yield Block(columns.x, columns.y, t, columns.p, at(place))

    def frames(self) -> Iterator[Frame]:
        for topic in self._first(IMAGE):
            for number, raw in enumerate(self._bag.messages(topic)):
                try:
                    yield parse_image(raw, is_cdr=self._is_cdr)
                except ValueError as error:
                    place = f"{topic.name} message {number}"
                    raise ReadError(self._path, str(error), place=place) from None

    def imu(self) -> ImuSamples:
        parts = [
            parse_imu(raw, is_cdr=self._is_cdr)
            for topic in self._first(IMU)
            for raw in self._bag.messages(topic)
        ]
        return ImuSamples.concatenate(parts)

    def close(self) -> None:
        self._bag.close()

    def _first(self, message_type: str) -> Iterable[_Topic]:
        return [topic for topic in self._bag.topics if topic.message_type == message_type][:1]

    def _first_size(self) -> tuple[int, int] | None:
        """The sensor's size as the first message that can be parsed gives it."""
        with contextlib.suppress(Exception):  # whatever is wrong comes up again when events are read
            messages = EventMessages(self._events.message_type, is_cdr=self._is_cdr)
            for raw in self._bag.messages(self._events):
                return messages.parse(raw)[1]
        return None


class _IndexedBag:
    """A sound ROS 1 bag or mcap file, read by the package rosbags."""

    def __init__(self, reader: Any) -> None:
        self._reader = reader
        self._reader.open()
        by_name: dict[str, str] = {}
        for connection in reader.connections:
            by_name.setdefault(connection.topic, connection.msgtype)
        self.topics = [_Topic(name, message_type) for name, message_type in by_name.items()]

    def messages(self, topic: _Topic) -> Iterator[bytes]:
        chosen = [connection for connection in self._reader.connections if connection.topic == topic.name]
        for _, _, raw in self._reader.messages(chosen):
            yield raw

    def close(self) -> None:
        self._reader.close()


class _SalvagedBag:
    """A bag without its index, such as one that was cut off: read from the front, up to the damage."""

    def __init__(self, path: Path, kind: str, reason: str) -> None:
        self._path, self._scan, self._reason = path, scan_ros1 if kind == "ros1" else scan_mcap, reason
        by_name: dict[str, str] = {}
        with contextlib.suppress(ReadError):
            for name, message_type, _ in self._scan(path):
                by_name.setdefault(name, message_type)
        if not by_name:
            raise ReadError(path, f"truncated or damaged: {reason}")
        self.topics = [_Topic(name, message_type) for name, message_type in by_name.items()]

    def messages(self, topic: _Topic) -> Iterator[bytes]:
        for name, _, raw in self._scan(self._path):
            if name == topic.name:
                yield raw
        raise ReadError(self._path, f"truncated or damaged: {self._reason}")

    def close(self) -> None:
        pass


class _SqliteBag:
    """A ROS 2 bag in SQLite; a cut one gives its messages up to the cut, then raises."""

    def __init__(self, path: Path) -> None:
        self._path, self._damage = path, ""
        self._database = sqlite3.connect(f"{path.resolve().as_uri()}?mode=ro&immutable=1", uri=True)
        self._database.text_factory = lambda text: text.decode("utf-8", "replace")
        try:
            rows = self._read_topics()
        except sqlite3.Error as error:
            self._damage = str(error)
            try:
                # Makes SQLite take a file for what is left of it, where its header promises more.
                self._database.execute("PRAGMA writable_schema = ON")
                rows = self._read_topics()
            except sqlite3.Error:
                self._database.close()
                problem = f"damaged, or an SQLite database that is no ROS 2 bag: {self._damage}"
                raise ReadError(path, problem) from None
        self._numbers = {str(name): number for number, name, _ in rows}
        self.topics = [_Topic(str(name), str(message_type)) for _, name, message_type in rows]

    def messages(self, topic: _Topic) -> Iterator[bytes]:
        query = "SELECT data FROM messages WHERE topic_id = ? ORDER BY id"
        read = 0
        try:
            for (raw,) in self._database.execute(query, (self._numbers[topic.name],)):
                if not isinstance(raw, bytes):
                    raise ReadError(self._path, "holds no bytes", place=f"{topic.name} message {read}")
                yield raw
                read += 1
        except sqlite3.Error as error:
            self._damage = str(error)
        if self._damage:
            place = f"{topic.name} message {read}"
            raise ReadError(self._path, f"truncated or damaged: {self._damage}", place=place)

    def close(self) -> None:
        self._database.close()

    def _read_topics(self) -> list[tuple[Any, ...]]:
        return self._database.execute("SELECT id, name, type FROM topics ORDER BY id").fetchall()


def _indexed_or_salvaged(path: Path, kind: str) -> _Bag:
    """The bag by its index, or by a scan of it where the index is missing or damaged."""
    module, name = {
        "ros1": ("rosbags.rosbag1", "Reader"),
        "mcap": ("rosbags.rosbag2.storage_mcap", "McapReader"),
    }[kind]
    reader = getattr(require(module, "rosbags", "a ROS bag", path), name)
    try:
        return _IndexedBag(reader(path))
    except Exception as error:  # what damage makes of it
        lines = str(error).splitlines() or [type(error).__name__]
        _log.debug("%s: %s", path, error)
        return _SalvagedBag(path, kind, lines[0][:200])


ROS1 = Ros1Reader()
ROS2 = Ros2Reader()
