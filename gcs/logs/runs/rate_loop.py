"""How well a rate loop of ArduPilot repeats a log's own commands: RATE's outputs from its targets, rates and PARM.

A row of RATE is written at the end of a loop, when the target for the next one stands already: its output answers the
target of the row before and the rate of its own. SIDD's excitation is likewise that of the next loop.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gcs.errors import TippathError
from gcs.logs.formats.dataflash_table import DataFlashTables
from gcs.logs.formats.tables import FloatArray
from gcs.vehicle.rate_loops import RateLoops, rate_loops
from sysid.rate_loop.simulate import Loops, simulate

BEGINS_AFTER_S = 2.0
"""When the filters have forgotten their beginning the integrator is set once, by the output."""
LEAST_S = 1.0
LATER_LOOPS = 1
"""By which targets and excitation act after they were logged."""
LONGEST_GAP_S = 0.1
"""A longer one begins a new piece: what the integrator did in it nobody knows."""
FLOAT32_PERCENT = 0.01
"""What rounding in the log leaves is well below."""
FIELDS = {"roll": ("RDes", "R", "ROut"), "pitch": ("PDes", "P", "POut")}
EXCITATION = "SIDD.Targ"


@dataclass(frozen=True, kw_only=True)
class Repeated:
    """A rate loop beside what the vehicle put out."""

    axis: str
    start_s: float
    stop_s: float
    residual_percent: float
    """Rms of the difference, of the rms of the vehicle's output about its mean, what is injected left out of both."""
    rows: int
    """That were compared."""
    causes: tuple[str, ...]
    """Of the residual, where it is more than rounding."""
    lacking: bool
    """Whether the log lacks loops, so that the residual is not the model's alone."""


@dataclass(frozen=True, eq=False)
class _Piece:
    """A stretch without a long gap, in loops; rows that were not logged are drawn straight between their neighbours."""

    t: FloatArray
    seen: Loops
    output: FloatArray
    logged: NDArray[np.bool_]
    """Whether a loop has a row, (n,)."""


def repeats(
    log: DataFlashTables,
    axis: str,
    start_s: float,
    stop_s: float,
    *,
    injected: bool,
    later: int = LATER_LOOPS,
    parameters: Mapping[str, float] | None = None,
) -> Repeated:
    """The loop of `roll` or `pitch` over a stretch of a log, by the log's parameters where no others are given;
    `injected`: whether the excitation is added to this axis's output.

    Raises TippathError where the log has no such loop, or nothing long enough to compare.
    """
    target, rate, output = FIELDS[axis]
    if not all(log.has(f"RATE.{name}") for name in (target, rate, output)):
        raise TippathError(
            f"no {target}, {rate}, {output} in RATE: log the attitude in every loop, so that the rate loop can be "
            "compared with what the vehicle did"
        )
    loops = rate_loops(log.parameters(start_s) if parameters is None else parameters)
    loop = loops.roll if axis == "roll" else loops.pitch
    errors: list[FloatArray] = []
    outputs: list[FloatArray] = []
    limited = 0
    for piece in _pieces(log, axis, loops.loop_hz, start_s, stop_s, injected, later):
        began = int(np.searchsorted(piece.t, piece.t[0] + BEGINS_AFTER_S))
        done = simulate(loop, piece.seen, began=began, output=piece.output)
        compared = piece.logged & (np.arange(piece.t.size) > began)
        errors.append((done.output - piece.output)[compared])
        outputs.append((piece.output - piece.seen.injected)[compared])
        limited += done.limited
    if not errors:
        raise TippathError(
            f"no stretch of {BEGINS_AFTER_S + LEAST_S:g} s without a long gap in RATE between {start_s:.1f} and "
            f"{stop_s:.1f} s: take the whole log from the card"
        )
    error, own = np.concatenate(errors), np.concatenate(outputs)
    size = float(np.std(own))
    residual = 100 * float(np.sqrt(np.mean(error**2))) / size if size > 0 else math.nan
    lacks = _lacking(log, loops, (start_s, stop_s))
    causes = () if residual < FLOAT32_PERCENT else _causes(loops, lacks, limited)
    return Repeated(
        axis=axis,
        start_s=start_s,
        stop_s=stop_s,
        residual_percent=residual,
        rows=error.size,
        causes=causes,
        lacking=bool(lacks),
    )


def _pieces(
    log: DataFlashTables, axis: str, loop_hz: float, start_s: float, stop_s: float, injected: bool, later: int
) -> list[_Piece]:
    """Stretches of the log as the loop saw them."""
    series = [log.series(f"RATE.{name}").part(start_s, stop_s) for name in FIELDS[axis]]
    columns = np.array([one.values for one in series])
    told = np.all(np.isfinite(columns), axis=0)
    t, columns = series[0].t[told], columns[:, told]
    if t.size < 2:
        return []
    breaks = np.flatnonzero(np.diff(t) > LONGEST_GAP_S) + 1
    pieces = []
    for rows in np.split(np.arange(t.size), breaks):
        if t[rows[-1]] - t[rows[0]] < BEGINS_AFTER_S + LEAST_S:
            continue
        at, logged = _loops(t[rows], loop_hz)
        target, rate, output = (np.interp(at, t[rows], column[rows]) for column in columns)
        added = _injected(log, at) if injected else np.zeros(at.size)
        whole = slice(later, None)
        last = at.size - later
        seen = Loops(
            dt=np.diff(at, prepend=at[0] - 1 / loop_hz)[whole],
            target=np.radians(target)[:last],
            rate=np.radians(rate)[whole],
            injected=added[:last],
        )
        pieces.append(_Piece(at[whole], seen, output[whole], logged[whole]))
    return pieces


def _loops(t: FloatArray, loop_hz: float) -> tuple[FloatArray, NDArray[np.bool_]]:
    """When the loops ran of which some were logged at t, and which were."""
    between = np.maximum(1, np.round(np.diff(t) * loop_hz).astype(int))
    rows = np.concatenate([[0], np.cumsum(between)])
    logged = np.zeros(rows[-1] + 1, dtype=np.bool_)
    logged[rows] = True
    return np.interp(np.arange(rows[-1] + 1), rows, t), logged


def _injected(log: DataFlashTables, at: FloatArray) -> FloatArray:
    """The excitation at those times; nothing before its first sample and after its last."""
    if not log.has(EXCITATION):
        return np.zeros(at.size)
    series = log.series(EXCITATION)
    return np.asarray(np.interp(at, series.t, series.values, left=0.0, right=0.0))


def _lacking(log: DataFlashTables, loops: RateLoops, between: tuple[float, float]) -> list[str]:
    """What loops the log does not tell of."""
    spacing = np.diff(log.series("RATE.R").part(*between).t) * loops.loop_hz
    usual = float(np.median(spacing))
    said = []
    if usual > 1.5:
        said.append(f"RATE has one loop of {usual:.0f}: what was asked for in between is not known")
    gaps = spacing[spacing > max(1.5, 1.5 * usual)]
    if gaps.size:
        longest = 1000 * float(gaps.max()) / loops.loop_hz
        said.append(f"{gaps.size} gaps of up to {longest:.0f} ms in RATE: what was asked for in them is not known")
    return said


def _causes(loops: RateLoops, lacks: list[str], limited: int) -> tuple[str, ...]:
    said = [*loops.not_modelled, *lacks]
    if limited:
        said.append(f"limits in {limited} loops: whether they held the integrator RATE does not tell")
    return tuple(said) or ("not found: another firmware, or parameters that were changed and not logged",)
