"""Recordings of every format, made byte by byte from their specifications: what the readers must give."""

from __future__ import annotations

import struct
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from emseg.events import EventArray

WIDTH, HEIGHT = 346, 260


def made_events(n: int = 400, seed: int = 0) -> EventArray:
    rng = np.random.default_rng(seed)
    t = 1_000_000 + np.cumsum(rng.integers(0, 400, n))
    x, y, p = rng.integers(0, WIDTH, n), rng.integers(0, HEIGHT, n), rng.integers(0, 2, n)
    return EventArray(x, y, t, p, width=WIDTH, height=HEIGHT)


def columns(events: EventArray) -> dict[str, np.ndarray]:
    return {name: getattr(events, name) for name in "xytp"}


# Prophesee


def evt2(events: EventArray, origin: int = 0) -> bytes:
    """The stream, whose first time has the high part of `origin`."""
    words, high = [0x80000000 | origin >> 6], origin >> 6
    for x, y, t, p in zip(*columns(events).values(), strict=True):
        if int(t) >> 6 != high:
            high = int(t) >> 6
            words.append(0x80000000 | high & 0xFFFFFFF)
        words.append(int(p) << 28 | (int(t) & 63) << 22 | int(x) << 11 | int(y))
    return np.array(words, "<u4").tobytes()


def evt21(events: EventArray, origin: int = 0, *, swapped: bool = False) -> bytes:
    """As EVT 2, with neighbours in a row of one time and polarity in one word."""
    words, high = [0x80000000 << 32 | (origin >> 6) << 32], origin >> 6
    for x, y, t, p in zip(*columns(events).values(), strict=True):
        if int(t) >> 6 != high:
            high = int(t) >> 6
            words.append(0x80000000 << 32 | (high & 0xFFFFFFF) << 32)
        head = int(p) << 28 | (int(t) & 63) << 22 | (int(x) & ~31) << 11 | int(y)
        words.append(head << 32 | 1 << (int(x) & 31))
    array = np.array(words, "<u8")
    return (array << np.uint64(32) | array >> np.uint64(32) if swapped else array).tobytes()


def evt3(events: EventArray) -> bytes:
    """Single events and, by turns, vectors of one event."""
    words: list[int] = []
    high = low = row = -1
    for k, (x, y, t, p) in enumerate(zip(*columns(events).values(), strict=True)):
        if int(t) >> 12 != high:
            high, low = int(t) >> 12, -1
            words.append(0x8000 | high & 0xFFF)
        if int(t) & 0xFFF != low:
            low = int(t) & 0xFFF
            words.append(0x6000 | low)
        if int(y) != row:
            row = int(y)
            words.append(row)
        match k % 3:
            case 0:
                words.append(0x2000 | int(p) << 11 | int(x))
            case 1:
                base = max(0, int(x) - 11)
                words += [0x3000 | int(p) << 11 | base, 0x4000 | 1 << (int(x) - base)]
            case 2:
                base = max(0, int(x) - 7)
                words += [0x3000 | int(p) << 11 | base, 0x5000 | 1 << (int(x) - base)]
    return np.array(words, "<u2").tobytes()


def raw_header(version: str, form: str | None = None) -> bytes:
    lines = ["% date 2026-01-01 00:00:00", f"% evt {version}", f"% geometry {WIDTH}x{HEIGHT}"]
    return "\n".join([*lines, *([f"% format {form}"] if form else []), "% end", ""]).encode()


def dat(events: EventArray) -> bytes:
    address = events.x.astype(np.uint32) | events.y.astype(np.uint32) << 14 | events.p.astype(np.uint32) << 28
    records = np.stack([events.t.astype(np.uint32), address], axis=1).astype("<u4")
    header = f"% Data file containing CD events\n% Version 2\n% Width {WIDTH}\n% Height {HEIGHT}\n"
    return header.encode() + b"\x0c\x08" + records.tobytes()


# AEDAT


def aedat2(events: EventArray) -> bytes:
    """A DAVIS346's, with the IMU's seven words before every hundredth event."""
    address = (
        events.x.astype(np.uint32) << 12
        | (HEIGHT - 1 - events.y).astype(np.uint32) << 22
        | events.p.astype(np.uint32) << 11
    )
    records = []
    times = events.t.astype(np.uint32).tolist()
    for k, (word, t) in enumerate(zip(address.tolist(), times, strict=True)):
        if k % 100 == 0:
            values = (4096, 0, -4096 & 0xFFFF, 0, 16384, -16384 & 0xFFFF, 0)  # g, °C, 500 °/s
            records += [(0x80000C00 | code << 28 | value << 12, t) for code, value in enumerate(values)]
        records.append((word, t))
    header = b"#!AER-DAT2.0\r\n# AEChip: eu.seebetter.ini.chips.davis.Davis346blue\r\n"
    return header + np.array(records, ">u4").tobytes()


def aedat3(events: EventArray) -> bytes:
    """Packets of 150 events, of which one is marked invalid; an IMU sample and a frame between them."""
    body = b""
    for start in range(0, len(events), 150):
        part = events[start : start + 150]
        data = (
            part.x.astype(np.uint32) << 17 | part.y.astype(np.uint32) << 2 | part.p.astype(np.uint32) << 1 | 1
        )
        records = np.stack([data, part.t.astype(np.uint32)], axis=1)
        records = np.concatenate([records, [[2, 5]]])  # not valid
        body += struct.pack("<hhiiiiii", 1, 1, 8, 4, 0, 256, len(records), len(part))
        body += records.astype("<u4").tobytes()
        t = int(part.t[0])
        body += struct.pack("<hhiiiiii", 3, 1, 36, 4, 0, 1, 1, 1)
        body += struct.pack("<Ii7f", 1, t, 1, 0, -1, 180, 0, -180, 20)
        image = np.arange(6, dtype="<u2") << 8
        body += struct.pack("<hhiiiiii", 2, 1, 48, 12, 0, 1, 1, 1)
        body += struct.pack("<Iiiiiiiii", 1 | 1 << 1, t, t + 9, t + 4, t + 5, 3, 2, 0, 0) + image.tobytes()
    return b"#!AER-DAT3.1\r\n#Format: RAW\r\n#Source 1: DAVIS346\r\n#!END-HEADER\r\n" + body


def write_aedat4(path: Path, events: EventArray, compression: str = "LZ4") -> None:
    import dv_processing as dv

    config = dv.io.MonoCameraWriter.EventOnlyConfig(
        "made", (WIDTH, HEIGHT), getattr(dv.CompressionType, compression)
    )
    writer = dv.io.MonoCameraWriter(str(path), config)
    for start in range(0, len(events), 100):
        part = events[start : start + 100]
        args = (part.t.tolist(), part.x.tolist(), part.y.tolist(), part.p.astype(bool).tolist())
        writer.writeEventPacket(dv.EventPacket(dv.EventPacket.EventVector(map(dv.Event, *args))))
    del writer


# ROS messages


class Message:
    """Bytes of a message, packed as ROS 1 does or aligned as ROS 2 does."""

    def __init__(self, *, cdr: bool) -> None:
        self.cdr, self.data = cdr, b""

    def add(self, form: str, *values: Any) -> Message:
        for value in values:
            size = struct.calcsize("<" + form)
            self.data += bytes(-len(self.data) % size) if self.cdr else b""
            self.data += struct.pack("<" + form, value)
        return self

    def text(self, text: str) -> Message:
        raw = text.encode() + (b"\0" if self.cdr else b"")
        self.add("I", len(raw)).data += raw
        return self

    def array(self, raw: bytes) -> Message:
        self.add("I", len(raw)).data += raw
        return self

    def header(self, t: int) -> Message:
        if not self.cdr:
            self.add("I", 0)
        return self.add("I", t // 1_000_000, t % 1_000_000 * 1000).text("camera")

    def done(self) -> bytes:
        return (b"\0\1\0\0" if self.cdr else b"") + self.data


def event_array(events: EventArray, *, cdr: bool) -> bytes:
    message = Message(cdr=cdr).header(int(events.t[0])).add("I", HEIGHT, WIDTH, len(events))
    for x, y, t, p in zip(*columns(events).values(), strict=True):
        message.add("H", x, y).add("I", int(t) // 1_000_000, int(t) % 1_000_000 * 1000).add("B", p)
    return message.done()


def event_packet(events: EventArray, encoding: str, *, cdr: bool) -> bytes:
    base = int(events.t[0])
    payload, time_base = PAYLOADS[encoding](events, base)
    message = Message(cdr=cdr).header(base).add("I", HEIGHT, WIDTH).add("Q", 0, time_base)
    return message.text(encoding).add("B", 0).array(payload).done()


def _mono(events: EventArray, base: int) -> tuple[bytes, int]:
    word = (events.t - base).astype(np.uint64) * np.uint64(1000)
    for column, shift in ((events.x, 32), (events.y, 48), (events.p, 63)):
        word |= column.astype(np.uint64) << np.uint64(shift)
    return word.astype("<u8").tobytes(), base * 1000


def _libcaer(events: EventArray, base: int) -> tuple[bytes, int]:
    data = events.x.astype(np.uint32) << 17 | events.y.astype(np.uint32) << 2
    data |= events.p.astype(np.uint32) << 1 | 1
    return np.stack([data, events.t - base], axis=1).astype("<u4").tobytes(), base * 1000


def _libcaer_cmp(events: EventArray, base: int) -> tuple[bytes, int]:
    words: list[int] = []
    high = low = column = -1
    for k, (x, y, t, p) in enumerate(zip(*columns(events).values(), strict=True)):
        if int(t) - base >> 12 != high:
            high = int(t) - base >> 12
            words.append(high)
        if int(t) - base & 0xFFF != low:
            low = int(t) - base & 0xFFF
            words.append(0x1000 | low)
        if int(x) != column:
            column = int(x)
            words.append(0x2000 | column)
        if k % 2:
            words.append(0x3000 | int(p) << 11 | int(y))
        else:
            start = max(0, int(y) - 7)
            words += [0x4000 | int(p) << 11 | start, 0x5000 | 1 << (int(y) - start)]
    return np.array(words, "<u2").tobytes(), base * 1000


PAYLOADS: dict[str, Callable[[EventArray, int], tuple[bytes, int]]] = {
    "evt3": lambda events, base: (evt3(events), 0),
    "mono": _mono,
    "libcaer": _libcaer,
    "libcaer_cmp": _libcaer_cmp,
}

DEFINITIONS = {
    "dvs_msgs/msg/EventArray": """std_msgs/Header header
uint32 height
uint32 width
dvs_msgs/Event[] events
""",
    "dvs_msgs/msg/Event": "uint16 x\nuint16 y\ntime ts\nbool polarity\n",
    "event_camera_msgs/msg/EventPacket": """std_msgs/Header header
uint32 height
uint32 width
uint64 seq
uint64 time_base
string encoding
bool is_bigendian
uint8[] events
""",
}
DEFINITIONS["prophesee_event_msgs/msg/EventArray"] = DEFINITIONS["dvs_msgs/msg/EventArray"].replace(
    "dvs_msgs", "prophesee_event_msgs"
)
DEFINITIONS["prophesee_event_msgs/msg/Event"] = DEFINITIONS["dvs_msgs/msg/Event"]


def imu_message(t: int, *, cdr: bool) -> bytes:
    message = Message(cdr=cdr).header(t).add("d", 0, 0, 0, 1, *[0] * 9)
    return message.add("d", 0.1, 0.2, 0.3, *[0] * 9, 1, 2, 3, *[0] * 9).done()


def image_message(t: int, *, cdr: bool) -> bytes:
    message = Message(cdr=cdr).header(t).add("I", 2, 3).text("mono8").add("B", 0).add("I", 4)
    return message.array(bytes([0, 1, 2, 99, 3, 4, 5, 99])).done()


def write_bag(
    path: Path, events: EventArray, message_type: str, encoding: str = "evt3", *, parts: int = 4
) -> None:
    """A ROS 1 bag (.bag), or a ROS 2 bag (.db3, .mcap), with IMU and images beside the events."""
    is_ros1 = path.suffix == ".bag"
    cdr = not is_ros1
    pieces = [events[k * len(events) // parts : (k + 1) * len(events) // parts] for k in range(parts)]
    messages = [
        (
            int(piece.t[0]),
            event_array(piece, cdr=cdr)
            if message_type.endswith("EventArray")
            else event_packet(piece, encoding, cdr=cdr),
        )
        for piece in pieces
    ]
    store = _store(is_ros1=is_ros1)
    writer, target = _bag_writer(path, is_ros1=is_ros1)
    with writer:
        topics = {
            "/events": message_type,
            "/imu": "sensor_msgs/msg/Imu",
            "/image": "sensor_msgs/msg/Image",
        }
        to = {topic: writer.add_connection(topic, kind, typestore=store) for topic, kind in topics.items()}
        for t, raw in messages:
            writer.write(to["/events"], t * 1000, raw)
            writer.write(to["/imu"], t * 1000, imu_message(t, cdr=cdr))
            writer.write(to["/image"], t * 1000, image_message(t, cdr=cdr))
    if target != path:
        next(target.glob(f"*{path.suffix}")).replace(path)


def _bag_writer(path: Path, *, is_ros1: bool) -> tuple[Any, Path]:
    if is_ros1:
        from rosbags.rosbag1 import Writer as Writer1

        return Writer1(path), path
    from rosbags.rosbag2 import StoragePlugin, Writer

    folder = path.with_name(f"{path.name}_bag")
    plugin = StoragePlugin.MCAP if path.suffix == ".mcap" else StoragePlugin.SQLITE3
    return Writer(folder, version=9, storage_plugin=plugin), folder


def _store(*, is_ros1: bool) -> Any:
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC if is_ros1 else Stores.ROS2_HUMBLE)
    for name, definition in DEFINITIONS.items():
        text = definition if is_ros1 else definition.replace("time ts", "builtin_interfaces/Time ts")
        store.register(get_types_from_msg(text, name))
    return store


# Everything else


def es(events: EventArray) -> bytes:
    data = b"Event Stream" + struct.pack("<4B2H", 2, 0, 0, 1, WIDTH, HEIGHT)
    last = 0
    for x, y, t, p in zip(*columns(events).values(), strict=True):
        overflows, rest = divmod(int(t) - last, 127)
        data += b"\xff" * overflows + struct.pack("<B2H", rest << 1 | int(p), x, y)
        last = int(t)
    return data


def write_hdf5(path: Path, events: EventArray, layout: str) -> None:
    import h5py

    with h5py.File(path, "w") as file:
        t, x, y, p = events.t, events.x, events.y, events.p
        match layout:
            case "dsec":
                import hdf5plugin

                for name, column in (("t", t - 1_000_000), ("x", x), ("y", y), ("p", p)):
                    file.create_dataset(f"events/{name}", data=column, **hdf5plugin.Blosc(cname="zstd"))
                file["t_offset"] = 1_000_000
                file["ms_to_idx"] = np.zeros(3, np.uint64)
            case "mvsec":
                table = np.stack([x, y, t / 1e6, 2.0 * p - 1], axis=1)
                for side in ("left", "right"):
                    file[f"davis/{side}/events"] = table
                    file[f"davis/{side}/image_raw"] = np.zeros((2, HEIGHT, WIDTH), np.uint8)
                    file[f"davis/{side}/image_raw_ts"] = [1.0, 1.05]
                    file[f"davis/{side}/imu"] = np.tile([1.0, 2, 3, 0.1, 0.2, 0.3], (5, 1))
                    file[f"davis/{side}/imu_ts"] = np.linspace(1, 1.1, 5)
            case "evimo2":
                file["events/t"], file["events/p"] = t / 1e6, p
                file["events/xy"] = np.stack([x, y], axis=1)
            case "rpg":
                for name, column in (("ts", t / 1e6), ("xs", x), ("ys", y), ("ps", p > 0)):
                    file[f"events/{name}"] = column
                file.attrs["sensor_resolution"] = (HEIGHT, WIDTH)
            case "prophesee":
                records = events.to_structured()
                file["CD/events"] = records
                file["CD"].attrs["geometry"] = np.bytes_(f"{WIDTH}x{HEIGHT}")
            case "matlab":
                for name, column in (("ts", t), ("x", x), ("y", y), ("pol", p)):
                    file[name] = column.astype(np.float64)[None]


def write_matlab(path: Path, events: EventArray, layout: str) -> None:
    import scipy.io

    t, x, y, p = events.t, events.x, events.y, events.p
    match layout:
        case "variables":
            content: dict[str, Any] = {"ts": t.astype(np.uint32), "x": x, "y": y, "pol": p}
            content = {name: column[:, None] for name, column in content.items()}
        case "table":
            content = {"events": np.stack([t / 1e6, x, y, 2.0 * p - 1], axis=1)}
        case "aedat":  # what AedatTools exports, as DVSMOTION20 has it
            polarity = {"timeStamp": t.astype(np.float64), "x": x, "y": y, "polarity": p.astype(bool)}
            gyro = {name: np.full(3, 180.0) for name in ("gyroX", "gyroY", "gyroZ")}
            accel = {name: np.full(3, 1.0) for name in ("accelX", "accelY", "accelZ")}
            samples = np.empty(2, object)
            samples[:] = [np.zeros((2, 3), np.uint8), np.ones((2, 3), np.uint8)]
            data = {
                "polarity": polarity,
                "imu6": {"timeStamp": t[:3].astype(np.float64), **gyro, **accel},
                "frame": {"samples": samples, "timeStampEnd": t[:2].astype(np.float64)},
            }
            content = {"aedat": {"data": data, "info": {"source": "Davis346"}}}
    scipy.io.savemat(path, content, do_compression=layout == "aedat")


def write_text(path: Path, events: EventArray, header: str = "", form: str = "%d %d %d %d") -> None:
    rows = np.stack([events.t, events.x, events.y, events.p], axis=1)
    np.savetxt(path, rows, fmt=form, header=header, comments="")


Writer = Callable[[Path, EventArray], None]


def _bytes(make: Callable[[EventArray], bytes]) -> Writer:
    def write(path: Path, events: EventArray) -> None:
        path.write_bytes(make(events))

    return write


def _npz(path: Path, events: EventArray) -> None:
    np.savez_compressed(path, allow_pickle=False, **columns(events), width=WIDTH, height=HEIGHT)


def _bag(message_type: str, encoding: str = "") -> Writer:
    return lambda path, events: write_bag(path, events, message_type, encoding)


PACKET = "event_camera_msgs/msg/EventPacket"
MADE: dict[str, tuple[str, Writer, tuple[str, ...]]] = {
    "evt2": (".raw", _bytes(lambda e: raw_header("2.0") + evt2(e)), ()),
    "evt21": (".raw", _bytes(lambda e: raw_header("2.1", "EVT21;endianness=little") + evt21(e)), ()),
    "evt21 swapped": (".raw", _bytes(lambda e: raw_header("2.1") + evt21(e, swapped=True)), ()),
    "evt3": (
        ".raw",
        _bytes(lambda e: raw_header("3.0", f"EVT3;height={HEIGHT};width={WIDTH}") + evt3(e)),
        (),
    ),
    "dat": (".dat", _bytes(dat), ()),
    "aedat2": (".aedat", _bytes(aedat2), ()),
    "aedat3": (".aedat", _bytes(aedat3), ()),
    "aedat4": (".aedat4", write_aedat4, ("dv_processing", "lz4")),
    "aedat4 plain": (".aedat4", lambda p, e: write_aedat4(p, e, "NONE"), ("dv_processing",)),
    "aedat4 zstd": (".aedat4", lambda p, e: write_aedat4(p, e, "ZSTD"), ("dv_processing", "backports.zstd")),
    "ros1 dvs": (".bag", _bag("dvs_msgs/msg/EventArray"), ("rosbags",)),
    "ros1 prophesee": (".bag", _bag("prophesee_event_msgs/msg/EventArray"), ("rosbags",)),
    "ros1 evt3": (".bag", _bag(PACKET, "evt3"), ("rosbags",)),
    "db3 dvs": (".db3", _bag("dvs_msgs/msg/EventArray"), ("rosbags",)),
    "db3 evt3": (".db3", _bag(PACKET, "evt3"), ("rosbags",)),
    "db3 libcaer": (".db3", _bag(PACKET, "libcaer"), ("rosbags",)),
    "mcap dvs": (".mcap", _bag("dvs_msgs/msg/EventArray"), ("rosbags",)),
    "mcap mono": (".mcap", _bag(PACKET, "mono"), ("rosbags",)),
    "mcap libcaer_cmp": (".mcap", _bag(PACKET, "libcaer_cmp"), ("rosbags",)),
    **{
        f"hdf5 {layout}": (
            ".h5",
            lambda p, e, layout=layout: write_hdf5(p, e, layout),
            ("h5py", "hdf5plugin"),
        )
        for layout in ("dsec", "mvsec", "evimo2", "rpg", "prophesee", "matlab")
    },
    **{
        f"mat {layout}": (".mat", partial(write_matlab, layout=layout), ())
        for layout in ("variables", "table", "aedat")
    },
    "es": (".es", _bytes(es), ()),
    "npz": (".npz", _npz, ()),
    "npy": (".npy", lambda p, e: np.save(p, e.to_structured()), ()),
    "text": (".txt", lambda p, e: write_text(p, e, f"{WIDTH} {HEIGHT}"), ()),
    "csv": (".csv", lambda p, e: write_text(p, e, f"{WIDTH},{HEIGHT}\nt,x,y,p", "%d,%d,%d,%d"), ()),
}
"""By name: suffix, what writes it, and the modules that writing or reading it needs."""
