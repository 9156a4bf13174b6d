"""The proof in the air: flights with pushed gains beside what was predicted of them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from gcs import documents
from gcs.analysis.clearance import ClearedGains
from gcs.analysis.comparison import flown
from gcs.errors import TippathError, UsageError
from gcs.flight.folder import FlightFolder
from gcs.flight.gains import LARGEST, GainsError, gains_of
from gcs.flight.rate_set import is_rate_set, load_rate_set
from gcs.logs.formats.dataflash_table import DataFlashTables
from gcs.logs.formats.tables import FloatArray
from gcs.logs.opening import open_log
from gcs.logs.runs import systemid
from gcs.logs.runs.rate_loop import LATER_LOOPS, repeats
from gcs.logs.runs.span import Span
from gcs.vehicle.autopilots import ACTIVE_CRC, SWITCH, SWITCHED
from gcs.vehicle.rate_loops import AXES, gyro_filter_hz, rate_loops
from sysid.control.in_time import InLoops, in_loops, lqr_law, predicted_rates
from sysid.control.prefilter import DynamicPrefilter
from sysid.control.proof import FlownRun, Proof, ProofError, flown_run, prove
from sysid.errors import SysidError
from sysid.fit.result import Fit
from sysid.fit.saved_model import saved_model
from sysid.model.paper import TPP
from sysid.model.structure import Model
from sysid.rate_loop.linear import Discrete, controller

BEFORE_S = 1.0
"""Of hover before a run: what a vehicle at rest would do is forgotten then."""
FLEW_PERCENT = 5.0
"""Of the vehicle's commands that loops with these gains may leave; with the gains before a push it is tens."""
THINNEST = 1.5
"""Loops from row to row: a log that has fewer does not tell what was asked."""
FIELDS = ("RDes", "PDes", "R", "P")
WHOLE_ROLES = ("missing", "fit")
"""Of the models in a GAINS.json, in the order in which one is taken: completed, else as it was fitted."""


Controlled = tuple[Discrete, InLoops, int]
"""The controller, the vehicle, and by how many loops a target is logged before it acts."""
Given = Callable[[DataFlashTables, Span], Controlled]
"""What flew in a run. Raises TippathError where something else did."""


@dataclass(frozen=True, eq=False, kw_only=True)
class FlownProof:
    """What flights prove of gains."""

    proof: Proof
    model: str
    """That predicted: `TPP + servo_lag`."""
    completed: bool
    """Whether it is the fit with what its diagnosis named as missing."""
    left_out: tuple[tuple[str, str], ...]
    """Runs that prove nothing, and why."""


def prove_flights(
    gains: Path, flights: Sequence[Path], fit: Path | None = None, named: Sequence[str] = ()
) -> FlownProof:
    """Every run of these flights in which a rate was asked for, on either axis.

    `fit` predicts; without it the models in the file of gains. `named`: files of the user's, whose code may run. Raises
    GainsError, TippathError where nothing is to be predicted with, or nothing was flown.
    """
    if is_rate_set(gains):
        given, model, completed = _stock(gains, fit)
    else:
        given, model, completed = _bank(gains, fit, named)
    runs: list[FlownRun] = []
    left_out: list[tuple[str, str]] = []
    loop_s = 0.0
    for name, log, span in _spans(flights):
        try:
            run, loop_s = _flown(name, log, span, given)
            runs.append(run)
        except (TippathError, ProofError) as error:
            left_out.append((name, str(error)))
    if not runs:
        why = "; ".join(f"{name}: {words}" for name, words in left_out[:3])
        raise TippathError(
            f"no run shows how the vehicle follows its rate command with these gains{f' ({why})' if why else ''}: fly "
            "the card `proof` with them"
        )
    title = model.structure.title
    return FlownProof(proof=prove(runs, loop_s), model=title, completed=completed, left_out=tuple(left_out))


def _spans(flights: Sequence[Path]) -> Iterator[tuple[str, DataFlashTables, Span]]:
    for flight in flights:
        logs = FlightFolder(flight).logs() if flight.is_dir() else [flight]
        if not logs:
            raise TippathError(f"{flight}: there is no log in it")
        for path in logs:
            for log in open_log(path, None).boots:
                spans = systemid.find(log) if isinstance(log, DataFlashTables) else []
                for number, span in enumerate(spans, 1):
                    if span.axis in AXES and not span.excites_command:
                        assert isinstance(log, DataFlashTables)
                        yield f"{path.name}#{number}", log, span


def _flown(name: str, log: DataFlashTables, span: Span, given: Given) -> tuple[FlownRun, float]:
    if span.reasons:
        raise TippathError("; ".join(span.reasons))
    law, vehicle, later = given(log, span)
    if not all(log.has(f"RATE.{field}") for field in FIELDS):
        raise TippathError("RATE is not in the log")
    series = [log.series(f"RATE.{field}").part(span.start_s - BEFORE_S, span.stop_s) for field in FIELDS]
    t, columns = series[0].t, np.radians(np.array([one.values for one in series]))
    if t.size < 2 or not np.all(np.isfinite(columns)):
        raise TippathError("RATE has no numbers here")
    spacing = np.diff(t)
    if float(np.max(spacing)) > 10 * law.dt or float(np.median(spacing)) > THINNEST * law.dt:
        raise TippathError("RATE does not have every loop: what was asked for in between is not known")
    at = t[0] + law.dt * np.arange(round(float(t[-1] - t[0]) / law.dt))
    asked, measured = (_at(at, t, columns[rows]) for rows in (slice(0, 2), slice(2, 4)))
    asked = np.concatenate([np.repeat(asked[:1], later, axis=0), asked])[: len(asked)]
    predicted = predicted_rates(law, vehicle, asked)
    axis = list(AXES).index(str(span.axis))
    return flown_run(name, axis, at, asked=asked, measured=measured, predicted=predicted), law.dt


def _at(at: FloatArray, t: FloatArray, rows: FloatArray) -> FloatArray:
    return np.column_stack([np.interp(at, t, row) for row in rows])


def _bank(path: Path, fit: Path | None, named: Sequence[str]) -> tuple[Given, Model, bool]:
    """The LQR of a GAINS.json."""
    try:
        document = documents.read_json(path, ClearedGains, what="set of gains", largest=LARGEST)
        raw = documents.json_value(path.read_text("utf-8"), str(path))
        crc = gains_of(raw, str(path)).crc
    except documents.DocumentError as error:
        raise GainsError(f"{error}; make it with `tippath design`") from error
    if document.elevator is not None:
        raise GainsError(f"{path}: what a third command does is not predicted yet: fly the set of two")
    said, dynamic = document.dynamic_prefilter, None
    if said is not None:
        frequency, damping, F = (np.array(one, dtype=float) for one in (said.frequency_rad_s, said.damping, said.F))
        dynamic = DynamicPrefilter(frequency=frequency, damping=damping, F=F)
    own = Model(TPP, TPP.vector({name: document.parameters[name] for name in TPP.names}))
    model, completed = (own, False) if fit is None else (Fit.load(fit, named).model, False)
    if fit is None and document.judged_on is not None:
        model, completed = _judged_on(path, document, named) or (own, False)
    K, observer, prefilter = (np.array(one) for one in (document.K, document.observer_gain, document.prefilter))
    made: dict[float, tuple[Discrete, InLoops]] = {}

    def given(log: DataFlashTables, span: Span) -> Controlled:
        _require_flown(log, span, crc)
        spacing = np.diff(log.series("RATE.R").part(span.start_s, span.stop_s).t) if log.has("RATE.R") else np.array([])
        if not spacing.size:
            raise TippathError("RATE is not in the log")
        dt = round(float(np.median(spacing)), 5)
        if dt not in made:
            made[dt] = lqr_law(own, K, observer, prefilter, dt, dynamic), in_loops(model, dt)
        return *made[dt], 0

    return given, model, completed


def _judged_on(path: Path, document: ClearedGains, named: Sequence[str]) -> tuple[Model, bool] | None:
    """The model that predicts best of those in a file of gains, and whether it is the completed one."""
    held = {} if document.judged_on is None else {one.role: one.model for one in reversed(document.judged_on.models)}
    role = next((role for role in WHOLE_ROLES if role in held), None)
    if role is None:
        return None
    try:
        return saved_model(held[role], path.parent, named), role == "missing"
    except SysidError as error:
        raise GainsError(f"{path}: {error}; design again with `tippath design`") from error


def _require_flown(log: DataFlashTables, span: Span, crc: int) -> None:
    """Raises TippathError where another set flew, or none."""
    parameters = log.parameters(span.start_s)
    active = parameters.get(ACTIVE_CRC)
    if active is not None and int(active) != crc:
        raise TippathError(f"another set flew ({int(active):06x}, not {crc:06x})")
    # turned before the log began, it stands among the parameters at its begin alone
    said = [text for t, text in log.texts() if t <= span.start_s and text in SWITCHED]
    if (said[-1] != SWITCHED[1]) if said else (parameters.get(SWITCH) != 1):
        raise TippathError("the pilot's switch did not select the LQR")


def _stock(path: Path, fit: Path | None) -> tuple[Given, Model, bool]:
    """Rate loops with new gains."""
    wanted = load_rate_set(path)
    if fit is None:
        raise UsageError(f"{path} has no model that predicts: name the fit that it was designed on (--fit FIT.json)")
    loaded = Fit.load(fit)
    source = flown(loaded)[0][0].rate_source
    vehicles: dict[tuple[float, float], InLoops] = {}

    def given(log: DataFlashTables, span: Span) -> Controlled:
        parameters: Mapping[str, Any] = log.parameters(span.start_s) | dict(wanted.new)
        loops = rate_loops(parameters)
        for axis in AXES:
            found = repeats(log, axis, span.start_s, span.stop_s, injected=False, parameters=parameters)
            if not found.residual_percent <= FLEW_PERCENT:
                raise TippathError(
                    f"these gains did not fly: {found.residual_percent:.0f} % of the {axis} commands are not theirs"
                )
        dt, corner = 1 / loops.loop_hz, gyro_filter_hz(parameters, source)
        if (dt, corner) not in vehicles:
            vehicles[dt, corner] = in_loops(loaded.model, dt, corner)
        # the targets are as they were logged, the attitude's part included
        law = controller(loops.without_attitude, dt)
        return law, vehicles[dt, corner], LATER_LOOPS

    return given, loaded.model, False
