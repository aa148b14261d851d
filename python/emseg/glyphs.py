"""Small letters for captions, so that pictures need no font and look the same everywhere."""

from __future__ import annotations

from typing import Final

import numpy as np
import numpy.typing as npt

__all__ = ["GLYPH_HEIGHT", "GLYPH_WIDTH", "text_mask"]

GLYPH_WIDTH: Final = 5
GLYPH_HEIGHT: Final = 7

# Seven rows a letter, five bits a row, the left pixel first.
_ROWS: Final = {
    " ": "00000000000000",
    "a": "00000e010f110f",
    "b": "10101e1111111e",
    "c": "00000e1010110e",
    "d": "01010f1111110f",
    "e": "00000e111f100e",
    "f": "0609081c080808",
    "g": "00000f110f010e",
    "h": "10101619111111",
    "i": "04000c0404040e",
    "j": "0200060202120c",
    "k": "10101214181412",
    "l": "0c04040404040e",
    "m": "00001a15151111",
    "n": "00001619111111",
    "o": "00000e1111110e",
    "p": "00001e111e1010",
    "q": "00000d130f0101",
    "r": "00001619101010",
    "s": "00000e100e011e",
    "t": "08081c08080906",
    "u": "0000111111130d",
    "v": "00001111110a04",
    "w": "0000111115150a",
    "x": "0000110a040a11",
    "y": "000011110f010e",
    "z": "00001f0204081f",
    "0": "0e11131519110e",
    "1": "040c040404040e",
    "2": "0e11010204081f",
    "3": "1f02040201110e",
    "4": "02060a121f0202",
    "5": "1f101e0101110e",
    "6": "0608101e11110e",
    "7": "1f010204080808",
    "8": "0e11110e11110e",
    "9": "0e11110f01020c",
    ".": "00000000000c0c",
    ",": "000000000c0408",
    ":": "000c0c000c0c00",
    "-": "0000001f000000",
    "+": "0004041f040400",
    "=": "00001f001f0000",
    "/": "00010204081000",
    "#": "0a0a1f0a1f0a0a",
    "(": "02040808080402",
    ")": "08040202020408",
    "%": "18190204081303",
    "_": "0000000000001f",
    "|": "04040404040404",
    "×": "00110a040a1100",
}
_UNKNOWN: Final = "1f11111111111f"


def _glyph(letter: str) -> npt.NDArray[np.bool_]:
    rows = bytes.fromhex(_ROWS.get(letter.lower(), _UNKNOWN))
    bits = np.unpackbits(np.frombuffer(rows, np.uint8)[:, None], axis=1)
    return bits[:, -GLYPH_WIDTH:].astype(bool)


def text_mask(text: str, scale: int = 1) -> npt.NDArray[np.bool_]:
    """Where a line of text is inked: (7 scale, (6 n - 1) scale), all in small letters."""
    mask = np.zeros((GLYPH_HEIGHT, max(0, (GLYPH_WIDTH + 1) * len(text) - 1)), dtype=bool)
    for k, letter in enumerate(text):
        left = (GLYPH_WIDTH + 1) * k
        mask[:, left : left + GLYPH_WIDTH] = _glyph(letter)
    return mask.repeat(scale, axis=0).repeat(scale, axis=1)
