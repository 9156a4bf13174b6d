"""What is made of a flight: fits side by side, what engineers ask of a fit, and a fit's runs read again.

The same functions serve the command line, the app and the demo.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Annotated

from msgspec import Meta

from gcs import documents
from gcs.analysis.band import chosen_band
from gcs.errors import TippathError
from gcs.logs import AnyWindow, FromStart, ingest
from gcs.logs.runs.loop import TOLD
from gcs.logs.runs.run import split_mark
from sysid.compare.metrics import Difference, Mismatches, mismatch, onboard_difference
from sysid.data.airframe import Airframe
from sysid.data.band import BandFrom, ChosenBand
from sysid.data.dataset import Dataset, Runs, prepared
from sysid.data.record import CHANNELS, Record
from sysid.fit.checks import Check, Spread, eigenfrequency_checks, fit_checks
from sysid.fit.identify import identify, judge
from sysid.fit.implied import Implied, Vehicle, implied, rotor_speed
from sysid.fit.low_edge import LowEdges, low_edges
from sysid.fit.model_error import with_model_errors
from sysid.fit.result import Fit, RecordUsed
from sysid.model.compose import compose, not_testable
from sysid.model.effect import find
from sysid.model.paper import CD, TABLE_4, TPP, reduce_to_cd
from sysid.model.structure import Model, Structure

_SIZE = Meta(gt=0.0, lt=1e6)

GUIDE_CRAMER_RAO = 20.0
GUIDE_INSENSITIVITY = 10.0
"""Percent; what engineers accept of a parameter (Tischler and Remple)."""

PAPER_PARAMETERS = TABLE_4
"""What the paper found on the real vehicle; shown beside, never mixed in."""


PAIR = TPP.base, CD.base
"""Fitted side by side, as the paper has them: the app knows no other bases."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Identification:
    """TPP, CD and the CD that the TPP reduces to, on the same runs."""

    tpp: Fit
    cd: Fit
    reduced: Model
    reduced_nrmse: dict[str, float]
    reduced_validation: dict[str, float] | None
    checks: tuple[Check, ...]


def split_runs(records: Sequence[Record]) -> tuple[list[Record], list[Record]]:
    """Chirps to fit and doublets to judge by; with no chirp everything is fitted."""
    chirps = [record for record in records if record.maneuver == "chirp"]
    doublets = [record for record in records if record.maneuver == "doublet"]
    return (chirps, doublets) if chirps else (list(records), [])


def identify_flight(
    records: Runs,
    validation: Runs = (),
    band: ChosenBand | None = None,
    *,
    effects: Sequence[str] = (),
) -> Identification:
    """Fit TPP and CD to the records together and judge both, and the reduced CD, on the validation records.

    Without a band it is that in which the runs are prepared, else that of `gcs.analysis.band`. `effects` are composed
    onto the TPP, and onto the CD those that its own parameters do not stand for. Raises sysid.errors.FitError where an
    axis is not identifiable.
    """
    if band is None:
        band = ChosenBand(records.band_hz, BandFrom.GIVEN) if isinstance(records, Dataset) else chosen_band(records)
    fitted, judging = prepared(records, band.hz), prepared(validation, band.hz)
    tpp = identify(TPP, fitted, judging, band.hz, effects=effects)
    fitted, judging = fitted.held(tpp.found_loop_s), judging.held(tpp.found_loop_s)
    cd = identify(CD, fitted, judging, band.hz, effects=on_cd(effects))
    tpp, cd = (replace(with_model_errors(one, fitted, judging), band_from=band.source) for one in (tpp, cd))
    return side_by_side(tpp, cd, fitted, judging)


def on_cd(effects: Sequence[str]) -> list[str]:
    """Those of the effects of a TPP that act on the CD beside it."""
    return [one for one in effects if not_testable(find(one), CD.base_, effects, CHANNELS) is None]


def side_by_side(tpp: Fit, cd: Fit, records: Runs, validation: Runs) -> Identification:
    """Two fits that were made of these runs, with the CD that the TPP reduces to and the eigenfrequency check."""
    band_hz = tpp.band_hz
    fitted, judging = (prepared(runs, band_hz).held(tpp.found_loop_s) for runs in (records, validation))
    reduced = _reduced(tpp.model, cd.model.structure)
    return Identification(
        tpp=tpp,
        cd=cd,
        reduced=reduced,
        reduced_nrmse=judge(reduced, fitted, band_hz),
        reduced_validation=judge(reduced, judging, band_hz) if judging.records else None,
        checks=eigenfrequency_checks(tpp.model, fitted, band_hz),
    )


def _reduced(tpp: Model, cd: Structure) -> Model:
    """The CD of this structure that a TPP becomes when its flapping has settled; effects that both have stay."""
    core = compose(TPP.base_, [one for one in tpp.structure.composed if one.id == "angular_damping"])
    bare = reduce_to_cd(Model(core, core.vector({name: tpp[name] for name in core.names})))
    known = bare.by_name
    return Model(cd, cd.vector({name: known[name] if name in known else tpp[name] for name in cd.names}))


@dataclass(frozen=True, eq=False, kw_only=True)
class Judgement:
    """What engineers ask of a fit beside its own numbers."""

    responses: Mismatches
    checks: tuple[Check, ...]
    spread: Spread | None
    low_edges: LowEdges | None
    """None where nothing can be left out of the band."""
    implied: tuple[Implied, ...] = ()
    onboard: tuple[Difference, ...] = ()
    """The fit's responses less those that the vehicle identified itself in the same runs."""


def assess(fit: Fit, runs: Runs, vehicle: Vehicle | None = None) -> Judgement:
    """Judge a fit on the runs it was made from."""
    on, structure = prepared(runs, fit.band_hz).held(fit.found_loop_s), fit.model.structure
    bins = on.viewed(structure.inputs, structure.outputs)
    checks, spread = fit_checks(fit.model, on, fit.band_hz, fit.fixed, fit.weights)
    predicted = fit.instrument == "prediction error"  # low frequencies do not make its values what they are
    edges = None if predicted else low_edges(fit.model, bins, fit.band_hz, fit.fixed, fit.weights)
    figures = () if vehicle is None else implied(fit, vehicle, rotor_speed(on.records))
    checks = checks if edges is None else (*checks, edges.check)
    told = tuple(
        onboard_difference(fit.model, record.onboard, fit.band_hz)
        for record in on.records
        if record.onboard is not None
    )
    return Judgement(
        responses=mismatch(fit.model, bins),
        checks=checks,
        spread=spread,
        low_edges=edges,
        implied=figures,
        onboard=told,
    )


class VehicleDocument(documents.Strict, frozen=True, kw_only=True):
    """A vehicle file: what was measured on the ground, SI."""

    k_beta: Annotated[float, _SIZE, Meta(description="the spring of the rotor against tilt, N m/rad")]
    mass: Annotated[float, _SIZE, Meta(description="kg")] | None = None
    arm: Annotated[float, _SIZE, Meta(description="rotor plane above the centre of mass, m")] | None = None
    I_xx: Annotated[float, _SIZE, Meta(description="inertia about the roll axis, kg m^2")] | None = None
    I_yy: Annotated[float, _SIZE, Meta(description="inertia about the pitch axis, kg m^2")] | None = None
    omega: Annotated[float, _SIZE, Meta(description="usual rotor speed, rad/s")] | None = None


def load_vehicle(path: Path) -> Vehicle:
    """A vehicle file. Raises DocumentError for what is not one, or cannot be read."""
    vehicle = documents.read_toml(path, VehicleDocument, what="vehicle file")
    if (vehicle.mass is None) != (vehicle.arm is None):
        raise documents.DocumentError(
            f"{path}: mass and arm go together, their product is what the thrust adds to k_beta"
        )
    return Vehicle(**{name: getattr(vehicle, name) for name in vehicle.__struct_fields__})


def on_airframe(records: Sequence[Record], airframe: Airframe | None) -> list[Record]:
    """The runs as of this airframe, whatever their logs tell; None leaves them as they are."""
    return [*records] if airframe is None else [replace(record, airframe=airframe) for record in records]


def told_loop_rate(fit: Fit) -> float | None:
    """The loop's rate that the user gave with the fit's runs, Hz; None where none was given."""
    return next((one.loop_rate_hz for one in fit.records if one.loop_told_by == TOLD), None)


def runs_of(fit: Fit, which: Sequence[RecordUsed], cut: FromStart | None = None) -> list[Record]:
    """The records a fit was made from, read again from their logs; `cut` takes another part of each.

    Raises TippathError where a log is gone or is not the same bytes any more, or where the window leaves nothing.
    """
    profile = None if fit.profile is None else Path(fit.profile)
    logs: dict[tuple[str, AnyWindow | None], tuple[set[str], dict[str, Record | None]]] = {}
    found: list[Record] = []
    for one in which:
        if not one.path or not Path(one.path).exists():
            raise TippathError(f"{one.id}: its log {one.path or '(unknown)'} is not there any more")
        plain, own_cut = split_mark(one.id)
        window = cut or own_cut or fit.window_s
        if (one.path, window) not in logs:
            told = told_loop_rate(fit)
            again = partial(ingest, [Path(one.path)], profile, window, f_high_hz=fit.band_hz[1], loop_rate_hz=told)
            read = again()
            if one.sha256 not in {source.sha256 for source in read.sources}:  # fitted before more of it was fetched?
                read = again(join=False)
            logs[one.path, window] = (
                {source.sha256 for source in read.sources},
                {run.id: run.record for run in read.runs},
            )
        digests, records = logs[one.path, window]
        if one.sha256 not in digests:
            raise TippathError(f"{one.id}: {one.path} is not the log this fit was made from any more")
        record = records.get(plain + window.mark if isinstance(window, FromStart) else one.id)
        if record is None:
            ends = (
                "" if fit.window_s is None else " in " + ":".join("" if s is None else f"{s:g}" for s in fit.window_s)
            )
            raise TippathError(f"{one.id}: {one.path} has no such run in {ends} s; --window START:STOP takes it in")
        found.append(record.held(fit.found_loop_s))
    return found
