"""The text at the head of each log of a blackbox file: which fields its frames have, and how the vehicle was set up.

A file holds one log after the other, as a rule one for each arming. Every log begins with lines `H name:value`.
"""

from __future__ import annotations

import math
import re
import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from gcs.errors import TippathError
from gcs.logs.formats import blackbox_encodings as encodings

MARK = b"H Product:Blackbox flight data recorder"
FRAMES = "IPSGH"
"""Kinds of frame with fields: main ones whole (I) and as differences (P), slow (S), GPS (G) and its home (H)."""
PREVIOUS, STRAIGHT_LINE, AVERAGE_2, MINTHROTTLE, MOTOR_0, INCREMENT = 1, 2, 3, 4, 5, 6
HOME, CENTRE, VBATREF, LAST_TIME, MINMOTOR = 7, 8, 9, 10, 11
PREDICTORS = range(MINMOTOR + 1)
MOST_LOOPS = 1 << 20  # between frames

_LINE = re.compile(rb"H ([^:\n\r]{1,80}):([^\n\r]{0,4000})\r?\n")
_FIELD = re.compile(r"Field ([A-Z]) (name|signed|predictor|encoding)")


@dataclass(frozen=True)
class Layout:
    """The fields of a kind of frame."""

    names: tuple[str, ...]
    signed: tuple[bool, ...]
    predictors: tuple[int, ...]
    groups: tuple[tuple[int, int], ...]
    """Encoding and number of fields, in the frame's order."""


@dataclass(frozen=True)
class Header:
    """What stands before the frames."""

    layouts: Mapping[str, Layout]
    """Kind of frame -> its fields; I and P are always there."""
    settings: Mapping[str, str]
    """Name -> value, as written; the last where one is there twice."""
    size: int
    """Bytes."""

    def number(self, name: str, otherwise: float = 0.0) -> float:
        """A setting, the first of several between commas."""
        try:
            value = float(self.settings.get(name, "").split(",")[0])
        except ValueError:
            return otherwise
        return value if math.isfinite(value) else otherwise

    @property
    def gyro_scale(self) -> float:
        """To deg/s: four bytes of a float in hexadecimal, as the vehicle writes it."""
        text = self.settings.get("gyro_scale", self.settings.get("gyro.scale", ""))
        try:
            (scale,) = struct.unpack(">f", bytes.fromhex(text.removeprefix("0x").rjust(8, "0")))
        except (ValueError, struct.error):
            return 1.0
        return float(scale) if 0 < scale < 1e3 else 1.0

    @property
    def intervals(self) -> tuple[int, int, int]:
        """I frames every so many loops; of loops in between n of so many are logged: (every, n, of)."""
        part, slash, of = self.settings.get("P interval", "1/1").partition("/")
        try:
            n, of_loops = (int(part), int(of)) if slash else (1, int(part))
        except ValueError:
            n, of_loops = 1, 1
        every = round(min(max(1, self.number("I interval", 32)), MOST_LOOPS))
        return every, min(max(1, n), MOST_LOOPS), min(max(1, of_loops), MOST_LOOPS)


def parse(data: bytes, where: str) -> Header:
    """The header at the beginning of a log. Raises TippathError where its frames cannot be read by it."""
    written: dict[tuple[str, str], list[str]] = {}
    settings: dict[str, str] = {}
    at = 0
    while (match := _LINE.match(data, at)) is not None:
        name, value = (part.decode("utf-8", "replace").strip() for part in match.groups())
        field = _FIELD.fullmatch(name)
        if field is not None:
            written[field[1], field[2]] = value.split(",")
        else:
            settings[name] = value
        at = match.end()
    try:
        layouts = {kind: _layout(kind, written) for kind in FRAMES if (kind, "encoding") in written}
        if not {"I", "P"} <= set(layouts):
            raise ValueError("it does not say which fields its frames have")
    except ValueError as error:
        raise TippathError(
            f"{where}: the header of this log cannot be used ({error}); take the file from the vehicle again, or "
            "decode it with blackbox_decode and name the CSV"
        ) from error
    if settings.get("Data version", "2") != "2":
        raise TippathError(
            f"{where}: a blackbox log of data version {settings['Data version'][:8]}, which is not read: decode it "
            "with blackbox_decode and name the CSV"
        )
    return Header(layouts, settings, at)


def _layout(kind: str, written: Mapping[tuple[str, str], Sequence[str]]) -> Layout:
    """Differences have the names and signs of the whole frames. Raises ValueError."""
    whole = "I" if kind == "P" else kind
    names = tuple(written.get((whole, "name"), ()))
    signs = tuple(int(text) != 0 for text in written.get((whole, "signed"), ()))
    predictors = tuple(int(text) for text in written.get((kind, "predictor"), ()))
    encoded = [int(text) for text in written[kind, "encoding"]]
    if not names or not len(names) == len(signs) == len(predictors) == len(encoded):
        raise ValueError(f"fields of its {kind} frames are cut")
    if kind in "IP" and "time" not in names:
        raise ValueError("it logs no time")
    unknown = [number for number in predictors if number not in PREDICTORS]
    if unknown:
        raise ValueError(f"predictor {unknown[0]}")
    # what always counts up is never written, whatever the encoding says
    silent = [
        encodings.NULL if predictor == INCREMENT else number
        for number, predictor in zip(encoded, predictors, strict=True)
    ]
    return Layout(names, signs, predictors, tuple(encodings.groups(silent)))
