"""Better gains for ArduPilot's default ones: what `tippath design --for ardupilot` makes of a flight, on the vehicle.

Each vehicle is a quadrotor of an independent simulator that its default gains fly (`rate_loop_truth`): swept in gusts,
its log fitted, new gains designed, once within the limits that are usual (on the fit and over its bounds) and once
within the margins that the default gains have on that fit; then the truth is asked of default and new gains. One line
of JSON a vehicle; what a file holds already is not flown again.

    python tests/study/rate_gains.py FILE.jsonl --count 60 [--first 0] [--workers 1] [--budget MIN]
    python tests/study/rate_gains.py FILE.jsonl --count 0       # only the tables
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from intervals import share_of
from rate_loop_truth import SIZES, Quad, Truth, drawn, flown, truth
from workers import worked_off

from sysid.control.judgement import Limits

LONGEST_S = 900.0
SAMPLES = 40
"""Of the fit's bounds."""
ASKED = (6.0, 45.0, 10.0)
"""dB, degrees, ms; of ms at least half of the delay that is there."""
NEARLY_NONE = Limits(gain_db=0.1, phase_deg=0.1, delay_ms=0.1)
LOST = 0.9
"""Of a margin: less of it is not an equal one."""


def run(seed: int) -> dict[str, Any]:
    """A vehicle, flown, fitted, designed for and asked."""
    answer: dict[str, Any] = {"seed": seed}
    try:
        one = drawn(seed)
        default = truth(one, {})
        answer |= {"size": one.name, "quad": one.size._asdict(), "late_loops": one.late_loops, "gusts": one.gusts}
        answer["default"] = _told(default)
        with tempfile.TemporaryDirectory() as folder:
            answer |= _designed(one, Path(folder))
    except Exception as error:  # a case that fails is counted as one
        answer["failed"] = f"{type(error).__name__}: {error}"
    return answer


def _designed(one: Quad, folder: Path) -> dict[str, Any]:
    from gcs.analysis.rate_gains import ardupilot_gains
    from gcs.analysis.standing import NOT_ASKED
    from gcs.cli import main
    from sysid.errors import SysidError
    from sysid.fit.result import Fit

    path = folder / "fit.json"
    words = ["fit", str(flown(one, folder / "flight")), "--model", "multirotor", "--with", "transport_delay"]
    if main([*words, "-o", str(path)]) != 0:
        raise RuntimeError("no fit")
    fit = Fit.load(path)
    found: dict[str, Any] = {"fit": fit.model.by_name}
    default = ardupilot_gains(fit, NOT_ASKED, NEARLY_NONE, samples=0).gains.flown_loop.margins
    if default is None:
        raise RuntimeError("the fit is not held by the gains that flew")
    equal = Limits(gain_db=default.gain_db, phase_deg=default.phase_deg, delay_ms=default.delay_ms)
    for name, limits, samples in (("usual", Limits(), SAMPLES), ("equal", equal, 0)):
        try:
            gains = ardupilot_gains(fit, NOT_ASKED, limits, samples=samples)
        except SysidError as error:
            found[name] = {"refused": str(error)}
            continue
        new = {parameter: value for parameter, (_, value) in gains.changes.items()}
        found[name] = {
            "gains": new,
            "verdict": gains.new.judgement.verdict,
            "promised": gains.new.judgement.models[0].to_json(),
            "truth": _told(truth(one, new)),
        }
    return found


def _told(found: Truth | None) -> dict[str, Any] | None:
    """JSON knows no infinity."""
    if found is None:
        return None
    return {name: min(value, 1e3) if isinstance(value, float) else value for name, value in asdict(found).items()}


def table(answers: Sequence[dict[str, Any]]) -> str:
    """What the vehicles' answers come to."""
    failed = [one for one in answers if "failed" in one]
    good = [one for one in answers if "failed" not in one]
    lines = [
        f"{len(answers)} vehicles, {len(failed)} failed" + "".join(f"\n  {x['seed']}: {x['failed']}" for x in failed)
    ]
    for name, words in (
        ("usual", "within 6 dB, 45 degrees, 10 ms"),
        ("equal", "within the margins of the default gains"),
    ):
        designed = [one for one in good if "truth" in one.get(name, {})]
        refused = sum("refused" in one.get(name, {}) for one in good)
        lines.append(f"{words}: {len(designed)} designed, {refused} refused")
        if designed:
            lines += _of_design(designed, name)
    return "\n".join(lines)


def _of_design(designed: Sequence[dict[str, Any]], name: str) -> list[str]:
    held = [one for one in designed if one[name]["truth"] is not None]
    lines = [f"  held by the vehicle                      {share_of(len(held), len(designed))}"]
    kept = [one for one in held if _has(one[name]["truth"], _asked(one, name))]
    lines.append(f"  with the margins asked for, in truth     {share_of(len(kept), len(designed))}")
    lines.append("  rejection, Hz (median; default, new, new over default with its quartiles)")
    for size in (*SIZES, None):
        of = [one for one in held if size in (None, one["size"])]
        if of:
            old, new = (
                np.array([_rejects(each) for each in x])
                for x in zip(*((o["default"], o[name]["truth"]) for o in of), strict=True)
            )
            low, middle, high = np.quantile(new / old, (0.25, 0.5, 0.75))
            better = int(np.sum(new > 1.02 * old))
            lines.append(
                f"    {size or 'all':8} {len(of):3d}  {np.median(old):6.2f} {np.median(new):6.2f}   {middle:5.2f} "
                f"({low:.2f} to {high:.2f}), more by 2 % in {better}"
            )
    thin = [one for one in held if not _has(one["default"], _asked(one, "usual"))]
    lines.append(f"  default gains that have less than 6 dB, 45 degrees, 10 ms: {len(thin)} of {len(held)}")
    return lines


def _asked(one: dict[str, Any], name: str) -> tuple[float, float, float]:
    if name == "usual":
        late_ms = 2.5 * one["late_loops"]
        return ASKED[0], ASKED[1], max(ASKED[2], 0.5 * late_ms)
    default = one["default"]
    return LOST * default["gain_db"], LOST * default["phase_deg"], LOST * default["delay_ms"]


def _has(found: dict[str, Any], asked: tuple[float, float, float]) -> bool:
    each = (found["gain_db"], found["phase_deg"], found["delay_ms"])
    return all(value >= least for value, least in zip(each, asked, strict=True))


def _rejects(found: dict[str, Any]) -> float:
    """Hz, geometric mean of both axes."""
    return math.sqrt(math.prod(found["rejection_hz"]))


def lines_of(path: Path) -> list[dict[str, Any]]:
    return [json.loads(line) for line in path.read_text("utf-8").splitlines()] if path.exists() else []


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("file", type=Path)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--count", type=int, default=60)
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--budget", type=float, help="minutes, after which no vehicle begins")
    args = parser.parse_args()
    known = {one["seed"] for one in lines_of(args.file)}
    todo = [seed for seed in range(args.first, args.first + args.count) if seed not in known]
    budget_s = None if args.budget is None else 60 * args.budget
    with args.file.open("a", encoding="utf-8") as file:
        for seed, answer in worked_off(todo, run, workers=args.workers, longest_s=LONGEST_S, budget_s=budget_s):
            file.write(json.dumps({"seed": seed} | answer, allow_nan=False) + "\n")
            file.flush()
            print(f"{seed}: {answer.get('failed', 'done')}", file=sys.stderr)
    print(table(lines_of(args.file)))


if __name__ == "__main__":
    main()
