"""Formats that are known by sight but are not read, so that the error can say so and what to do."""

from __future__ import annotations

from typing import Final

__all__ = ["describe"]

_UNPACK: Final = "compressed data: unpack it first"

_MAGIC: Final[tuple[tuple[bytes, str], ...]] = (
    (b"#!AER-DAT1", "AEDAT 1, which is not supported: jAER converts it to AEDAT 2"),
    (b"\x1f\x8b", f"gzip-{_UNPACK}"),
    (b"BZh", f"bzip2-{_UNPACK}"),
    (b"\xfd7zXZ\0", f"xz-{_UNPACK}"),
    (b"\x28\xb5\x2f\xfd", f"zstd-{_UNPACK}"),
    (b"\x04\x22\x4d\x18", f"lz4-{_UNPACK}"),
    (b"7z\xbc\xaf\x27\x1c", "a 7z archive: unpack it first"),
)


def describe(head: bytes) -> str | None:
    """The name of an unsupported format by a file's first bytes and what to do about it, or None."""
    return next((name for magic, name in _MAGIC if head.startswith(magic)), None)
