"""A blackbox log as named series, wherever its samples were decoded.

Fields keep the names of the header (`gyroADC[0]`); rates are in deg/s and accelerations in g, as the header scales
them. Worked out of them are `axisSum[0]` to `[2]`, what the controller asks of the mixer, and `chirp.*` where the log
was flown with Betaflight's or INAV's chirp (`gcs.logs.formats.blackbox_chirp`).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from gcs.logs.formats.blackbox_chirp import chirp_columns
from gcs.logs.formats.blackbox_header import Header
from gcs.logs.formats.columns import Column, ColumnLog
from gcs.logs.formats.tables import FloatArray
from sysid.data.airframe import Airframe

MAIN = "blackbox"
"""The clock of what is logged in every frame."""
TERMS = "PIDFSBO"
"""Of axisP, axisI and so on, whose sum goes to the mixer."""
IN_TENTHS = ("gyroADC", "gyroUnfilt", "setpoint", "rcCommand")
"""Ten times as fine with the header's blackbox_high_resolution."""
SHORTEST_LOOP_US, LONGEST_LOOP_US = 30, 20_000
GYROS = ("gyroADC", "gyroUnfilt", "gyroRAW")
ACCELEROMETERS = ("accSmooth", "accADC")


@dataclass(frozen=True, eq=False, kw_only=True)
class BlackboxLog(ColumnLog):
    """One log of a file."""

    header: Header

    @property
    def loop_rate_hz(self) -> float | None:
        """How often the controller gave a command; None where the header does not say."""
        loop_us = self.header.number("looptime") * self.header.number("pid_process_denom", 1.0)
        return 1e6 / loop_us if SHORTEST_LOOP_US <= loop_us <= LONGEST_LOOP_US else None

    @property
    def airframe(self) -> Airframe | None:
        """By what is logged: a rotor's speed, or more motors than two."""
        if self.has("headspeed"):
            return Airframe.HELICOPTER
        return Airframe.MULTIROTOR if self.has("motor[2]") else None


def blackbox_log(
    path: str,
    header: Header,
    t: FloatArray,
    stored: Mapping[str, Column],
    *,
    slow: tuple[str, FloatArray, Mapping[str, Column]] | None = None,
    said: Sequence[tuple[float, str]] = (),
    entered: Sequence[tuple[float, int]] = (),
    left_out: int = 0,
) -> BlackboxLog:
    """A log of the main frames' fields at t, shape (n,), as the header scales them; `slow` has a clock of its own."""
    columns = dict(stored)
    columns |= {name: Column(MAIN, summed) for name, summed in _axis_sums(columns, header)}
    columns |= {name: Column(MAIN, made) for name, made in chirp_columns(columns, header, t).items()}
    clocks = {MAIN: t}
    if slow is not None:
        clocks[slow[0]] = slow[1]
        columns |= slow[2]
    return BlackboxLog(
        path=path,
        kind="blackbox",
        clocks=clocks,
        columns=columns,
        said=said,
        entered=entered,
        dropped={MAIN: left_out} if left_out else {},
        header=header,
    )


def scale_of(name: str, header: Header) -> float:
    """By which a field's numbers become deg/s, g, or what they are of; not a number where the header does not say."""
    kind = name.partition("[")[0]
    fine = 0.1 if header.number("blackbox_high_resolution") and kind in IN_TENTHS else 1.0
    if name == "setpoint[3]":
        return 1.0  # the throttle
    if kind in GYROS:
        return fine * header.gyro_scale
    if kind in ACCELEROMETERS:
        return 1 / (header.number("acc_1G") or math.nan)
    return fine


def _axis_sums(columns: Mapping[str, Column], header: Header) -> Iterator[tuple[str, FloatArray]]:
    """`axisSum[0]` and the others: all terms together, limited as the mixer limits them; their units are the log's."""
    for place in "012":
        if f"axisP[{place}]" not in columns:
            continue
        there = [columns[name] for name in (f"axis{term}[{place}]" for term in TERMS) if name in columns]
        total = np.sum([one.stored for one in there], axis=0, dtype=np.float64)
        limit = header.number("pidsum_limit_yaw" if place == "2" else "pidsum_limit")
        yield f"axisSum[{place}]", np.asarray(np.clip(total, -limit, limit) if limit > 0 else total)
