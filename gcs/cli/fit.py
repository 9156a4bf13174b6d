"""`tippath fit`: runs to a model with numbers, errors and warnings."""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gcs.cli.exporting import EXPORT_HELP, add_export_option, refuse_results, write_export
from gcs.cli.options import (
    add_airframe_option,
    add_band_option,
    add_effects_option,
    add_log_options,
    add_loop_option,
    add_output_options,
    parse_airframe,
    parse_band,
    parse_profile,
    parse_words,
    print_json,
    write_json,
)
from sysid.model.bases import NAMES

if TYPE_CHECKING:
    from gcs.logs import AnyWindow
    from sysid.data.record import Record
    from sysid.model.base import Base
    from sysid.model.effect import Effect

_RUNS_HELP = """\
RUN is a flight folder or a log (all its usable runs), LOG#n (its n-th run, as `tippath ingest` numbers them), or a
record written by ingest. A CSV with columns t, p, q, delta_x, delta_y is one run; so is a measured frequency response
of each command (CSV, .mat, .json of `tippath response`, CIFER's).

"""
_VEHICLE_HELP = """\
VEHICLE.toml holds what was measured on the ground, in SI units; only k_beta is needed:
  k_beta = 88.0     # spring of the rotor against tilt, N m/rad
  mass = 4.5        # kg, and
  arm = 0.15        # rotor plane above the centre of mass, m: together the thrust's share in hover
  I_xx = 0.64       # kg m^2, roll
  I_yy = 0.13       # kg m^2, pitch
  omega = 172.8     # rad/s, where the runs do not log the rotor speed
From L_b and M_a follow I_xx and I_yy, from tau_f, A_b, B_a the Lock number and the flap frequency ratio. One that is
implausible, or off the measured one by more than a factor of 1.4, is a clue that something is missing.

FIT.json, which --json prints, is {"format": "tippath.fit/1", "structure", "parameters": {NAME: {"value", "unit",
"standard_error", "cramer_rao_percent", "insensitivity_percent", "at_bound", "implausible", "fixed", "determined"}},
"modes": [{"frequency_hz", "damping_ratio"}], "stable", "nrmse_percent", "validation_nrmse_percent", "records",
"validation_records", "lineage" (the fits below it), "matrices" (A, B, C, D, and "input_delay_s"), "outside_matrices"
(effects that these do not hold), "covariance", "correlations", "band_hz", "weights" (of the error: "residual spectrum"
or "constant"), "airframe", "profile", "window_s", "warnings", "version"}. It has besides "band_from" ("given", "swept",
"noise": chirps with noise on them, "noise, samples lost": the same in a log that has not every sample of it,
"coherent", or "usual") and the "airframe" of each of its records, "responses" (model less measured, in dB and degrees,
where the partial coherence is at least 0.6, and the integrated cost), "onboard_responses" (the same less what the
vehicle identified itself: PX4's autotune), "responses_reference" (by which signal each command is told), "checks",
"spread" (parameters between sets of runs, in standard errors), "low_edges" (their values if the band began higher; null
where the noise was predicted), "instrument" (what kept feedback out of the values: "excitation logged", "excitation
rebuilt" from the chirp's settings, "prediction error", the noise predicted from its past, or "commands": nothing did),
"guides", and "implied" with a vehicle file.

± in the table is the standard error: right where structure and clocks are. Behind it, (± model) is one standard
deviation of what speaks against that: stamps of commands and rates off by up to half a period of the loop (of the log,
where the loop's rate is not known), and what octaves of the band, runs and validation runs disagree about beyond
chance. "model_error" of each parameter is its size, "model_error_by" the parts: "clocks", "frequencies", "runs",
"validation". What every run and every frequency shares is not seen.
"""


def add_parser(subparsers: Any) -> None:
    parser: argparse.ArgumentParser = subparsers.add_parser(
        "fit",
        help="fit a model to runs",
        description="Fit the Tip-Path-Plane (tpp), Cylinder-Dynamics (cd) or another model to several runs together.",
        epilog=_RUNS_HELP + _VEHICLE_HELP + "\n" + EXPORT_HELP,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("runs", nargs="+", metavar="RUN")
    parser.add_argument(
        "--model",
        metavar="BASE",
        help=f"the structure to fit: {', '.join(NAMES)}, or the path of a base of your own (its code runs)",
    )
    parser.add_argument(
        "--axes",
        metavar="AXIS,...",
        help="which axes to fit, each by its own command: roll, pitch, yaw (channels r, delta_r), heave (az, delta_c), "
        "or roll,pitch together (default: all that the model has; where one alone was excited, that one)",
    )
    add_effects_option(
        parser,
        "physical effects to add, in this order: ids of `tippath effects`, or paths of your own files (their code "
        "runs); forward flight is --with angular_damping,elevator",
    )
    parser.add_argument(
        "--fix", action="append", default=[], metavar="NAME=VALUE,...", help="hold parameters at these values"
    )
    parser.add_argument(
        "--fix-from",
        action="append",
        default=[],
        metavar="FIT.json:NAME,...",
        help="hold parameters at another fit's values (the paper held L_b and M_a in forward flight)",
    )
    parser.add_argument(
        "--vehicle",
        metavar="VEHICLE.toml",
        help="what was measured on the ground, see below: print what the fit implies",
    )
    parser.add_argument(
        "--validate", nargs="+", default=[], metavar="RUN", help="runs that only judge; they never enter the fit"
    )
    add_band_option(parser)
    add_airframe_option(parser)
    add_log_options(parser)
    add_loop_option(parser)
    add_output_options(parser, "FIT.json")
    add_export_option(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    from dataclasses import replace

    from gcs.analysis.axes import alone_words, lone_axis, of_axes
    from gcs.analysis.band import chosen_band
    from gcs.analysis.fits import assess, load_vehicle
    from gcs.analysis.notes import note_lines
    from gcs.analysis.text.fit import fit_text, implied_text, judgement_document
    from gcs.analysis.vehicles import doubted, not_of_one_model, refuse_two_airframes
    from gcs.logs import FromStart, parse_window
    from sysid.data.band import USUAL, BandFrom, ChosenBand
    from sysid.data.dataset import prepared
    from sysid.fit.identify import identify
    from sysid.fit.model_error import with_model_errors
    from sysid.model.compose import compose

    asked = None if args.band is None else ChosenBand(parse_band(args.band), BandFrom.GIVEN)
    window = None if args.window is None else parse_window(args.window)
    profile = parse_profile(args.profile)
    refuse_results(args)
    vehicle = None if args.vehicle is None else load_vehicle(Path(args.vehicle))
    words = parse_words(args.effects)
    base = parse_base(args.model)
    held = parse_fixed(args.fix, args.fix_from, [word for word in (args.model, *words) if word.endswith(".py")])
    part, effects = parse_axes(base, args.axes, words, held)
    records, validation = runs_to_fit(args, profile, window, (asked or USUAL).hz[1])
    records, validation = of_axes(records, part), of_axes(validation, part)
    print_notes([*note_lines([*records, *validation]), *_not_alike([*records, *validation])])
    refuse_two_airframes([*records, *validation])
    band = asked or chosen_band(records)
    fitted = prepared(records, band.hz)
    if args.axes is None and (axis := lone_axis(base, fitted)) is not None:
        print_notes([alone_words(base, axis)])
        part, effects = parse_axes(base, axis, words, held)
    fit = identify(
        compose(part),
        fitted,
        validation,
        band.hz,
        effects=effects,
        fixed=held,
        profile=args.profile,
        window_s=None if isinstance(window, FromStart) else window,  # else the runs' own ids tell it
    )
    doubts = doubted([*records, *validation]) or not_of_one_model(fit, records)
    fit = replace(with_model_errors(fit, fitted, validation), band_from=band.source, warnings=(*doubts, *fit.warnings))
    judged = assess(fit, fitted, vehicle)
    told = {**fit.to_json(args.output.parent if args.output else Path.cwd()), **judgement_document(judged)}
    if args.output:
        write_json(told, args.output)
        print(f"wrote {args.output}", file=sys.stderr)
    write_export(args.export, fit, fitted.records)
    if args.json:
        print_json(told)
        print_notes([f"warning: {text}" for text in fit.warnings])
    else:
        print(fit_text(fit, judged.checks, judged.responses, onboard=judged.onboard))
        if vehicle is not None:
            print("\n" + implied_text(judged.implied))
    return 0


def _not_alike(records: Sequence[Record]) -> list[str]:
    """What differs among the runs, and which to leave out: before the fit takes its time."""
    from gcs.analysis.alike import alike
    from gcs.analysis.text.findings import listed_runs

    found = alike(records)
    most = (
        []
        if not found.odd or len(found.groups[0]) < 2
        else [f"alike are {listed_runs(found.groups[0])}: fit these alone"]
    )
    return [f"note: {words}" for words in (*found.told, *most)]


def runs_to_fit(
    args: argparse.Namespace, profile: Path | None, window: AnyWindow | None, f_high_hz: float
) -> tuple[list[Record], list[Record]]:
    """The runs that are fitted and those that only judge, of the airframe that is named where one is.

    Raises TippathError where nothing is left to fit.
    """
    from gcs.analysis.fits import on_airframe
    from gcs.errors import TippathError
    from gcs.logs import fitted_beside, resolve_runs

    def named(words: Sequence[str]) -> list[Record]:
        read = resolve_runs(words, profile, window, f_high_hz=f_high_hz, loop_rate_hz=args.loop_rate)
        return on_airframe(read, parse_airframe(args))

    validation = named(args.validate) if args.validate else []
    records = fitted_beside([record for record in named(args.runs) if record.maneuver != "quiet"], validation)
    if not records:
        raise TippathError("no run is left to fit: they are quiet hover or validation runs")
    return records, validation


def print_notes(lines: Sequence[str]) -> None:
    """Notes on what was read, on standard error."""
    for line in lines:
        print(line, file=sys.stderr)


def with_warnings(text: str, doubts: Sequence[str]) -> str:
    """An answer with what stands against all of it before it, in 78 columns."""
    from gcs.analysis.text.blocks import wrapped

    lines = [line for doubt in doubts for line in (*wrapped(f"warning: {doubt}", rest="  "), "")]
    return "\n".join([*lines, text])


def parse_base(word: str | None) -> Base:
    """A base by its name or path. Raises UsageError for a word that names none, BaseError for a file that is none."""
    from gcs.errors import UsageError
    from sysid.model.base import BaseError, find_base

    if word is None:
        told = "multirotor for a multirotor, tpp or cd for a helicopter; roll, pitch, yaw, heave for one axis alone"
        raise UsageError(f"which structure? Give --model: {told}")
    try:
        return find_base(word)
    except BaseError as error:
        if word.endswith(".py"):
            raise
        raise UsageError(f"--model {word}: {error}") from error


def parse_axes(
    base: Base, word: str | None, effects: Sequence[str], held: Mapping[str, float]
) -> tuple[Base, list[Effect]]:
    """A base on the axes that are named, all its own where none are, with effects as `parse_effects` has them.

    Raises UsageError for axes that the base has not, and as `parse_effects`.
    """
    from gcs.errors import UsageError
    from sysid.model.base import BaseError, on_axes

    try:
        part, contained = on_axes(base, base.axes if word is None else [axis.strip() for axis in word.split(",")])
    except BaseError as error:
        raise UsageError(f"--axes {word}: {error}") from error
    return part, parse_effects(part, [*contained, *effects], held)


def parse_effects(base: str | Base, words: Sequence[str], held: Mapping[str, float]) -> list[Effect]:
    """Effects by id or path, checked against base and held parameters before any log is read.

    Raises UsageError for words that make no sense whatever is logged, EffectError for a file that is no effect.
    """
    from gcs.errors import UsageError
    from sysid.data.record import CHANNELS
    from sysid.model.compose import compose
    from sysid.model.effect import EffectError, find

    found = []
    for word in words:
        try:
            found.append(find(word))
        except EffectError as error:
            if word.endswith(".py"):
                raise
            raise UsageError(f"--with {word}: {error}") from error
    try:
        structure = compose(base, found, CHANNELS, {"Omega_0": 1.0, "V_0": 1.0})
    except EffectError as error:
        files = [one.path for one in (base, *found) if not isinstance(one, str) and one.path is not None]
        if str(error).startswith(tuple(files)):
            raise
        raise UsageError(f"--with {','.join(words)}: {error}") from error
    parameters = {one.name: one for one in structure.parameters}
    for name, value in held.items():
        if name not in parameters:
            raise UsageError(f"--fix {name}: there is no such parameter; there are {', '.join(parameters)}")
        low, high = parameters[name].bounds
        if not low <= value <= high:
            raise UsageError(f"--fix {name}={value:g}: its equation holds from {low:g} to {high:g}")
    if len(held) == len(parameters):
        raise UsageError("--fix holds every parameter: nothing is left to fit")
    return found


def parse_fixed(words: Sequence[str], files: Sequence[str], named: Sequence[str] = ()) -> dict[str, float]:
    """`NAME=VALUE,...` and `FIT.json:NAME,...` to held values; `named` are effect files whose code may run.

    Raises UsageError for words that are neither, and for a parameter that is held twice.
    """
    from gcs.errors import UsageError
    from sysid.fit.result import Fit

    held: dict[str, float] = {}

    def hold(name: str, value: float, said: str) -> None:
        if name in held and held[name] != value:
            raise UsageError(f"{said}: {name} is held twice, at {held[name]:g} and at {value:g}")
        held[name] = value

    for word in words:
        for part in word.split(","):
            name, mark, text = part.partition("=")
            try:
                value = float(text)
            except ValueError:
                value = math.nan
            if not mark or not name.strip() or not math.isfinite(value):
                raise UsageError(f"--fix {part}: wants NAME=VALUE, such as L_b=147.5")
            hold(name.strip(), value, f"--fix {part}")
    for word in files:
        path, mark, names = word.rpartition(":")
        if not mark or not path or not all(name.strip() for name in names.split(",")):
            raise UsageError(f"--fix-from {word}: wants FIT.json:NAME,...")
        fit = Fit.load(Path(path), named)
        for name in map(str.strip, names.split(",")):
            if name not in fit.model.structure.names:
                listed = ", ".join(fit.model.structure.names)
                raise UsageError(f"--fix-from {word}: {path} has no parameter {name}; there are {listed}")
            hold(name, fit.model[name], f"--fix-from {word}")
    return held
