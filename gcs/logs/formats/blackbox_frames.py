"""The frames of one log of a blackbox file: where they stand, and the values that their differences add up to.

A frame begins with a letter and ends where its last field does; there is no length and no checksum. One is believed
where another begins right behind it. Where that fails, bytes are skipped until it holds again, and differences (P) are
left out until the next whole frame (I), since nobody knows what they differ from.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gcs.logs.formats import blackbox_header
from gcs.logs.formats.blackbox_encodings import read_group
from gcs.logs.formats.blackbox_header import FRAMES, Header, Layout
from gcs.logs.formats.raw import Bytes, Offsets

LONGEST = 256  # bytes of a frame
LETTERS = np.frombuffer((FRAMES + "E").encode(), np.uint8)
END = b"End of log\0"
INT32 = NDArray[np.int32]

SYNC_BEEP, ADJUSTMENT, RESUME, DISARM, FLIGHT_MODE, IMU_FAILURE = 0, 13, 14, 15, 30, 40
GOVERNOR, RESCUE, AIRBORNE, CUSTOM_DATA, CUSTOM_STRING, LOG_END = 50, 51, 52, 100, 101, 255
NUMBERS: Mapping[int, int] = {
    SYNC_BEEP: 1,
    RESUME: 2,
    DISARM: 1,
    FLIGHT_MODE: 2,
    IMU_FAILURE: 1,
    GOVERNOR: 1,
    RESCUE: 1,
    AIRBORNE: 1,
}
"""Event -> how many numbers of seven bits a byte it writes."""


@dataclass(frozen=True, eq=False)
class Event:
    """What the vehicle told in between."""

    kind: int
    numbers: tuple[int, ...]
    text: bytes
    before: int
    """How many main frames stand before it."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Chain:
    """Where the frames stand that are believed."""

    main: Offsets
    """Of I and P frames, (n,), in the file's order; the first is an I."""
    slow: Offsets
    slow_before: Offsets
    """How many main frames stand before each slow one."""
    events: tuple[Event, ...]
    skipped_bytes: int
    breaks: int
    """How often the chain was lost and found again."""
    tail_cut: bool


def chained(data: bytes, padded: Bytes, start: int, stop: int, header: Header) -> Chain:
    """The frames between two places of a file, whose bytes are `data`; `padded` holds them with `LONGEST` more."""
    ends = _ends(padded, start, stop, header).data
    main: list[int] = []
    slow: list[tuple[int, int]] = []
    events: list[Event] = []
    at, skipped, breaks = start, 0, 0
    whole = lost = False  # whether differences are known from what; whether the chain is broken
    while at < stop:
        letter = data[at]
        event: Event | None = None
        if letter == ord("E"):
            event, end = _event(data, at, stop, len(main))
        else:
            end = ends[at - start]
        if not end:
            skipped += 1
            whole, lost = False, True
            at += 1
            continue
        breaks += lost
        lost = False
        if event is not None:
            events.append(event)
            if event.kind == LOG_END:
                break
        elif letter == ord("I") or (letter == ord("P") and whole):
            main.append(at)
            whole = True
        elif letter == ord("P"):
            skipped += end - at
        elif letter == ord("S"):
            slow.append((at, len(main)))
        at = end
    places = np.array(slow, np.int64).reshape(-1, 2)
    return Chain(
        main=np.array(main, np.int64),
        slow=places[:, 0],
        slow_before=places[:, 1],
        events=tuple(events),
        skipped_bytes=skipped,
        breaks=breaks,
        tail_cut=lost,
    )


def _ends(padded: Bytes, start: int, stop: int, header: Header) -> INT32:
    """Where the frame ends that could begin at each place, (stop - start,); 0 where none can."""
    ends = np.zeros(stop - start, np.int32)
    letters = np.isin(padded[start:stop], LETTERS)
    for kind, layout in header.layouts.items():
        begins = start + np.flatnonzero(padded[start:stop] == ord(kind))
        end = begins + 1
        for encoding, count in layout.groups:
            _, end = read_group(padded, end.copy(), encoding, count)
        fits = (end <= stop) & (end - begins <= LONGEST)
        begins, end = begins[fits], end[fits]
        followed = (end == stop) | letters[np.minimum(end, stop - 1) - start]
        ends[begins[followed] - start] = end[followed]
    return ends


def _event(data: bytes, at: int, stop: int, before: int) -> tuple[Event | None, int]:
    """The event at a place and the place behind it; None and 0 where there is none."""
    kind, at = (data[at + 1], at + 2) if at + 1 < stop else (-1, at)
    numbers: list[int] = []
    text = b""
    if kind == LOG_END:
        at = at + len(END) if data[at : at + len(END)] == END else 0
    elif kind in (CUSTOM_DATA, CUSTOM_STRING) and at < stop:
        text = data[at + 1 : at + 1 + data[at]]
        at += 1 + data[at]
    elif kind == ADJUSTMENT and at < stop:
        at = at + 5 if data[at] > 127 else _number(data, at + 1, stop)[1]
    elif kind in NUMBERS:
        for _ in range(NUMBERS[kind]):
            number, at = _number(data, at, stop)
            numbers.append(number)
    else:
        return None, 0
    if not 0 < at <= stop or (kind != LOG_END and at < stop and data[at] not in LETTERS):
        return None, 0
    return Event(kind, tuple(numbers), text, before), at


def _number(data: bytes, at: int, stop: int) -> tuple[int, int]:
    """An unsigned number and the place behind it, which is behind `stop` where it does not end."""
    value = 0
    for place in range(5):
        if at >= stop:
            break
        value |= (data[at] & 0x7F) << (7 * place)
        at += 1
        if data[at - 1] < 0x80:
            return value, at
    return value, stop + 1


# ------------------------------------------------------------------------------------------------ values


def raw_values(padded: Bytes, begins: Offsets, layout: Layout) -> INT32:
    """What frames that begin at these places write, shape (n, fields)."""
    values = np.empty((begins.size, len(layout.names)), np.int32)
    at, place = begins + 1, 0
    for encoding, count in layout.groups:
        fields, at = read_group(padded, at.copy(), encoding, count)
        for field in fields:
            values[:, place] = field.astype(np.uint32).view(np.int32)
            place += 1
    return values


def main_values(padded: Bytes, chain: Chain, header: Header) -> INT32:
    """The fields of the main frames, shape (n, fields): 32 bits, whose sign is as the layout says."""
    layouts = header.layouts
    values = np.empty((chain.main.size, len(layouts["I"].names)), np.int32)
    whole = padded[chain.main] == ord("I")
    for kind, here in (("I", whole), ("P", ~whole)):
        values[here] = raw_values(padded, chain.main[here], layouts[kind])
    firsts = np.flatnonzero(whole)
    _add_constants(values, firsts, layouts["I"], header)
    lengths = np.diff(np.append(firsts, chain.main.size))
    for place in range(1, int(lengths.max(initial=0))):
        firsts, lengths = firsts[lengths > place], lengths[lengths > place]
        _add_previous(values, firsts + place, layouts["P"], header, second=place > 1)
    return values


def _columns(layout: Layout, predictor: int) -> list[int]:
    return [place for place, each in enumerate(layout.predictors) if each == predictor]


def _add_constants(values: INT32, here: Offsets, layout: Layout, header: Header) -> None:
    """What the header tells of a field, and of motors what the first has; wrapping at 32 bits."""
    minthrottle = header.number("minthrottle", 1150)
    constants = {
        blackbox_header.MINTHROTTLE: minthrottle,
        blackbox_header.CENTRE: 1500,
        blackbox_header.VBATREF: header.number("vbatref", 4095),
        blackbox_header.MINMOTOR: header.number("motorOutput", minthrottle),
    }
    with np.errstate(over="ignore"):
        for predictor, constant in constants.items():
            for column in _columns(layout, predictor):
                values[here, column] += np.int32(round(constant) & 0x7FFFFFFF)
        if "motor[0]" in layout.names:
            motor = layout.names.index("motor[0]")
            for column in _columns(layout, blackbox_header.MOTOR_0):
                if column != motor:
                    values[here, column] += values[here, motor]


def _add_previous(values: INT32, here: Offsets, layout: Layout, header: Header, *, second: bool) -> None:
    """Frames whose one before is known, and the one before that where it is `second`; wrapping at 32 bits."""
    before = values[here - 1].astype(np.int64)
    earlier = values[here - 2].astype(np.int64) if second else before
    now = values[here].astype(np.int64)
    for column in _columns(layout, blackbox_header.PREVIOUS):
        now[:, column] += before[:, column]
    for column in _columns(layout, blackbox_header.STRAIGHT_LINE):
        now[:, column] += 2 * before[:, column] - earlier[:, column]
    for column in _columns(layout, blackbox_header.AVERAGE_2):
        both = before[:, column] + earlier[:, column]
        now[:, column] += (both + (both < 0)) >> 1  # towards zero, as C divides
    for column in _columns(layout, blackbox_header.INCREMENT):
        now[:, column] = _next_logged(before[:, column], header.intervals)
    values[here] = now.astype(np.uint32).view(np.int32)
    _add_constants(values, here, layout, header)


def _next_logged(loop: NDArray[np.int64], intervals: Sequence[int]) -> NDArray[np.int64]:
    """The next loop that is logged: of every so many, those whose number mod `of` is among the first n."""
    every, n, of = intervals
    behind = loop % every + 1
    phase = (behind + n - 1) % of
    return np.asarray(loop - loop % every + np.minimum(np.where(phase < n, behind, behind + of - phase), every))
