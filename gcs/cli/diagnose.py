"""`tippath diagnose`: which physical effect a fit lacks."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Collection, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gcs.cli.options import (
    add_airframe_option,
    add_effects_option,
    add_output_options,
    add_plot_option,
    add_reading_options,
    parse_airframe,
    parse_reading,
    parse_words,
    print_json,
    refuse_existing,
    refuse_plot,
    write_json,
    write_plot,
    write_text,
)

if TYPE_CHECKING:
    from gcs.analysis.diagnosis import FitDiagnosis
    from sysid.diagnose.loop_change import Limit
    from sysid.fit.result import Fit

_EPILOG = """\
RUN is a flight folder or a log (all its usable runs), LOG#n (its n-th run, as `tippath ingest` numbers them), or a
record. Without RUN the fit's own runs count, and its own validation runs; given, the fit's structure is refitted to
them first. Validation runs, of another maneuver or amplitude, never enter a fit: they tell an effect that is there
from one that only follows the noise.

Chains of two effects are searched where no single one is named, or where that leaves a twentieth of what can be
explained and at least 0.1 points of NRMSE (0.3 where these are known not to matter), or a tenth by the noise's measure:
within a budget of 300 fits of the base, and 50 for the last exchanges; what was not searched is said. Ctrl-C ends the
search of chains: what was found until then is printed, and the exit status is 130. A second one, or one before, while
single effects are asked, ends the command without an answer.

What matters is what could change the margins of the loop that `tippath design` would close on the fit by 1 dB or 5
degrees, or by --matters. What is left and seen is bounded by its 95 % limit at the loop's crossings, what is not seen
by the effects that could hide. Up to 0.3 points of fit that no effect explains and that do not matter, or up to 0.5
that no entry is likelier for and that are hardly more than chance, make a fit complete; what has a name does so only
where that is a guess and hardly more than chance, or with --matters.

Verdicts: "complete", what the model leaves is noise, or does not matter; "missing", one effect or a chain of two
removes at least 90 % of the avoidable error (80 % where no excitation is logged), half of it on validation runs, chance
taken off, at plausible values; by the noise's spectrum, where 70 % are removed or gusts leave the power uncertain;
"unexplained", there is something, and nothing in the catalogue does it. An effect that explains it at values that
physics does not allow "stands in" for something else (a moment back to level does so in free flight, and is the answer
on a tether); one whose size is another on the validation runs only resembles what is there. The reason "feedback" says
that no excitation is logged and that the loop alone could make what is left, or noise flown with chirps in a log that
lost samples of it: no alarm. With --repeat the effect is added and the question asked again, until the answer is
another one or is not sure; -o keeps the fit with all that was found.

The table has the likeliest candidates: NRMSE fit in percent, 100 is perfect, on fitted and on validation runs. The
placebo is the best wrong effect with at most as many parameters: the error falls with it, too. Confidence is how often
answers like this one were right on flights whose answer was known: the effect, or one of a class of at most three that
these runs hardly tell apart ("indistinguishable", and "indistinguishable_pairs": two effects that do together what the
one does, as a delay and an inflow what a second-order lag does); of a longer class, the effect itself. Effects that
predict the same here ("equivalent": a lag of the servos and one of the gyros) count as one.

The answer is kept beside the fit as FIT-diagnosis.json, under the next free name; `tippath design` judges gains by it.

--json prints {"format": "tippath.diagnosis/1", "fit_sha256", "structure", "models": [{"role", "effects", "model"}] (the
fit with what is missing, and with what could not be told from that), "airframe", "verdict", "effect", "chain" (one or
two, the larger first; none where complete), "stands_in", "indistinguishable", "indistinguishable_pairs", "equivalent":
{effect: [effects]}, "confidence", "lead" (over its best rival, what confidence is told by), "log10_chance" (of noise
alone), "explained_share", "needed_share" (to be named), "nrmse_percent" and "validation_nrmse_percent" (of the fit),
"candidates": [{"effect", "explained_share", "delta_bic", "nrmse_percent", "validation_nrmse_percent", "parameters",
"standard_errors", "implausible", "not_testable", ...}], best first, "pairs", "placebo", "noise_floor_percent", "terms":
[{"equation", "error_share", "as_well"}] (simple terms), "term_ahead": {"equation", "chi_squared"} (one that explains
far more than the nearest effect) or null, "beyond": [text] (what a residual looks like that no effect explains),
"sizes": [{"parameter", "fitted", "validation", "off", ...}], "could_hide": [text], "character", "next_maneuver":
{"maneuver", "separates", "why", "sigma", "card", "how" (where no card flies it), "fit_runs": [ids] (where runs that
only judged tell it)} or null, "explanation", "suspicions", "warnings", "within_points" (of NRMSE fit, that could still
be gained), "remainder" (what that could do: "seen" and "margins" with "gain_db", "phase_deg", "modes" with
"frequency_hz", "damping_ratio", by the effects "margins_effect" and "modes_effect", "limit", "matters") or null where
one is missing by name, "reason" (where the data are the cause: "clocks", of time stamps, "feedback", or null),
"instrument" (how feedback is kept out of what is asked: "excitation logged", "excitation rebuilt", "prediction error",
or not at all: "commands"), "remarks", "rungs": [{"effects", "nrmse_percent", "validation_nrmse_percent", "verdict",
"effect", "confidence"}], "slight": {"effect" (missing, or too slight to be; where it gains little), "points" (of fit
that it gains), "shift" (of a number of the base, relative, at most), "gain_db", "phase_deg", "matters"} or null,
"first_answer": {"verdict", "chain", "confidence"} (before pairs were searched) or null, "unsearched_chains":
{"reason": "little left", "points"} or {"reason": "budget" or "interrupted", "chains", "firsts"} or {"reason": "much
left", "chain", "explained"} (by the best one with the likeliest effect) or null, "asked": {"version", "as_usual",
"fixed"}, "shown" (what the app shows of it again: as it changes, this is no interface)}.
"""


def add_parser(subparsers: Any) -> None:
    parser: argparse.ArgumentParser = subparsers.add_parser(
        "diagnose",
        help="which physical effect is missing",
        description="Ask every effect of the catalogue whether it would explain what a fit leaves, refit the serious "
        "ones, and say which is missing, how sure that is, and what would make it surer.",
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("fit", type=Path, metavar="FIT.json")
    parser.add_argument("runs", nargs="*", metavar="RUN")
    parser.add_argument(
        "--validate", nargs="+", default=[], metavar="RUN", help="runs that only judge; they never enter a fit"
    )
    parser.add_argument(
        "--matters",
        metavar="LIMIT",
        help="changes of the designed loop's margins from which on something matters (1dB,5deg where left out); "
        "only where it is given, what has a name and changes less is not missing either; of a tpp fit, for which "
        "alone gains are designed",
    )
    parser.add_argument("--repeat", action="store_true", help="add the answer and ask again, showing each rung")
    parser.add_argument(
        "--explain", action="store_true", help="all reasons, what each hidden effect would do, why some are not asked"
    )
    parser.add_argument(
        "--suggest",
        type=Path,
        metavar="FILE.py",
        help="write the simple term that explains most as an effect file of your own, to try with `tippath add`",
    )
    parser.add_argument(
        "--card",
        type=Path,
        metavar="CARD.toml",
        help="write the maneuver that would tell more as a test card, to fly with `tippath sweep --card`",
    )
    add_effects_option(
        parser,
        "paths of your own files (their code runs): those that the fit uses, base or effects; others are asked as well",
    )
    add_reading_options(parser)
    add_airframe_option(parser)
    add_plot_option(parser)
    add_output_options(parser, "FIT2.json")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    from gcs.analysis.comparison import flown_with_validation
    from gcs.analysis.diagnosis import diagnose_fit
    from gcs.analysis.notes import note_lines
    from gcs.analysis.rungs import load_fit
    from gcs.analysis.text.diagnosis import diagnosis_text
    from gcs.analysis.text.documents import diagnosis_document, grown_document
    from gcs.analysis.vehicles import doubted
    from gcs.cli import EXIT_INTERRUPTED
    from gcs.cli.asking import AskingLine
    from gcs.cli.fit import print_notes, with_warnings
    from gcs.errors import UsageError
    from sysid.model.effect import load

    band, window, profile = parse_reading(args)
    refuse_plot(args.plot, args.force)
    if args.suggest is not None and args.suggest.suffix != ".py":
        raise UsageError(f"--suggest {args.suggest}: an effect's file ends in .py")
    targets = [path for path in (args.plot, args.output, args.suggest, args.card) if path is not None]
    for path in targets:
        refuse_existing(path, args.force)
    if len({path.resolve() for path in targets}) < len(targets):
        raise UsageError("two results cannot be written to one file")
    words = parse_words(args.effects)
    fit = load_fit(args.fit, words)
    used = {Path(one).resolve() for one in fit.model.structure.files}
    mine = [load(Path(word)) for word in words if Path(word).resolve() not in used]
    airframe = parse_airframe(args)
    records, validation, quiet = flown_with_validation(fit, args.runs, args.validate, profile, window, airframe)
    print_notes(note_lines([*records, *validation]))
    with AskingLine() as say:
        found = diagnose_fit(
            fit,
            records,
            validation,
            quiet,
            effects=mine,
            band_hz=band,
            repeat=args.repeat,
            suggesting=args.suggest is not None,
            limit=_limit(args.matters),
            say=say,
        )
    document = None if args.output is None else grown_document(found, args.output.parent)
    target = None if document is None else str(args.output)
    text = diagnosis_text(found, str(args.fit), rest_of(args, used), target, full=args.explain)
    doubts = doubted([*records, *validation])
    text = with_warnings(text, doubts)
    _write(args, found, document, text)
    _keep(args, found, fit, doubts)
    if args.json:
        print_json(diagnosis_document(found, doubts))
    else:
        print(text)
    return EXIT_INTERRUPTED if found.interrupted else 0


def _keep(args: argparse.Namespace, found: FitDiagnosis, fit: Fit, doubts: Sequence[str]) -> None:
    """The answer beside the fit that it is about, where `design` looks for it; not of a fit that no file holds."""
    from gcs.analysis.standing import digest
    from gcs.analysis.text.documents import diagnosis_document
    from gcs.errors import TippathError
    from gcs.flight.folder import keep

    path = args.fit if digest(found.fit) == digest(fit) else args.output
    if path is None:
        return
    try:
        kept = keep(diagnosis_document(found, doubts, path.parent), path.with_name(f"{path.stem}-diagnosis.json"))
    except TippathError as error:
        print(f"the answer is not kept beside the fit: {error}", file=sys.stderr)
    else:
        print(f"wrote {kept}", file=sys.stderr)


def _limit(words: str | None) -> Limit | None:
    """What matters, as asked for. Raises UsageError for words that say no limit."""
    from gcs.errors import UsageError
    from sysid.diagnose.loop_change import parse_limit

    try:
        return None if words is None else parse_limit(words)
    except ValueError as error:
        raise UsageError(f"--matters {words}: wants changes of margins above 0, such as 1dB,5deg") from error


def rest_of(args: argparse.Namespace, used: Collection[Path]) -> str:
    """The words of this command that the next one needs as well; of effect files those that the fit has."""
    from gcs.desk import shell

    words = [*args.runs]
    for name in ("profile", "window", "band"):
        value = getattr(args, name)
        words += [] if value is None else [f"--{name}", value]
    files = [word for word in parse_words(args.effects) if Path(word).resolve() in used]
    words += ["--with", ",".join(files)] if files else []
    words += ["--validate", *args.validate] if args.validate else []
    return shell.words(words)


def _write(args: argparse.Namespace, found: FitDiagnosis, document: Any, text: str) -> None:
    """The files asked for, or why there is nothing to write in them."""
    from gcs.analysis.pages.diagnosis import drawn
    from gcs.vehicle.sweeps import flies_cards
    from sysid.diagnose.proposals import FitRuns

    def said(path: Path, missing: str | None = None) -> None:
        print(f"wrote {path}" if missing is None else f"{path} not written: {missing}", file=sys.stderr)

    write_plot(args.plot, lambda: drawn(found), f"tippath diagnose: {args.fit.name}", text)
    if args.output is not None:
        if document is not None:
            write_json(document, args.output)
        said(args.output, None if document is not None else "nothing was found to add")
    if args.suggest is not None:
        suggestion = found.suggestion
        if suggestion is not None:
            write_text(suggestion.text, args.suggest)
            if suggestion.warning is not None:
                print(f"warning: {suggestion.warning}", file=sys.stderr)
        said(args.suggest, None if suggestion is not None else "no simple term explains anything that is left")
    if args.card is not None:
        card = None if found.next is None else found.next.toml
        if card is not None:
            write_text(card, args.card)
        theirs = all(flies_cards(one.rate_source) for one in found.last.parent.dataset.records)
        why = "no maneuver on a card would tell more" if theirs else "ArduPilot's vehicles alone fly cards"
        if found.next is not None and isinstance(found.next.proposal, FitRuns):
            why = "nothing is to be flown: runs that tell it were flown, and only judge so far"
        said(args.card, None if card is not None else why)
