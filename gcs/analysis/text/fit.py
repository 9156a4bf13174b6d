"""A fit in the engineers' tables, and TPP beside CD in the paper's: 78 columns."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any

from gcs.analysis.fits import GUIDE_CRAMER_RAO, GUIDE_INSENSITIVITY, PAPER_PARAMETERS, Identification, Judgement
from gcs.analysis.ladder import rung_names
from gcs.analysis.quantities import decimals
from gcs.analysis.text.blocks import wrapped
from gcs.analysis.text.checks import check_text, checks_document
from sysid.compare.metrics import GOOD_COST, Difference, Mismatches
from sysid.data.band import Band, BandFrom
from sysid.data.preprocess import DEFAULT_BAND_HZ
from sysid.fit.checks import Check
from sysid.fit.estimate import Instrument
from sysid.fit.implied import Implied
from sysid.fit.result import HIGH_CORRELATION, Fit
from sysid.response.values import LEAST_COHERENCE

# What the paper found on the real vehicle; shown beside, never mixed in.

PAPER_MODES = {"tpp": ((1.64, 0.39), (5.04, 0.22)), "cd": ((1.54, 0.35),)}

PAPER_NRMSE = {
    ("tpp", "chirps"): (77.8, 77.3),
    ("cd", "chirps"): (77.2, 25.9),
    ("tpp", "doublets"): (77.6, 64.7),
    ("cd", "doublets"): (76.7, 20.0),
}

MODEL_ERROR = "(± model): what clocks may be off, and what frequencies and runs disagree about"

BAND_REASONS = {
    BandFrom.GIVEN: "as asked for",
    BandFrom.SWEPT: "what was swept",
    BandFrom.NOISE: "the usual one, for the chirps were flown with noise on them",
    BandFrom.NOISE_LOST: "up to the sweep's end, for the log lost samples of the noise that was flown on it",
    BandFrom.COHERENT: "no sweep is known, there the rates follow the commands",
    BandFrom.USUAL: "the usual one, for no sweep and no coherence tell of another",
}

INSTRUMENTS: Mapping[Instrument | None, str] = MappingProxyType(
    {
        "excitation rebuilt": "feedback is kept out by the excitation, rebuilt from the chirp's settings",
        "prediction error": "feedback is kept out by predicting the noise, for no excitation serves as instrument",
        "commands": "no excitation is logged, and no feedback is kept out: none shows, or none that can be predicted",
    }
)
"""What is told of how feedback was kept out of the values, where no excitation was logged."""


def identification_text(found: Identification) -> str:
    """The paper's Tables 2, 3 and 4 with ours beside, and the eigenfrequency check; first the band where it is another
    than the paper's."""
    tables = [nrmse_table(found), modes_table(found), parameter_table(found), checks_text(found.checks)]
    return "\n\n".join([*another_band(found.tpp), *tables])


def another_band(fit: Fit) -> list[str]:
    """The band and why it is this, where it is another than the paper's; else nothing."""
    if fit.band_from is None or fit.band_hz == DEFAULT_BAND_HZ:
        return []
    return [band_line(fit.band_hz, fit.band_from)]


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
        for index, axis in enumerate(found.tpp.model.structure.outputs):
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
    """Table 4: parameters with standard errors, and with model errors where the fits have them."""
    as_paper = not found.tpp.model.structure.composed
    judged = bool(found.tpp.model_errors or found.cd.model_errors)
    head = "std. err. (± model)" if judged else "standard error"
    room = 19 if judged else 14
    lines = [f"parameter{'value':>18} ± {head:{room}}  unit{'          paper' if as_paper else ''}"]
    for fit, paper in ((found.tpp, PAPER_PARAMETERS["tpp"]), (found.cd, PAPER_PARAMETERS["cd"])):
        structure = fit.model.structure
        beside = [f" {theirs:10.3f}" for theirs in paper] if as_paper else [""] * len(structure.names)
        for parameter, value, error, theirs in zip(
            structure.parameters, fit.model.values, fit.standard_errors, beside, strict=True
        ):
            label = f"{structure.base_.label:3} {parameter.name:6}"
            digits = _digits(error)
            spread = f"{error:.{digits}f}{_model_spread(fit, parameter.name)}"
            lines.append(f"  {label:12} {value:12.{digits}f} ± {spread:{room}}  {parameter.unit:8}{theirs}".rstrip())
    if judged:
        lines += wrapped(MODEL_ERROR, "  ", "    ")
    return "\n".join(lines)


def judgement_document(judged: Judgement) -> dict[str, Any]:
    """Keys that are added to the fit's document."""
    measured = judged.responses.measured
    return {
        "guides": {
            "cramer_rao_percent": GUIDE_CRAMER_RAO,
            "insensitivity_percent": GUIDE_INSENSITIVITY,
            "coherence": LEAST_COHERENCE,
            "cost": GOOD_COST,
        },
        "responses": [response.to_json() for response in judged.responses.each],
        "onboard_responses": [response.to_json() for response in judged.onboard],
        "responses_reference": dict(zip(measured.commands, measured.references, strict=True)),
        "checks": checks_document(judged.checks),
        "spread": None if judged.spread is None else judged.spread.to_json(),
        "low_edges": None if judged.low_edges is None else judged.low_edges.to_json(),
        "implied": [figure.to_json() for figure in judged.implied],
    }


def checks_text(checks: Sequence[Check]) -> str:
    """One line a check: ✓ passed, ✗ failed, ? not possible."""
    marks = {True: "✓", False: "✗", None: "?"}
    lines = ["eigenfrequency check"]
    for one in checks:
        lines += wrapped(f"{marks[one.passed]} {one.name}: {check_text(one)}", "  ", "    ")
    return "\n".join(lines)


def fit_text(
    fit: Fit, checks: Sequence[Check], responses: Mismatches | None = None, *, onboard: Sequence[Difference] = ()
) -> str:
    """One fit for people; 78 columns."""
    structure = fit.model.structure
    count = f"{len(fit.records)} run{'s' if len(fit.records) != 1 else ''}"
    title = f"{' + '.join([structure.base_.label, *structure.effects])} fitted to {count}"
    lines = [*wrapped(f"{title}, {fit.band_hz[0]:g}-{fit.band_hz[1]:g} Hz", rest="  ")]
    lines += [] if fit.band_from is None else wrapped(band_line(fit.band_hz, fit.band_from), "  ", "    ")
    lines += [] if fit.instrument not in INSTRUMENTS else wrapped(INSTRUMENTS[fit.instrument], "  ", "    ")
    lines += [""]
    lines.append(f"NRMSE fit, %  {''.join(f'{name:>7}   ' for name in structure.outputs)}".rstrip())
    lines.append(f"  fitted      {_by_output(fit.nrmse_percent)}")
    if fit.validation_nrmse_percent is not None:
        lines.append(f"  validation  {_by_output(fit.validation_nrmse_percent)}")
    lines += ["", "natural modes       frequency, Hz   damping ratio"]
    lines += [f"  {mode.frequency_hz:26.3f}        {mode.damping_ratio:8.3f}" for mode in fit.model.modes]
    if structure.outside_matrices:
        named = ", ".join(Path(one).name for one in structure.outside_matrices)
        lines += wrapped(f"not in them, for it acts on the commands before: {named}", "  ", "  ")
    if not fit.stable:
        lines.append("  not stable: see the warnings")
    lines += ["", *_parameters(fit)]
    if len(fit.lineage) > 1:
        lines += ["", f"{'ladder':28}{''.join(f'{name:>9} ' for name in structure.outputs)}".rstrip()]
        names = rung_names(structure.base_, [rung.effects for rung in fit.lineage])
        for name, rung in zip(names, fit.lineage, strict=True):
            lines.append(f"  {name:26} {'  '.join(f'{value:8.1f}' for value in rung.nrmse_percent.values())}")
    if responses is not None:
        lines += ["", responses_text(responses)]
    if onboard:
        lines += ["", *onboard_lines(onboard)]
    if checks:
        lines += ["", checks_text(checks)]
    for text in fit.warnings:
        lines += ["", *wrapped(f"warning: {text}", rest="  ")]
    return "\n".join(lines)


def band_line(band_hz: Band, source: BandFrom) -> str:
    """`band 0.5 to 10 Hz: what was swept`."""
    return f"band {band_hz[0]:.3g} to {band_hz[1]:.3g} Hz: {BAND_REASONS[source]}"


def _by_output(nrmse_percent: Mapping[str, float]) -> str:
    return "   ".join(f"{value:7.1f}" for value in nrmse_percent.values())


def _parameters(fit: Fit) -> list[str]:
    """Values with standard errors and the engineers' two figures, what is to be said of a value on a line below it."""
    structure, judged = fit.model.structure, bool(fit.model_errors)
    width = max(12, *(len(name) for name in structure.names))
    head = "std. err. (± model) unit     CR, % ins., %" if judged else "std. error  unit        CR, %  insens., %"
    lines = [f"  {'parameter':{width}}      value ± {head}"]
    vague, wild = fit.undetermined, fit.implausible
    for parameter, value, error, alone in zip(
        structure.parameters, fit.model.values, fit.standard_errors, fit.insensitivity_percent, strict=True
    ):
        marks = []
        number, figures, spread = f"{value:11.4f}", "", ""
        if parameter.name in fit.fixed or parameter.name in fit.at_bound:
            marks.append("held" if parameter.name in fit.fixed else "at its bound")
        elif parameter.name in vague:
            number = "not determined"
        else:
            share = 100 * error / abs(value) if value else math.inf
            figures = f"{share:6.1f} {alone:7.1f}" if judged else f"{share:8.1f} {alone:9.1f}"
            if share > GUIDE_CRAMER_RAO or alone > GUIDE_INSENSITIVITY:
                marks.append("above a guide")
            digits = _digits(error)
            number = f"{value:11.{digits}f}"
            spread = f"± {error:.{digits}f}{_model_spread(fit, parameter.name)}"
        if parameter.name in wild and parameter.name not in vague:
            marks.append("implausible")
        room = (21 if judged else 12) - max(0, len(number) - 11)
        lines.append(f"  {parameter.name:{width}}{number} {spread:{room}} {parameter.unit:8}{figures}".rstrip())
        if marks:
            lines.append(f"  {'':{width}}    {', '.join(marks)}")
    if judged:
        lines += wrapped(MODEL_ERROR, "  ", "    ")
    lines.append(f"  guides: CR at most {GUIDE_CRAMER_RAO:g} %, insensitivity at most {GUIDE_INSENSITIVITY:g} %")
    pairs = [f"{one} and {other} {value:+.2f}" for one, other, value in fit.correlations]
    if pairs:
        above = abs(fit.correlations[0][2]) > HIGH_CORRELATION
        said = f"correlated above {HIGH_CORRELATION:g}" if above else "largest correlation"
        lines += wrapped(f"{said}: {', '.join(pairs)}", "  ", "    ")
    return lines


def _digits(error: float) -> int:
    """Decimals of a value with this standard error; four where there is none."""
    return decimals(error) if error > 0 and math.isfinite(error) else 4


def _two_figures(size: float) -> str:
    """`110` and not `1.1e+02`."""
    return f"{float(f'{size:.2g}'):g}"


def _model_spread(fit: Fit, name: str) -> str:
    """` (± 0.6)`; nothing where the fit has no model errors."""
    one = fit.model_errors.get(name)
    return "" if one is None else f" (± {_two_figures(one.total)})"


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


def onboard_lines(found: Sequence[Difference]) -> list[str]:
    """The fit beside what the vehicle identified itself."""
    lines = [
        "model less the vehicle's own                rms        largest",
        "(PX4's autotune)        where            dB    deg     dB    deg",
    ]
    for one in found:
        name, band = f"  {one.output} per {one.command}", one.band_hz
        if band is None:
            lines.append(f"{name:24}not in this model or band")
            continue
        (dB, deg), (most_dB, most_deg) = one.rms, one.largest
        where = f"{band[0]:.2g}-{band[1]:.2g} Hz"
        lines.append(f"{name:24}{where:14}{dB:6.1f} {deg:6.0f} {most_dB:6.1f} {most_deg:6.0f}")
    return lines


def reference_text(found: Mismatches) -> str:
    """What the measured responses were taken against."""
    if found.measured.closed_loop_safe:
        return "measured against the logged excitation"
    missing = [name for name in found.measured.references if not name.startswith("excitation")]
    return f"excitation not logged for {', '.join(missing)}"


def implied_text(figures: Sequence[Implied]) -> str:
    """What the fit implies about the vehicle, beside what was measured."""
    if not figures:
        return "this structure implies nothing about the vehicle: fit with --model tpp"
    lines = ["implied by the fit        value ± std. error    measured"]
    for one in figures:
        error = one.standard_error
        digits = 3 if error is None else _digits(error)
        spread = "" if error is None else f"± {error:.{digits}f}"
        measured = "" if one.measured is None else f"{one.measured:.4g}"
        lines.append(f"  {one.name:20} {one.value:8.{digits}f} {spread:14}{measured:>9} {one.unit}".rstrip(" -"))
        if one.implausible:
            lines += wrapped(
                "implausible: a clue that something is missing, or the vehicle file is off", " " * 6, " " * 6
            )
    if not any(one.name == "Lock number" for one in figures):
        lines += wrapped("without the rotor speed (channel omega, or omega in the file) no Lock number", "  ", "  ")
    return "\n".join(lines)
