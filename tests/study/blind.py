"""Blind flights: the simulated vehicle hides something, its log is ingested, and the diagnosis is asked.

Truth and question meet only here, in the judge. Run as a program it flies a list of cases on all cores and appends one
line of JSON each; `study_blind` counts them.

    python tests/study/blind.py FILE.jsonl --first 0 --seeds 3 [--only NAME,...] [--plant hover-ideal|forward]
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

ROLL, PITCH, ELEVATOR = 10, 11, 20
CHIRP, DOUBLET = 0, 1
HOVER_CARD = (
    *[(CHIRP, ROLL, 0.10, 30.0, True), (CHIRP, PITCH, 0.15, 30.0, True)] * 2,
    (DOUBLET, ROLL, 0.10, 8.0, False),
    (DOUBLET, PITCH, 0.15, 8.0, False),
    (CHIRP, ROLL, 0.05, 15.0, False),
    (CHIRP, PITCH, 0.075, 15.0, False),
)
"""(kind, axis, amplitude, s, whether it is fitted): the paper's card, and half the amplitude to validate."""
FORWARD_CARD = (
    *[(CHIRP, ROLL, 0.10, 30.0, True), (CHIRP, PITCH, 0.15, 30.0, True), (CHIRP, ELEVATOR, 0.30, 30.0, True)] * 2,
    (CHIRP, ROLL, 0.05, 15.0, False),
    (CHIRP, PITCH, 0.075, 15.0, False),
    (CHIRP, ELEVATOR, 0.15, 15.0, False),
)
PAIRS = (
    ("servo_lag", "inertia_coupling"),
    ("transport_delay", "quadratic_damping"),
    ("servo_backlash", "hub_gyroscopics"),
    ("dynamic_inflow", "servo_second_order"),
    ("servo_rate_limit", "gyro_misalignment"),
    ("angular_damping", "worn_links"),
    ("structural_mode", "servo_frame"),
    ("speed_stability", "three_servo_motors"),
    ("servo_saturation", "turned_body"),
    ("inflow_in_wind_axes", "turned_chip"),
)
"""Two at once, in hover."""
FORWARD_BASE = ("angular_damping", "elevator")
SHOWN = 8


@dataclass(frozen=True)
class Case:
    plant: str
    names: tuple[str, ...]
    """What is hidden: none, one, or two at once."""
    seed: int
    scale: float = 1.0
    gusts: float = 1.0
    condition: str | None = None


def fly(case: Case, folder: Path) -> tuple[Path, list[dict[str, Any]]]:
    """Fly the card as fast as it computes; the log and what was hidden."""
    from flying import fly_maneuver, log_of

    from sitl import hidden as draws
    from sitl.autopilot.vehicle import make_vehicle

    hidden = draws.plant_one(case.names[0], case.seed, case.plant, scale=case.scale)
    known = [hidden.to_json()]
    if len(case.names) == 2:
        other = draws.plant_one(case.names[1], case.seed, case.plant, scale=case.scale)
        known.append(other.to_json())
        hidden = together(hidden, other)
    vehicle = make_vehicle(
        case.plant, case.seed, directory=folder, hidden=hidden, gust_scale=case.gusts, condition=case.condition
    )
    for kind, axis, magnitude, duration_s, _ in FORWARD_CARD if case.plant == "forward" else HOVER_CARD:
        fly_maneuver(vehicle, kind, axis, magnitude, duration_s)
    return log_of(vehicle, folder), known


def together(one: Any, other: Any) -> Any:
    """Two draws in one vehicle; parts of which there is one only come from whichever has it."""
    from sitl.plants.rotorcraft import Parts

    def build() -> Parts:
        first, second = one.build(), other.build()
        return Parts(
            actuators=(*first.actuators, *second.actuators),
            rotor=first.rotor or second.rotor,
            fuselage=first.fuselage or second.fuselage,
            loads=(*first.loads, *second.loads),
            inertia=first.inertia or second.inertia,
            gyro=(*first.gyro, *second.gyro),
        )

    conditions = {one.condition, other.condition} - {"calm"}
    condition = conditions.pop() if len(conditions) == 1 else ("lively" if conditions else "calm")
    return replace(one, build=build, condition=condition)


def ask(case: Case, log: Path) -> tuple[Any, Any, float]:
    """The diagnosis of a log by one who knows only the plant's base; with two hidden, once more with the answer added;
    and the first one's seconds of computing."""
    from gcs.logs import resolve_runs
    from sysid.diagnose.diagnose import diagnose
    from sysid.fit.identify import on_runs

    card = FORWARD_CARD if case.plant == "forward" else HOVER_CARD
    runs = resolve_runs([str(log)])
    if len(runs) != len(card):
        raise RuntimeError(f"{len(runs)} of {len(card)} runs are usable")
    fitted = [run for run, maneuver in zip(runs, card, strict=True) if maneuver[-1]]
    judging = [run for run, maneuver in zip(runs, card, strict=True) if not maneuver[-1]]
    base = on_runs("tpp", FORWARD_BASE if case.plant == "forward" else (), runs, fitted)
    begin = time.process_time()
    found = diagnose(base, fitted, judging)
    taken = time.process_time() - begin
    second = None
    if len(case.names) == 2 and found.verdict == "missing":
        again = on_runs("tpp", (*base.effects, found.effect), runs, fitted)
        second = diagnose(again, fitted, judging)
    return found, second, taken


def told(found: Any) -> dict[str, Any]:
    """What is kept of a diagnosis."""
    document = found.to_json()
    document["candidates"] = [one for one in document["candidates"] if one["delta_bic"] is not None][:SHOWN]
    document["pairs"] = document["pairs"][:3]
    document["E0"], document["N"] = found.parent.error_share, found.noise_share
    model = found.parent.model
    document["parent"] = dict(zip(model.structure.names, map(float, model.values), strict=True))
    return dict(document)


def run(case: Case) -> dict[str, Any]:
    answer: dict[str, Any] = {"case": asdict(case)}
    try:
        with tempfile.TemporaryDirectory() as folder:
            log, hidden = fly(case, Path(folder))
            answer["hidden"] = hidden
            found, second, seconds = ask(case, log)
        answer.update(told(found))
        answer["second"] = None if second is None else told(second)
        answer["seconds"] = seconds
    except Exception as error:  # a case that fails is counted as one
        answer["failed"] = f"{type(error).__name__}: {error}"
    return answer


def cases(plants: Sequence[str], first: int, seeds: int, only: Sequence[str], clean: int) -> Iterator[Case]:
    """Every name on every plant that carries it, and clean flights in every condition."""
    from sitl.hidden import names
    from sitl.plants.conditions import CONDITIONS

    for seed in range(first, first + seeds):
        for plant in plants:
            for number, name in enumerate(names(plant)):
                if name == "none" or (only and name not in only):
                    continue
                scale = (1.0, 0.6, 1.5)[(seed + number) % 3]
                gusts = (1.0, 0.5, 2.0)[(seed + number // 3) % 3]
                yield Case(plant, (name,), seed, scale, gusts)
        for number, pair in enumerate(PAIRS):
            yield Case(plants[0], pair, seed, (1.0, 0.6, 1.5)[(seed + number) % 3], (1.0, 0.5)[number % 2])
    for number in range(clean):
        plant = plants[number % len(plants)]
        condition = list(CONDITIONS)[number // len(plants) % len(CONDITIONS)]
        yield Case(plant, ("none",), first + number, 1.0, (1.0, 0.5, 2.0)[number % 3], condition)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("file", type=Path)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--clean", type=int, default=0)
    parser.add_argument("--only", default="")
    parser.add_argument("--plant", default="hover-ideal,forward")
    parser.add_argument("--workers", type=int, default=2)
    args = parser.parse_args()
    only = [name for name in args.only.split(",") if name]
    todo = list(cases(args.plant.split(","), args.first, args.seeds, only, args.clean))
    with args.file.open("a", encoding="utf-8") as stream, ProcessPoolExecutor(args.workers) as pool:
        for number, done in enumerate(as_completed([pool.submit(run, case) for case in todo]), 1):
            stream.write(json.dumps(done.result()) + "\n")
            stream.flush()
            print(f"\r{number} of {len(todo)}", end="", file=sys.stderr)
    return 0


if __name__ == "__main__":
    tests = Path(__file__).resolve().parents[1]
    sys.path[:0] = [str(tests.parent), str(tests)]  # the packages, and `flying` as the tests see it
    sys.exit(main())
