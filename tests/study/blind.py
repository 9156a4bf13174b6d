"""Blind flights: the simulated vehicle hides something, its log is ingested, and the diagnosis is asked.

Truth and question meet only here, in the judge. Run as a program it flies a list of cases on all cores and appends one
line of JSON each; what the file holds already is not flown again. A flight that fails, ends its process or takes too
long is a line with its reason. `judge` counts them, of any number of files.

    python tests/study/blind.py FILE.jsonl --first 1000000 --count 300      # one in three the simulated vehicle's
    python tests/study/blind.py FILE.jsonl --first 1000 --count 300 --budget 60     # as many as begin in an hour
    python tests/study/blind.py FILE2.jsonl --first 1000 --count 300 --part 2/2     # the second half, beside the first
    python tests/study/blind.py FILE.jsonl --first 1000000 --quotas         # strange vehicles, so many of each kind
    python tests/study/blind.py FILE.jsonl --first 1000000 --roc 50         # each of ROC on so many strange vehicles
    python tests/study/blind.py FILE.jsonl --first 0 --seeds 3 [--only NAME,...] [--plant hover-ideal|forward]
"""

from __future__ import annotations

import argparse
import fcntl
import json
import math
import random
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, TextIO

import numpy as np
from workers import cores, worked_off

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
QUOTAS: Mapping[tuple[str, bool], int] = {
    ("none", True): 600,
    ("none", False): 600,
    ("catalogue", True): 370,
    ("catalogue", False): 385,
    ("beyond", True): 195,
    ("beyond", False): 80,
    ("two", True): 58,
    ("two", False): 22,
}
"""(what is hidden, whether the excitation is logged): flights. One in six of the catalogue is too small to be seen."""
OF_A_VERDICT = (
    "verdict", "reason", "effect", "stands_in", "chain", "indistinguishable", "indistinguishable_pairs", "equivalent",
    "confidence",
)  # fmt: skip
"""What is kept of an answer before it was asked what matters."""
SHOWN = 8
LONGEST_S = 900.0
"""Of wall-clock, for a flight and its diagnosis."""
STRANGER = "stranger"
"""The plant of a case that `strangers` draws, vehicle and all."""
ONE_IN = 3
"""Of mixed cases, the simulated vehicle's."""
CLEAN, TWO = 0.35, 0.08
"""Shares of those with nothing hidden, and with two at once."""
ROC = ("servo_lag", "transport_delay", "servo_backlash", "servo_deadband", "inertia_coupling", "dynamic_inflow")
"""Whose sizes are asked for from too small to plain."""


@dataclass(frozen=True)
class Case:
    plant: str
    names: tuple[str, ...]
    """What is hidden: none, one, or two at once; a stranger without names hides what its seed says."""
    seed: int
    scale: float = 1.0
    gusts: float = 1.0
    condition: str | None = None

    @property
    def key(self) -> str:
        """What tells it from every other."""
        return json.dumps(asdict(self))


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
    from strangers.asking import asked_with

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
        second = asked_with((*base.effects, found.effect), on_runs("tpp", (), runs, fitted), fitted, judging)
    return found, second, taken


def told(found: Any) -> dict[str, Any]:
    """What is kept of a diagnosis."""
    document: dict[str, Any] = found.to_json()
    document["candidates"] = [one for one in document["candidates"] if one["delta_bic"] is not None][:SHOWN]
    document["pairs"] = document["pairs"][:3]
    document["E0"], document["N"] = found.parent.error_share, found.noise_share
    return document | _numbers("parent", found.parent.model, found.parent.estimate.covariance)


def _numbers(of: str, model: Any, covariance: Any) -> dict[str, Any]:
    """A model's values and standard errors by name."""
    names, variances = model.structure.names, np.diag(covariance)
    return {
        of: dict(zip(names, map(float, model.values), strict=True)),
        f"{of}_errors": {name: math.sqrt(x) for name, x in zip(names, variances, strict=True) if x > 0},
    }


def run(case: Case) -> dict[str, Any]:
    answer: dict[str, Any] = {"case": asdict(case), "key": case.key}
    try:
        if case.plant == STRANGER:
            return answer | _strange(case)
        with tempfile.TemporaryDirectory() as folder:
            begin = time.process_time()
            log, hidden = fly(case, Path(folder))
            answer |= {"hidden": hidden, "flight_seconds": time.process_time() - begin}
            found, second, seconds = ask(case, log)
        answer.update(told(found))
        answer["second"] = None if second is None else told(second)
        answer["seconds"] = seconds
    except Exception as error:  # a case that fails is counted as one
        answer["failed"] = f"{type(error).__name__}: {error}"
    return answer


def _strange(case: Case) -> dict[str, Any]:
    """A vehicle that nobody knows: its truth, and what is said of it."""
    from strangers.asking import ask as ask_strange
    from strangers.asking import fit as fit_strange
    from strangers.flights import fly as fly_strange

    begin = time.process_time()
    flown = fly_strange(case.seed, case.names)
    answer = {
        "flight_seconds": time.process_time() - begin,
        "case": asdict(replace(case, names=flown.hidden.names or ("none",), gusts=flown.plan.weather.gusts)),
        "hidden": flown.hidden.to_json(),
        "detectability": flown.detectability,
        "flight": flown.plan.to_json(),
    }
    try:
        said = ask_strange(flown)
        fit = None if flown.hidden.names else fit_strange(flown)
    except Exception as error:
        return answer | {"failed": f"{type(error).__name__}: {error}"}
    second = None if said.second is None else told(said.second)
    document = None if said.whole is None else said.whole.to_json()
    whole = None if document is None else {name: document[name] for name in OF_A_VERDICT}
    numbers = {} if fit is None else _numbers("fit", fit.model, fit.covariance)
    asked = {"second": second, "unweighed": whole, "clocks": said.clocks, "seconds": said.seconds}
    return answer | told(said.first) | numbers | asked


def mixed(first: int, count: int) -> Iterator[Case]:
    """One case for each seed: strange vehicles, and the simulated one in ONE_IN."""
    for seed in range(first, first + count):
        yield _simulated(seed) if seed % ONE_IN == 0 else Case(STRANGER, (), seed)


def _simulated(seed: int) -> Case:
    """What the simulated vehicle hides by this seed."""
    from sitl.hidden import names
    from sitl.plants.conditions import CONDITIONS

    source = random.Random(seed)
    plant, kind = source.choice(("hover-ideal", "forward")), source.random()
    scale, gusts = source.choice((0.6, 1.0, 1.5)), source.choice((0.5, 1.0, 2.0))
    if kind < CLEAN:
        return Case(plant, ("none",), seed, 1.0, gusts, source.choice(list(CONDITIONS)))
    if kind < CLEAN + TWO:
        return Case("hover-ideal", source.choice(PAIRS), seed, scale, min(gusts, 1.0))
    return Case(plant, (source.choice([name for name in names(plant) if name != "none"]),), seed, scale, gusts)


def to_quotas(
    first: int, quotas: Mapping[tuple[str, bool], int], kind_of: Callable[[int], tuple[str, bool]]
) -> Iterator[Case]:
    """The first seeds of each kind, and whoever stops early has about the same share of every one.

    `kind_of`: what a seed hides and whether it logs its excitation.
    """
    seeds: dict[tuple[str, bool], list[int]] = {kind: [] for kind in quotas}
    seed = first
    while any(len(seeds[kind]) < count for kind, count in quotas.items()):
        kind = kind_of(seed)
        if len(seeds.get(kind, ())) < quotas.get(kind, 0):
            seeds[kind].append(seed)
        seed += 1
    places = ((number / quotas[kind], seed) for kind, some in seeds.items() for number, seed in enumerate(some))
    return (Case(STRANGER, (), seed) for _, seed in sorted(places))


def kind_of_stranger(seed: int) -> tuple[str, bool]:
    """What it hides, and whether it logs its excitation."""
    from strangers.flights import planned

    plan = planned(seed)
    return plan.kind, plan.excitation_logged


def of_sizes(first: int, count: int, names: Sequence[str]) -> Iterator[Case]:
    """Each of these on so many strange vehicles, and as many with what their seeds say, clean ones among them."""
    for seed in range(first, first + count):
        yield from (Case(STRANGER, (name,), seed) for name in names)
        yield Case(STRANGER, (), seed)


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


def done_already(file: Path) -> set[str]:
    """Keys of the cases that a file holds; a line that was cut off counts as none."""
    if not file.exists():
        return set()
    text = file.read_text(encoding="utf-8")
    if text and not text.endswith("\n"):  # whoever wrote it was stopped
        text = text[: text.rfind("\n") + 1]
        file.write_text(text, encoding="utf-8")
    kept = [json.loads(line) for line in text.splitlines()]
    return {str(one.get("key") or Case(**{**one["case"], "names": tuple(one["case"]["names"])}).key) for one in kept}


def asked_for(args: argparse.Namespace) -> Iterator[Case]:
    only = [name for name in args.only.split(",") if name]
    if args.quotas:
        every = to_quotas(args.first, QUOTAS, kind_of_stranger)
    elif args.roc:
        every = of_sizes(args.first, args.roc, only or ROC)
    elif args.count is not None:
        every = mixed(args.first, args.count)
    else:
        every = cases(args.plant.split(","), args.first, args.seeds, only, args.clean)
    return (case for case in every if _wanted(case, args.strangers, args.longest))


def _wanted(case: Case, strangers: bool, longest_s: float | None) -> bool:
    from strangers.flights import planned

    if case.plant != STRANGER:
        return not strangers and longest_s is None
    return longest_s is None or planned(case.seed, case.names).card[0].duration_s <= longest_s


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("file", type=Path)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--count", type=int, help="cases, one for each seed: strange vehicles and the simulated one")
    parser.add_argument("--strangers", action="store_true", help="of those the strange vehicles alone")
    parser.add_argument("--longest", type=float, help="strange vehicles alone, with chirps of so many seconds at most")
    parser.add_argument("--quotas", action="store_true", help="strange vehicles, as many of each kind as are judged")
    parser.add_argument("--roc", type=int, default=0, help="flights of each size study")
    parser.add_argument("--seeds", type=int, default=1, help="of every name of the simulated vehicle, once each")
    parser.add_argument("--clean", type=int, default=0)
    parser.add_argument("--only", default="")
    parser.add_argument("--plant", default="hover-ideal,forward")
    parser.add_argument("--workers", type=int, default=cores())
    parser.add_argument("--budget", type=float, help="minutes of wall-clock after which no flight begins")
    parser.add_argument("--part", type=part, default=(1, 1), help="K/N: the K-th of every N cases; FILE is its own")
    args = parser.parse_args()
    todo = list(asked_for(args))[args.part[0] - 1 :: args.part[1]]
    return fly_all(todo, args.file, args.workers, args.budget)


def part(text: str) -> tuple[int, int]:
    """Of `2/3`. Raises ValueError."""
    k, n = map(int, text.split("/"))
    if not 1 <= k <= n:
        raise ValueError(f"{text} is no part")
    return k, n


def fly_all(cases: Sequence[Case], file: Path, workers: int, budget_min: float | None = None) -> int:
    """Fly those that the file does not hold; the exit status."""
    with file.open("a", encoding="utf-8") as stream:
        try:
            fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            print(f"{file} is being written by another process: give this one a file of its own", file=sys.stderr)
            return 2
        kept = done_already(file)
        todo = [case for case in cases if case.key not in kept]
        left = len(todo) - _flown_into(stream, todo, workers, None if budget_min is None else 60 * budget_min)
    if left:
        print(f"\nThe time is spent: {left} not flown. The same command goes on.", file=sys.stderr)
    return 0


def _flown_into(stream: TextIO, todo: Sequence[Case], workers: int, budget_s: float | None) -> int:
    """Writes each answer as it comes; how many came."""
    number = 0
    for case, answer in worked_off(todo, run, workers=workers, longest_s=LONGEST_S, budget_s=budget_s):
        number += 1
        whole = {"case": asdict(case), "key": case.key} | answer
        stream.write(json.dumps(whole) + "\n")
        stream.flush()
        print(f"\r{number} of {len(todo)}", end="", file=sys.stderr)
    return number


if __name__ == "__main__":
    tests = Path(__file__).resolve().parents[1]
    sys.path[:0] = [str(tests.parent), str(tests)]  # the packages, and `flying` as the tests see it
    sys.exit(main())
