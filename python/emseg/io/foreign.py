"""Formats that are known by sight but cannot be read yet, so that the error can say so."""

from __future__ import annotations

import re
from typing import Final

__all__ = ["describe"]

_MAGIC: Final[tuple[tuple[bytes, str], ...]] = (
    (b"#!AER-DAT1", "AEDAT 1"),
    (b"#!AER-DAT2", "AEDAT 2"),
    (b"#!AER-DAT3", "AEDAT 3"),
    (b"#ROSBAG V", "a ROS 1 bag"),
    (b"SQLite format 3\0", "a ROS 2 bag (SQLite database)"),
    (b"\x89MCAP", "a ROS 2 bag (mcap)"),
    (b"\x89HDF\r\n\x1a\n", "HDF5"),
    (b"MATLAB 5.0 MAT-file", "a MATLAB file"),
    (b"MATLAB 7.3 MAT-file", "a MATLAB file (HDF5)"),
    (b"Event Stream", "an ES event stream"),
    (b"\x1f\x8b", "gzip-compressed data"),
    (b"BZh", "bzip2-compressed data"),
    (b"\xfd7zXZ\0", "xz-compressed data"),
    (b"\x28\xb5\x2f\xfd", "zstd-compressed data"),
    (b"\x04\x22\x4d\x18", "lz4-compressed data"),
    (b"7z\xbc\xaf\x27\x1c", "a 7z archive"),
)

# Prophesee's files open with lines "% key value"; so may text files, but not with these keys.
_PROPHESEE_KEY: Final = re.compile(
    rb"^% *(?:evt|format|version|geometry|height|width|firmware_version|integrator_name|plugin_name"
    rb"|serial_number|system_id|camera_integrator_name)\b *([^\r\n]*)",
    re.IGNORECASE | re.MULTILINE,
)


def describe(head: bytes) -> str | None:
    """The name of an unsupported format by a file's first bytes, or None."""
    for magic, name in _MAGIC:
        if head.startswith(magic):
            return name
    if not head.startswith(b"%"):
        return None
    keys = {match[0].split()[1].lower(): match[1].strip() for match in _PROPHESEE_KEY.finditer(head)}
    if not keys:
        return None
    encoding = keys.get(b"format", b"").decode("ascii", "replace").partition(";")[0]
    if encoding:
        return f"Prophesee RAW ({encoding})"
    if b"evt" in keys:
        return f"Prophesee RAW (EVT{keys[b'evt'].decode('ascii', 'replace').partition('.')[0]})"
    return "Prophesee DAT" if keys.keys() <= {b"version", b"height", b"width"} else "Prophesee RAW"
