"""--export: a fitted model for other programs."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from gcs.cli.options import refuse_existing
from gcs.errors import UsageError
from gcs.files import write_whole

if TYPE_CHECKING:
    from sysid.data.record import Record
    from sysid.fit.result import Fit

EXPORT_HELP = """\
--export FILE writes the model for other programs; its ending says how: .mat (MATLAB 5: A, B, C, D and input_delay_s in
continuous time, states, inputs, outputs, parameter_names, _values, _units and _standard_errors, H_model, and H,
coherence, bound_db, bound_deg and valid as the runs show them, outputs x inputs x frequencies), .json (the same as
{"format": "tippath.model/1", ...}), .csv (the responses, measured and modelled: the columns of `tippath response`, then
model_db, model_deg, model_real, model_imaginary). The responses have the delay; what "outside_matrices" names besides
it, play and limits, is in none of them.
"""


def add_export_option(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--export", type=Path, metavar="FILE", help="write the model for other programs, see below: .mat, .json, .csv"
    )


def refuse_results(args: argparse.Namespace, plot: Path | None = None) -> None:
    """What -o and --export name, before long work; the plot has been looked at.

    Raises UsageError for a file that is there, is of no known kind, or is named twice.
    """
    refuse_existing(args.output, args.force)
    if args.export is not None:
        from gcs.analysis.model_files import KINDS

        if args.export.suffix.lower() not in KINDS:
            raise UsageError(f"--export {args.export}: name a file that ends in {', '.join(KINDS)}")
        refuse_existing(args.export, args.force)
    named = [path.resolve() for path in (args.output, args.export, plot) if path is not None]
    if len(set(named)) < len(named):
        raise UsageError("two results cannot be written to one file")


def write_export(path: Path | None, fit: Fit, records: Sequence[Record]) -> None:
    """The model beside what these runs show, where a file is named.

    Raises TippathError where the disk does not take it.
    """
    if path is None:
        return
    from gcs.analysis.model_files import KINDS, model_document, shown_by

    document = model_document(fit, shown_by(fit, records), path.parent)
    write_whole(KINDS[path.suffix.lower()](document), path)
    print(f"wrote {path}", file=sys.stderr)
