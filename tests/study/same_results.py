"""Do two checkouts of the repository say the same of the same flights? Verdicts, numbers, documents, pages.

    python tests/study/same_results.py fly FLIGHTS      # twenty flights of the simulated vehicle, once
    python tests/study/same_results.py answer CHECKOUT FLIGHTS ANSWERS [--data REAL_LOGS] [--jobs 2]
    python tests/study/same_results.py compare ANSWERS_BEFORE ANSWERS_AFTER [--within 1e-6]

`answer` runs the commands of CHECKOUT (this Python, its code) on every flight and keeps what they print; what is kept
already is not asked again. `compare` lists every difference and ends with 1 where there is one. A number differs where
it is off by more than `--within` of the larger of itself and 1; a text where a word of it differs.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import json
import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

WITHIN = 1e-6
NEW_EACH_TIME = {"version"}
"""Keys of documents that tell what they were made by."""
SEED = 20
HOVER = ((0, 10, 0.10, 15.0), (0, 10, 0.10, 15.0), (0, 11, 0.15, 15.0), (0, 11, 0.15, 15.0))
HOVER_JUDGING = ((0, 10, 0.05, 8.0), (1, 10, 0.10, 5.0), (1, 11, 0.15, 5.0))
FORWARD = ((0, 10, 0.10, 15.0), (0, 11, 0.15, 15.0), (0, 20, 0.30, 15.0)) * 2
FORWARD_JUDGING = ((0, 10, 0.05, 10.0), (0, 11, 0.075, 10.0), (0, 20, 0.15, 10.0))
"""Kind (chirp, doublet), axis, amplitude, seconds."""


@dataclass(frozen=True)
class Flight:
    plant: str
    hidden: str | None = None
    """A name that `sitl.hidden` knows; None hides nothing."""

    @property
    def name(self) -> str:
        return f"{self.plant}-{self.hidden or 'plain'}"

    @property
    def fitted(self) -> tuple[tuple[int, int, float, float], ...]:
        return FORWARD if self.plant == "forward" else HOVER

    @property
    def judging(self) -> tuple[tuple[int, int, float, float], ...]:
        return FORWARD_JUDGING if self.plant == "forward" else HOVER_JUDGING


FLIGHTS = (
    Flight("hover"),
    Flight("hover-ideal"),
    *(
        Flight("hover-ideal", name)
        for name in (
            "second_order_flapping", "dynamic_inflow", "rotor_speed", "hub_gyroscopics", "quadratic_damping",
            "speed_stability", "inertia_coupling", "yaw_coupling", "structural_mode", "servo_lag",
            "servo_second_order", "transport_delay", "servo_rate_limit", "servo_backlash", "gyro_misalignment",
        )
    ),
    Flight("forward"),
    Flight("forward", "sideslip"),
    Flight("forward", "airspeed_scaling"),
)  # fmt: skip
"""Twenty: nothing hidden on each plant, and one of each kind of effect."""
REAL_FITS = {
    "heli": ("ardupilot/heli_roll_sweep.BIN", "ardupilot/heli_pitch_sweep.BIN"),
    "quad": ("ardupilot/quad_roll_sweep.BIN", "ardupilot/quad_pitch_sweep.BIN"),
    "crazyflie": ("crazyflie/roll_pitch_pilot_mapped.csv",),
}
HELPS = ("ingest", "fit", "effects", "compare", "diagnose", "add", "design", "report", "sweep", "sim")
LOG_ENDINGS = {".bin", ".log", ".ulg", ".tlog", ".csv", ".data", ".bbl"}


# ---------------------------------------------------------------------------------------------------- the flights


def fly(folder: Path) -> None:
    """Every flight that is not there yet, as fast as it computes."""
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
    from flying import fly_maneuver, log_of

    from sitl.autopilot.vehicle import make_vehicle
    from sitl.hidden import plant_one

    for flight in FLIGHTS:
        target = folder / f"{flight.name}.BIN"
        if target.exists():
            continue
        hidden = None if flight.hidden is None else plant_one(flight.hidden, SEED, flight.plant)
        with tempfile.TemporaryDirectory() as flown:
            vehicle = make_vehicle(flight.plant, SEED, directory=Path(flown), hidden=hidden)
            for maneuver in (*flight.fitted, *flight.judging):
                fly_maneuver(vehicle, *maneuver)
            target.write_bytes(log_of(vehicle, Path(flown)).read_bytes())
        print(f"{flight.name}: {target.stat().st_size / 1e6:.1f} MB", flush=True)


# ---------------------------------------------------------------------------------------------------- the answers

Commands = list[list[str]]


def commands_on(flight: Flight, folder: Path, whole: bool) -> Commands:
    """What is asked of a flight; `whole` asks the page with its diagnosis and the reasons in words, too."""
    log = str(folder / f"{flight.name}.BIN")
    split = len(flight.fitted)
    runs = [f"{log}#{number}" for number in range(1, split + len(flight.judging) + 1)]
    base = ["--with", "angular_damping,elevator"] if flight.plant == "forward" else []
    asked = [
        ["ingest", log, "--json"],
        *([] if base else [["fit", *runs[:split], "--model", "cd", "--json", "-o", "cd.json"]]),
        ["fit", *runs[:split], "--model", "tpp", *base, "--validate", *runs[split:], "--json", "-o", "tpp.json"],
        ["compare", "tpp.json", "--json"],
        ["compare", "tpp.json", *runs[split:]],
        ["diagnose", "tpp.json", "--json"],
        ["report", "tpp.json", "-o", "page.html", *([] if whole else ["--no-diagnosis"])],
    ]
    return [*asked, ["diagnose", "tpp.json", "--explain"]] if whole else asked


def commands_on_real(name: str, data: Path) -> Commands:
    logs = [str(data / one) for one in REAL_FITS[name]]
    return [
        ["fit", *logs, "--model", "tpp", "--json", "-o", "tpp.json"],
        ["compare", "tpp.json", "--json"],
        ["diagnose", "tpp.json", "--json"],
        ["report", "tpp.json", "-o", "page.html", "--no-diagnosis"],
    ]


def questions(flights: Path, data: Path | None) -> dict[str, Commands]:
    """Name of a case -> its commands, in order."""
    asked = {
        flight.name: commands_on(flight, flights, number % 4 == 0)
        for number, flight in enumerate(FLIGHTS)
        if (flights / f"{flight.name}.BIN").exists()
    }
    asked["words"] = [["effects", "--json"], ["effects", "servo_lag"], *([name, "--help"] for name in HELPS)]
    if data is not None:
        asked |= {f"real-{name}": commands_on_real(name, data) for name in REAL_FITS}
        for log in sorted(path for path in data.rglob("*") if path.suffix.lower() in LOG_ENDINGS):
            asked[f"log-{log.stem}"] = [["ingest", str(log), "--json"], ["ingest", str(log), "--explain"]]
    return asked


def answer(checkout: Path, flights: Path, answers: Path, data: Path | None, jobs: int) -> None:
    """Ask `checkout` everything, a process a case; ANSWERS/case.json keeps what was printed."""
    answers.mkdir(parents=True, exist_ok=True)

    def ask(case: tuple[str, Commands]) -> str:
        name, commands = case
        target = answers / f"{name}.json"
        if target.exists():
            return f"{name}: kept"
        surroundings = os.environ | {
            "PYTHONPATH": str(checkout), "TIPPATH_CACHE": "off", "OPENBLAS_NUM_THREADS": "1", "COLUMNS": "80"
        }  # fmt: skip
        with tempfile.TemporaryDirectory() as folder:
            done = subprocess.run(
                [sys.executable, str(Path(__file__).resolve()), "inside", str(checkout)],
                input=json.dumps(commands),
                cwd=folder,
                env=surroundings,
                capture_output=True,
                text=True,
                check=False,
            )
        if done.returncode:
            return f"{name}: FAILED\n{done.stderr}"
        target.write_text(done.stdout, encoding="utf-8")
        return f"{name}: asked"

    with ThreadPoolExecutor(jobs) as pool:
        for line in pool.map(ask, questions(flights, data).items()):
            print(line, flush=True)


def inside(checkout: Path) -> None:
    """In a process of its own, with the checkout's packages: commands from standard input, answers to its output."""
    sys.path[:] = [str(checkout), *(one for one in sys.path if one != str(Path(__file__).parent))]
    import gcs.cli

    if not Path(gcs.cli.__file__).is_relative_to(checkout):
        raise SystemExit(f"{gcs.cli.__file__} is not of {checkout}")
    told = []
    for words in json.loads(sys.stdin.read()):
        out, err = io.StringIO(), io.StringIO()
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
            try:
                status = gcs.cli.main(words)
            except SystemExit as stop:
                status = int(stop.code or 0)
        page = Path("page.html")
        told.append(
            {
                "command": " ".join(words),
                "status": status,
                "out": json.loads(out.getvalue()) if "--json" in words and status == 0 else out.getvalue(),
                "err": err.getvalue(),
                "page": page.read_text(encoding="utf-8") if words[0] == "report" and page.exists() else None,
            }
        )
    json.dump(told, sys.stdout)


# ---------------------------------------------------------------------------------------------------- the comparison

_NUMBER = re.compile(r"[-−+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?")
_DRAWING = re.compile(r'<metadata>.*?</metadata>|(?:id|clip-path|xlink:href)="[^"]*"|url\(#[^)]*\)', re.DOTALL)
"""What a drawing names anew each time."""


def differences(before: Any, after: Any, within: float, where: str = "") -> Iterator[str]:
    """A line for each place where two documents differ."""
    if isinstance(before, dict) and isinstance(after, dict):
        for key in sorted(before.keys() | after.keys()):
            if key in NEW_EACH_TIME:
                continue
            if key not in after:
                yield f"{where}.{key}: gone"
            elif key not in before:
                yield f"{where}.{key}: new"
            else:
                yield from differences(before[key], after[key], within, f"{where}.{key}")
    elif isinstance(before, list) and isinstance(after, list):
        if len(before) != len(after):
            yield f"{where}: {len(before)} entries, then {len(after)}"
        for number, (one, other) in enumerate(zip(before, after, strict=False)):
            yield from differences(one, other, within, f"{where}[{number}]")
    elif isinstance(before, str) and isinstance(after, str):
        yield from differing_text(before, after, within, where)
    elif _is_number(before) and _is_number(after):
        if off(before, after) > within:
            yield f"{where}: {before!r}, then {after!r}"
    elif before != after:
        yield f"{where}: {before!r}, then {after!r}"


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def off(before: float, after: float) -> float:
    """How far apart, of the larger of the first and 1."""
    return 0.0 if before == after else abs(before - after) / max(1.0, abs(before))


def differing_text(before: str, after: str, within: float, where: str) -> Iterator[str]:
    """Lines whose words or numbers differ; drawings without the names that are new each time."""
    first, second = (_DRAWING.sub("", text).splitlines() for text in (before, after))
    if len(first) != len(second):
        yield f"{where}: {len(first)} lines, then {len(second)}"
    for number, (one, other) in enumerate(zip(first, second, strict=False), 1):
        if one == other:
            continue
        same_words = _NUMBER.sub("#", one) == _NUMBER.sub("#", other)
        pairs = zip(_NUMBER.findall(one), _NUMBER.findall(other), strict=False)
        if not same_words or any(off(_read(a), _read(b)) > within for a, b in pairs):
            yield f"{where} line {number}: {one.strip()[:160]!r}, then {other.strip()[:160]!r}"


def _read(number: str) -> float:
    return float(number.replace("−", "-"))


def compare(before: Path, after: Path, within: float) -> int:
    """Print every difference and a count; how many cases differ."""
    names = sorted({path.name for folder in (before, after) for path in folder.glob("*.json")})
    differing = verdicts = 0
    for name in names:
        if not ((before / name).exists() and (after / name).exists()):
            print(f"{name}: only in {before if (before / name).exists() else after}")
            differing += 1
            continue
        first, second = (json.loads((folder / name).read_text(encoding="utf-8")) for folder in (before, after))
        lines = list(_of_case(first, second, within))
        answered = [
            [(told["out"]["verdict"], told["out"]["effect"]) for told in document if _diagnosed(told)]
            for document in (first, second)
        ]
        verdicts += answered[0] == answered[1]
        differing += bool(lines)
        print(f"{name}: {'same' if not lines else f'{len(lines)} differences'}  {answered[1] or ''}")
        for line in lines:
            print(f"    {line}")
    print(f"{len(names)} cases: {len(names) - differing} the same, verdicts equal in {verdicts}")
    return differing


def _diagnosed(answered: dict[str, Any]) -> bool:
    return isinstance(answered["out"], dict) and answered["out"].get("format") == "tippath.diagnosis/1"


def _of_case(before: list[dict[str, Any]], after: list[dict[str, Any]], within: float) -> Iterator[str]:
    if len(before) != len(after):
        yield f"{len(before)} commands, then {len(after)}"
    for one, other in zip(before, after, strict=False):
        for line in differences(one, other, within):
            yield f"{one['command'].split()[0]}{line}"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    ways = parser.add_subparsers(dest="way", required=True)
    flying = ways.add_parser("fly")
    flying.add_argument("flights", type=Path)
    asking = ways.add_parser("answer")
    for name in ("checkout", "flights", "answers"):
        asking.add_argument(name, type=Path)
    asking.add_argument("--data", type=Path)
    asking.add_argument("--jobs", type=int, default=2)
    comparing = ways.add_parser("compare")
    comparing.add_argument("before", type=Path)
    comparing.add_argument("after", type=Path)
    comparing.add_argument("--within", type=float, default=WITHIN)
    within = ways.add_parser("inside")
    within.add_argument("checkout", type=Path)
    given = parser.parse_args()
    if given.way == "fly":
        given.flights.mkdir(parents=True, exist_ok=True)
        fly(given.flights.resolve())
    elif given.way == "answer":
        data = None if given.data is None else given.data.resolve()
        answer(given.checkout.resolve(), given.flights.resolve(), given.answers.resolve(), data, given.jobs)
    elif given.way == "inside":
        inside(given.checkout)
    else:
        return int(compare(given.before, given.after, given.within) > 0)
    return 0


if __name__ == "__main__":
    sys.exit(main())
