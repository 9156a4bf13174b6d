"""Flights with a hidden effect over the link, in real time, all by the commands that a user types.

    python tests/study/over_the_link.py DIR --first 100900 --count 10 [--at-once 5]

Each flight: `sim --hidden random`, `sweep --card hover`, `fit`, `diagnose`, `reveal`. One line of JSON each goes to
DIR/flights.jsonl: what `reveal` judged.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

WITHIN_S = 900.0


def tippath(*words: str) -> dict[str, Any]:
    """One command with --json, and its document."""
    done = subprocess.run(
        [sys.executable, "-m", "gcs.cli", *words, "--json"],
        capture_output=True,
        text=True,
        timeout=WITHIN_S,
        check=False,
    )
    if done.returncode:
        raise RuntimeError(f"tippath {words[0]}: exit {done.returncode}: {done.stderr.strip()[-300:]}")
    document: dict[str, Any] = json.loads(done.stdout)
    return document


def flight(folder: Path, seed: int) -> dict[str, Any]:
    folder.mkdir(parents=True)
    answer: dict[str, Any] = {"seed": seed}
    vehicle = subprocess.Popen(
        [
            *(sys.executable, "-m", "gcs.cli", "sim", "--hidden", "random", "--seed", str(seed)),
            *("--listen", "udpout:127.0.0.1:0", "-o", str(folder / "vehicle"), "--json"),
        ],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
        start_new_session=True,
    )
    try:
        assert vehicle.stdout is not None
        text = ""
        while True:  # the document ends where its braces close
            text += vehicle.stdout.readline()
            try:
                ready = json.loads(text)
                break
            except ValueError:
                if vehicle.poll() is not None:
                    raise RuntimeError("the vehicle did not come up") from None
        swept = tippath("sweep", "--connect", ready["ground_link"], "--card", "hover", "-o", str(folder / "flight"))
        log = folder / "flight" / "flight.BIN"
        runs = [run for run in tippath("ingest", str(log))["runs"] if run["usable"]]
        chirps = [run["id"] for run in runs if run["maneuver"] == "chirp"]
        others = [run["id"] for run in runs if run["maneuver"] == "doublet"]
        named = (
            [f"{log}#{one.rpartition('#')[2]}" for one in chirps],
            [f"{log}#{one.rpartition('#')[2]}" for one in others],
        )
        fit, said = folder / "tpp.json", folder / "vehicle" / "diagnosis.json"
        tippath("fit", *named[0], "--model", "tpp", "--validate", *named[1], "-o", str(fit))
        document = tippath("diagnose", str(fit))
        said.write_text(json.dumps(document), encoding="utf-8")
        answer.update({"runs": len(swept["runs"]), "verdict": document["verdict"], "effect": document["effect"]})
        answer["confidence"] = document["confidence"]
        answer["revealed"] = tippath("reveal", str(folder / "vehicle"))
    except (RuntimeError, subprocess.TimeoutExpired, OSError, KeyError) as error:
        answer["failed"] = f"{type(error).__name__}: {error}"
    finally:
        vehicle.terminate()  # a shell in the background leaves SIGINT unheard
        try:
            vehicle.wait(20.0)
        except subprocess.TimeoutExpired:
            vehicle.kill()
    return answer


def main() -> int:
    parser = argparse.ArgumentParser()
    parser.add_argument("folder", type=Path)
    parser.add_argument("--first", type=int, default=900)
    parser.add_argument("--count", type=int, default=10)
    parser.add_argument("--at-once", type=int, default=5)
    args = parser.parse_args()
    args.folder.mkdir(parents=True, exist_ok=True)
    seeds = range(args.first, args.first + args.count)
    with (args.folder / "flights.jsonl").open("a") as stream, ThreadPoolExecutor(args.at_once) as pool:
        for done in pool.map(lambda seed: flight(args.folder / str(seed), seed), seeds):
            stream.write(json.dumps(done) + "\n")
            stream.flush()
            print(done)
    return 0


if __name__ == "__main__":
    sys.exit(main())
