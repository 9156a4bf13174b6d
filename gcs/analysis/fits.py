"""What is made of a flight: fits side by side, checks and gains, and their tables in words of the paper.

The same functions serve the command line, the app and the demo.
"""

from __future__ import annotations

import math
import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from msgspec import Meta

from gcs import documents
from gcs.errors import TippathError
from sysid.compare.metrics import GOOD_COST, LEAST_COHERENCE, Mismatches, mismatch
from sysid.control.regulator import Gains
from sysid.control.stability import ClosedLoop
from sysid.data.preprocess import DEFAULT_BAND_HZ, spectra
from sysid.data.record import CHANNELS, Record
from sysid.fit.checks import Check, Spread, eigenfrequency_checks, fit_checks
from sysid.fit.identify import identify, judge
from sysid.fit.implied import Implied, Vehicle, implied, rotor_speed
from sysid.fit.result import HIGH_CORRELATION, Fit, RecordUsed
from sysid.model.bases import CD, TPP, compose, not_testable, reduce_to_cd
from sysid.model.effect import find
from sysid.model.structure import Model, Structure

Band = tuple[float, float]
_SIZE = Meta(gt=0.0, lt=1e6)

GUIDE_CRAMER_RAO = 20.0
GUIDE_INSENSITIVITY = 10.0
"""Percent; what engineers accept of a parameter (Tischler and Remple)."""

# What the paper found on the real vehicle; shown beside, never mixed in.
PAPER_MODES = {"tpp": ((1.64, 0.39), (5.04, 0.22)), "cd": ((1.54, 0.35),)}
PAPER_NRMSE = {
    ("tpp", "chirps"): (77.8, 77.3),
    ("cd", "chirps"): (77.2, 25.9),
    ("tpp", "doublets"): (77.6, 64.7),
    ("cd", "doublets"): (76.7, 20.0),
}
PAPER_PARAMETERS = {
    "tpp": (147.548, 713.378, 0.091, -1.338, 1.448, -0.282, 0.296, 0.524, -0.050),
    "cd": (-2.056, -7.900, 10.536, -4.777, -5.361, 9.917, -67.573, 11.136),
}
"""Table 4, in the order of our structures."""


@dataclass(frozen=True, eq=False)
class Identification:
    """TPP, CD and the CD that the TPP reduces to, on the same runs."""

    tpp: Fit
    cd: Fit
    reduced: Model
    reduced_nrmse: dict[str, float]
    reduced_validation: dict[str, float] | None
    checks: tuple[Check, ...]

    def tables(self) -> str:
        """The paper's Tables 2, 3 and 4 with ours beside, and the eigenfrequency check; 78 columns."""
        return "\n\n".join([nrmse_table(self), modes_table(self), parameter_table(self), checks_text(self.checks)])


def split_runs(records: Sequence[Record]) -> tuple[list[Record], list[Record]]:
    """Chirps to fit and doublets to judge by; with no chirp everything is fitted."""
    chirps = [record for record in records if record.maneuver == "chirp"]
    doublets = [record for record in records if record.maneuver == "doublet"]
    return (chirps, doublets) if chirps else (list(records), [])


def identify_flight(
    records: Sequence[Record],
    validation: Sequence[Record] = (),
    band_hz: Band = DEFAULT_BAND_HZ,
    *,
    effects: Sequence[str] = (),
) -> Identification:
    """Fit TPP and CD to the records together and judge both, and the reduced CD, on the validation records.

    `effects` are composed onto the TPP, and onto the CD those that its own parameters do not stand for. Raises
    sysid.errors.FitError where an axis is not identifiable.
    """
    tpp = identify(TPP, records, validation, band_hz, effects=effects)
    cd = identify(CD, records, validation, band_hz, effects=on_cd(effects))
    return side_by_side(tpp, cd, records, validation)


def on_cd(effects: Sequence[str]) -> list[str]:
    """Those of the effects of a TPP that act on the CD beside it."""
    return [one for one in effects if not_testable(find(one), "cd", effects, CHANNELS) is None]


def side_by_side(tpp: Fit, cd: Fit, records: Sequence[Record], validation: Sequence[Record]) -> Identification:
    """Two fits that were made of these runs, with the CD that the TPP reduces to and the eigenfrequency check."""
    band_hz = tpp.band_hz
    reduced = _reduced(tpp.model, cd.model.structure)
    return Identification(
        tpp,
        cd,
        reduced,
        judge(reduced, records, band_hz),
        judge(reduced, validation, band_hz) if validation else None,
        eigenfrequency_checks(tpp.model, records, band_hz),
    )


def _reduced(tpp: Model, cd: Structure) -> Model:
    """The CD of this structure that a TPP becomes when its flapping has settled; effects that both have stay."""
    core = compose("tpp", [one for one in tpp.structure.composed if one.id == "angular_damping"])
    bare = reduce_to_cd(Model(core, core.vector({name: tpp[name] for name in core.names})))
    known = dict(zip(bare.structure.names, map(float, bare.values), strict=True))
    return Model(cd, cd.vector({name: known[name] if name in known else tpp[name] for name in cd.names}))


def nrmse_table(found: Identification) -> str:
    """Table 3: NRMSE fit in percent, 100 is perfect."""
    as_paper = not found.tpp.model.structure.composed
    judged = {one.maneuver for one in found.tpp.validation}
    lines = [f"NRMSE fit, %            TPP           CD      CD reduced{'    paper: TPP / CD' if as_paper else ''}"]
    rows = [("chirps", found.tpp.nrmse_percent, found.cd.nrmse_percent, found.reduced_nrmse)]
    if (
        found.tpp.validation_nrmse_percent is not None
        and found.cd.validation_nrmse_percent is not None
        and found.reduced_validation is not None
    ):
        rows.append(
            (
                "doublets" if judged <= {"doublet"} else "validation",
                found.tpp.validation_nrmse_percent,
                found.cd.validation_nrmse_percent,
                found.reduced_validation,
            )
        )
    for maneuver, tpp, cd, reduced in rows:
        for index, axis in enumerate(("p", "q")):
            name = f"{maneuver if index == 0 else ''}"
            paper = ""
            if as_paper and ("tpp", maneuver) in PAPER_NRMSE:
                paper = f"{PAPER_NRMSE['tpp', maneuver][index]:5.1f} / {PAPER_NRMSE['cd', maneuver][index]:.1f}"
            line = f"  {name:10} {axis}     {tpp[axis]:8.1f}     {cd[axis]:8.1f}    {reduced[axis]:8.1f}      {paper}"
            lines.append(line.rstrip())
    return "\n".join(lines)


def modes_table(found: Identification) -> str:
    """Table 2: natural frequencies and damping ratios."""
    as_paper = not found.tpp.model.structure.composed
    lines = [f"natural modes       frequency, Hz   damping ratio{'    paper' if as_paper else ''}"]
    for name, model, paper in (
        ("TPP", found.tpp.model, PAPER_MODES["tpp"]),
        ("CD", found.cd.model, PAPER_MODES["cd"]),
        ("CD reduced", found.reduced, ()),
    ):
        for index, mode in enumerate(model.modes):
            beside = f"{paper[index][0]:.2f} Hz  {paper[index][1]:.2f}" if as_paper and index < len(paper) else ""
            lines.append(
                f"  {name if index == 0 else '':12}      {mode.frequency_hz:8.3f}        "
                f"{mode.damping_ratio:8.3f}       {beside}".rstrip()
            )
    return "\n".join(lines)


def parameter_table(found: Identification) -> str:
    """Table 4: parameters with standard errors."""
    as_paper = not found.tpp.model.structure.composed
    lines = [f"parameter           value ± standard error       unit{'        paper' if as_paper else ''}"]
    for fit, paper in ((found.tpp, PAPER_PARAMETERS["tpp"]), (found.cd, PAPER_PARAMETERS["cd"])):
        structure = fit.model.structure
        beside = [f" {theirs:10.3f}" for theirs in paper] if as_paper else [""] * len(structure.names)
        for parameter, value, error, theirs in zip(
            structure.parameters, fit.model.values, fit.standard_errors, beside, strict=True
        ):
            label = f"{structure.base.upper():3} {parameter.name:6}"
            line = f"  {label:12} {value:12.4f} ± {error:<10.2g}     {parameter.unit:8}{theirs}"
            lines.append(line.rstrip())
    return "\n".join(lines)


def checks_text(checks: Sequence[Check]) -> str:
    """One line a check: ✓ passed, ✗ failed, ? not possible."""
    marks = {True: "✓", False: "✗", None: "?"}
    lines = ["eigenfrequency check"]
    for one in checks:
        lines += wrapped(f"{marks[one.passed]} {one.name}: {one.text}", "  ", "    ")
    return "\n".join(lines)


def wrapped(text: str, first: str = "", rest: str = "") -> list[str]:
    """Sentences to lines of at most 78 columns."""
    return textwrap.wrap(text, 78, initial_indent=first, subsequent_indent=rest)


def fit_text(fit: Fit, checks: Sequence[Check], responses: Mismatches | None = None) -> str:
    """One fit for people; 78 columns."""
    structure = fit.model.structure
    count = f"{len(fit.records)} run{'s' if len(fit.records) != 1 else ''}"
    title = f"{' + '.join([structure.base.upper(), *structure.effects])} fitted to {count}"
    lines = [*wrapped(f"{title}, {fit.band_hz[0]:g}-{fit.band_hz[1]:g} Hz", rest="  "), ""]
    lines.append("NRMSE fit, %        p         q")
    lines.append(f"  fitted       {fit.nrmse_percent['p']:6.1f}    {fit.nrmse_percent['q']:6.1f}")
    if fit.validation_nrmse_percent is not None:
        lines.append(
            f"  validation   {fit.validation_nrmse_percent['p']:6.1f}    {fit.validation_nrmse_percent['q']:6.1f}"
        )
    lines += ["", "natural modes       frequency, Hz   damping ratio"]
    lines += [f"  {mode.frequency_hz:26.3f}        {mode.damping_ratio:8.3f}" for mode in fit.model.modes]
    if structure.outside_matrices:
        named = ", ".join(Path(one).name for one in structure.outside_matrices)
        lines += wrapped(f"not in them, for it acts on the commands before: {named}", "  ", "  ")
    if not fit.stable:
        lines.append("  unstable: see the warnings")
    lines += ["", *_parameters(fit)]
    if len(fit.lineage) > 1:
        lines += ["", "ladder                              p         q"]
        for rung in fit.lineage:
            name = structure.base.upper() if not rung.effects else f"+ {Path(rung.effects[-1]).name}"
            lines.append(f"  {name:26} {rung.nrmse_percent['p']:8.1f}  {rung.nrmse_percent['q']:8.1f}")
    if responses is not None:
        lines += ["", responses_text(responses)]
    if checks:
        lines += ["", checks_text(checks)]
    for text in fit.warnings:
        lines += ["", *wrapped(f"warning: {text}", rest="  ")]
    return "\n".join(lines)


def _parameters(fit: Fit) -> list[str]:
    """Values with standard errors and the engineers' two figures, what is to be said of a value on a line below it."""
    structure = fit.model.structure
    width = max(12, *(len(name) for name in structure.names))
    lines = [f"  {'parameter':{width}}      value ± std. error  unit        CR, %  insens., %"]
    vague = fit.undetermined
    for parameter, value, error, alone in zip(
        structure.parameters, fit.model.values, fit.standard_errors, fit.insensitivity_percent, strict=True
    ):
        marks = []
        number, figures = f"{value:11.4f}", ""
        if parameter.name in fit.fixed or parameter.name in fit.at_bound:
            marks.append("held" if parameter.name in fit.fixed else "at its bound")
        elif parameter.name in vague:
            number = "not determined"
        else:
            share = 100 * error / abs(value) if value else math.inf
            figures = f"{share:8.1f} {alone:9.1f}"
            if share > GUIDE_CRAMER_RAO or alone > GUIDE_INSENSITIVITY:
                marks.append("above a guide")
        if parameter.implausible(float(value)) and parameter.name not in vague:
            marks.append("implausible")
        spread = f"± {error:<10.2g}" if figures else " " * (12 - max(0, len(number) - 11))
        lines.append(f"  {parameter.name:{width}}{number} {spread} {parameter.unit:8}{figures}".rstrip())
        if marks:
            lines.append(f"  {'':{width}}    {', '.join(marks)}")
    lines.append(f"  guides: CR at most {GUIDE_CRAMER_RAO:g} %, insensitivity at most {GUIDE_INSENSITIVITY:g} %")
    pairs = [f"{one} and {other} {value:+.2f}" for one, other, value in fit.correlations]
    if pairs:
        above = abs(fit.correlations[0][2]) > HIGH_CORRELATION
        said = f"correlated above {HIGH_CORRELATION:g}" if above else "largest correlation"
        lines += wrapped(f"{said}: {', '.join(pairs)}", "  ", "    ")
    return lines


def responses_text(found: Mismatches) -> str:
    """Model less measured responses where these can be trusted, with the integrated cost."""
    lines = [
        "model less measured     where coherence     rms        largest         cost",
        f"                        is {LEAST_COHERENCE:g} or more    dB    deg     dB    deg          J",
    ]
    for one in found.each:
        name = f"  {one.output} per {one.command}"
        band = one.band_hz
        if band is None:
            separate = found.measured.separates(one.output, one.command)
            lines.append(f"{name:24}{'nowhere' if separate else 'the runs do not separate the commands'}")
            continue
        (dB, deg), (most_dB, most_deg) = one.rms, one.largest
        lines.append(
            f"{name:24}{f'{band[0]:.2g}-{band[1]:.2g} Hz':14}{dB:6.1f} {deg:6.0f} {most_dB:6.1f} {most_deg:6.0f} "
            f"{one.cost:10.0f}{' above' if one.cost > GOOD_COST else ''}"
        )
    lines.append(f"  guide: J at most {GOOD_COST:g}; {reference_text(found)}")
    return "\n".join(lines)


def reference_text(found: Mismatches) -> str:
    """What the measured responses were taken against."""
    if found.measured.closed_loop_safe:
        return "measured against the logged excitation"
    missing = [name for name in found.measured.references if not name.startswith("excitation")]
    return f"excitation not logged for {', '.join(missing)}"


@dataclass(frozen=True, eq=False)
class Judgement:
    """What engineers ask of a fit beside its own numbers."""

    responses: Mismatches
    checks: tuple[Check, ...]
    spread: Spread | None
    implied: tuple[Implied, ...] = ()

    def to_json(self) -> dict[str, Any]:
        """Keys that are added to the fit's document."""
        return {
            "guides": {
                "cramer_rao_percent": GUIDE_CRAMER_RAO,
                "insensitivity_percent": GUIDE_INSENSITIVITY,
                "coherence": LEAST_COHERENCE,
                "cost": GOOD_COST,
            },
            "responses": [one.to_json() for one in self.responses.each],
            "responses_reference": dict(
                zip(self.responses.measured.commands, self.responses.measured.references, strict=True)
            ),
            "checks": [{"name": one.name, "passed": one.passed, "text": one.text} for one in self.checks],
            "spread": None if self.spread is None else self.spread.to_json(),
            "implied": [one.to_json() for one in self.implied],
        }


def assess(fit: Fit, records: Sequence[Record], vehicle: Vehicle | None = None) -> Judgement:
    """Judge a fit on the runs it was made from."""
    structure = fit.model.structure
    found, _ = spectra(records, structure.inputs, structure.outputs, fit.band_hz)
    checks, spread = fit_checks(fit.model, records, fit.band_hz, fit.fixed)
    figures = () if vehicle is None else implied(fit, vehicle, rotor_speed(records))
    return Judgement(mismatch(fit.model, found), checks, spread, figures)


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


def implied_text(figures: Sequence[Implied]) -> str:
    """What the fit implies about the vehicle, beside what was measured."""
    if not figures:
        return "this structure implies nothing about the vehicle: fit with --model tpp"
    lines = ["implied by the fit        value ± std. error    measured"]
    for one in figures:
        spread = "" if one.standard_error is None else f"± {one.standard_error:.2g}"
        measured = "" if one.measured is None else f"{one.measured:.4g}"
        lines.append(f"  {one.name:20} {one.value:8.3f} {spread:14}{measured:>9} {one.unit}".rstrip(" -"))
        if one.implausible:
            lines += wrapped(
                "implausible: a clue that something is missing, or the vehicle file is off", " " * 6, " " * 6
            )
    if not any(one.name == "Lock number" for one in figures):
        lines += wrapped("without the rotor speed (channel omega, or omega in the file) no Lock number", "  ", "  ")
    return "\n".join(lines)


def gains_text(gains: Gains) -> str:
    """A design for people."""

    def rows(name: str, matrix: object) -> list[str]:
        table = [list(map(float, row)) for row in matrix]  # type: ignore[attr-defined]
        return [
            f"  {name if i == 0 else '':14}" + " ".join(f"{value:10.4f}" for value in row)
            for i, row in enumerate(table)
        ]

    def poles(values: object) -> str:
        found = sorted({(round(v.real, 2), round(abs(v.imag), 2)) for v in values})  # type: ignore[attr-defined]
        return ", ".join(f"{re:.2f}" + (f" ± {im:.2f}j" if im > 0.005 else "") for re, im in found)

    return "\n".join(
        [
            f"LQR on {gains.model.structure.base.upper()}, rates 1, flapping 0.001, input cost {gains.input_cost:g}",
            *rows("K", gains.K),
            *rows("observer L", gains.observer_gain),
            *rows("prefilter g", gains.prefilter),
            f"  poles         {poles(gains.poles)} 1/s",
            f"  observer      {poles(gains.observer_poles)} 1/s",
            *_loop_lines(gains.loop),
        ]
    )


def _loop_lines(loop: ClosedLoop) -> list[str]:
    """Margins, and of what; or that there are none."""

    def named(effects: Sequence[str]) -> str:
        return ", ".join(Path(one).name for one in effects)

    if loop.margins is None:
        lines = ["NOT held: no margins"]
    else:
        lines = [f"held: {loop.margins.words} in both commands"]
        if not loop.margins.sensible:
            lines.append("that is thin: a higher input cost leaves more, and sampling takes its share of the delay")
    lines += [f"with {named(loop.effects)} in the loop"] if loop.effects else []
    lines += [f"without {named(loop.left_out)}: small motion does not show it"] if loop.left_out else []
    lines += ["it drifts, slower than 0.5 Hz, which the rates do not show: the pilot holds it"] if loop.drifts else []
    return [f"  {'loop' if k == 0 else '':14}{line}" for k, line in enumerate(lines)]


def runs_of(fit: Fit, which: Sequence[RecordUsed]) -> list[Record]:
    """The records a fit was made from, read again from their logs.

    Raises TippathError where a log is gone or is not the same bytes any more, or where the window leaves nothing.
    """
    from gcs.logs import ingest

    profile = None if fit.profile is None else Path(fit.profile)
    logs: dict[str, tuple[set[str], dict[str, Record | None]]] = {}
    found: list[Record] = []
    for one in which:
        if not one.path or not Path(one.path).exists():
            raise TippathError(f"{one.id}: its log {one.path or '(unknown)'} is not there any more")
        if one.path not in logs:
            read = ingest([Path(one.path)], profile, fit.window_s, f_high_hz=fit.band_hz[1])
            logs[one.path] = ({source.sha256 for source in read.sources}, {run.id: run.record for run in read.runs})
        digests, records = logs[one.path]
        if one.sha256 not in digests:
            raise TippathError(f"{one.id}: {one.path} is not the log this fit was made from any more")
        record = records.get(one.id)
        if record is None:
            ends = (
                "" if fit.window_s is None else " in " + ":".join("" if s is None else f"{s:g}" for s in fit.window_s)
            )
            raise TippathError(f"{one.id}: {one.path} has no such run in {ends} s; --window START:STOP takes it in")
        found.append(record)
    return found
