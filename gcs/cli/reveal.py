"""`tippath reveal`: open the sealed answer of a vehicle with a hidden effect, and see who was right."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from gcs.cli.options import print_json


def add_parser(subparsers: Any) -> None:
    parser: argparse.ArgumentParser = subparsers.add_parser(
        "reveal",
        help="open the sealed answer of a --hidden vehicle",
        description="Open the answer that `tippath sim --hidden` sealed in DIR, and hold it against the diagnoses "
        "(tippath.diagnosis/1) that lie there as *.json or are named besides. The SHA-256 is that of the file: it must "
        "be the one that was printed when it was sealed.",
        epilog='--json prints {"format": "tippath.reveal/1", "sha256", "plant", "seed", "condition", "hidden": its own '
        'name, "answer": catalogue id or null, "accepts": [ids], "level": "catalogue" | "below" | "beyond" | "none", '
        '"sizes": {name: value}, "expect": {parameter: value}, "sentence", "diagnoses": [{"path", "verdict", "effect", '
        '"outcome": "right" | "same" | "not_told_apart" | "stand_in" | "missed" | "wrong", '
        '"parameters": [{"name", "said", "truth"}]}]}.',
    )
    parser.add_argument("directory", type=Path, metavar="DIR", help="where `tippath sim --hidden` put its logs")
    parser.add_argument("diagnoses", type=Path, nargs="*", metavar="DIAGNOSIS.json", help="that lie elsewhere")
    parser.add_argument("--json", action="store_true", help="print one JSON document")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    from gcs.demo.revealed import revealed_words
    from gcs.demo.seal import judge_folder, open_answer

    answer = open_answer(args.directory)
    judgements = judge_folder(answer, args.diagnoses)
    if args.json:
        print_json(
            {
                "format": "tippath.reveal/1",
                "sha256": answer.sha256,
                **{name: value for name, value in answer.document.items() if name != "format"},
                "diagnoses": [one.to_json() for one in judgements],
            }
        )
    else:
        print("\n".join(revealed_words(answer, judgements)))
    return 0
