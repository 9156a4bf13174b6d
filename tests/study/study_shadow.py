"""600 destabilising and 600 good sets of gains over recorded sweeps of vehicles with 0 to 50 ms that nobody knows of:
what is cleared, what is refused; and what a bank that ran without authority adds.

Sets are drawn until there are so many; each is asked over sweeps to 10 Hz, as the paper's, and where these do not
measure it, once more over sweeps as far as was asked for. Truth is the vehicle's own eigenvalues (`shadow_vehicles`).
The file named by SHADOW (`shadow.jsonl`) is resumed: a line a vehicle.
"""

from __future__ import annotations

import json
import math
import os
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
from intervals import share_of
from shadow_vehicles import DT, FAULTS, Bank, Vehicle, asked_for, bank, good, growth, ran, swept, vehicle

from sysid.control.judgement import Limits
from sysid.control.measured_stability import MeasuredStability, measured_stability
from sysid.control.regulator import Gains
from sysid.control.shadow import RanStretch, faults_of
from sysid.control.stability import ClosedLoop
from sysid.data.record import Record
from sysid.model.paper import TPP
from sysid.model.structure import Model
from sysid.response.flown import flown_responses
from sysid.response.values import Responses

SETS = 600
OF_ONE_VEHICLE = 3
"""Sets of each kind."""
DRAWN = 24
FARTHEST_HZ, STEP_HZ = 40.0, 5.0
FAULTS_EACH = 2
FIRST_SEED = 300_000
SWEPT_HZ = (0.5, 10.0)
KINDS = ("destabilising", "good")


def as_gains(one: Bank) -> Gains:
    model = Model(TPP, TPP.vector(one.model))
    none = np.zeros(4)
    return Gains(
        model=model,
        K=one.K,
        observer_gain=one.L,
        prefilter=one.prefilter,
        poles=none,
        observer_poles=none,
        input_cost=float("nan"),
        loop=ClosedLoop(None),
    )


def responses(runs: list[dict[str, Any]], band_hz: tuple[float, float]) -> Responses:
    records = [
        Record(f"#{k}", run, maneuver="chirp", axis=axis, swept_band_hz=band_hz)
        for k, (run, axis) in enumerate(zip(runs, ("roll", "pitch"), strict=True))
    ]
    return flown_responses(records, band_hz).responses


def judged(one: Bank, measured: Responses) -> MeasuredStability:
    gains = as_gains(one)
    return measured_stability(gains, gains.model, measured, Limits(), DT)


def kind_of(flies: Vehicle, one: Bank) -> str:
    if growth(flies, one) >= 0:
        return "destabilising"
    return "good" if good(flies, one) else "thin"


class Sweeps:
    """Responses of one vehicle by how far it is swept; flown where they are asked for."""

    def __init__(self, flies: Vehicle, rng: np.random.Generator) -> None:
        self._flies, self._rng = flies, rng
        self._known: dict[float, Responses] = {}

    def to(self, stop_hz: float) -> Responses:
        if stop_hz not in self._known:
            runs = swept(self._flies, self._rng, stop_hz=stop_hz)
            self._known[stop_hz] = responses(runs, (SWEPT_HZ[0], stop_hz))
        return self._known[stop_hz]


def asked_twice(one: Bank, measured: Responses, sweeps: Sweeps) -> tuple[str, str]:
    """The verdict at first, and after a sweep at least as far as was asked for."""
    found = judged(one, measured)
    asked = max((each.sweep_to_hz or 0.0 for each in found.not_measured if each.why == "edge"), default=0.0)
    if found.verdict != "not measured" or not 0 < asked <= FARTHEST_HZ:
        return found.verdict, found.verdict
    return found.verdict, judged(one, sweeps.to(STEP_HZ * math.ceil(asked / STEP_HZ))).verdict


def beside(one: Bank, run: dict[str, Any], fault: str | None) -> tuple[bool, list[str]]:
    """Whether a bank that ran with this fault is refused, and what is said."""
    over = RanStretch(
        rates=np.stack([run["p"], run["q"]], axis=1),
        commands=np.stack([run["delta_x"], run["delta_y"]], axis=1),
        targets=asked_for(run),
        output=ran(one, run, fault),
    )
    found = faults_of(as_gains(one), DT, [over])
    return bool(found), [f"{each.place}: {each.kind}" for each in found]


def over_one(seed: int) -> dict[str, Any]:
    """All that is asked of one vehicle."""
    rng = np.random.default_rng(seed)
    flies = vehicle(rng)
    runs = swept(flies, rng)
    measured = responses(runs, SWEPT_HZ)
    sweeps = Sweeps(flies, rng)
    had: Counter[str] = Counter()
    sets, faults = [], []
    for _ in range(DRAWN):
        one = bank(flies.numbers, rng)
        kind = kind_of(flies, one)
        if had[kind] == OF_ONE_VEHICLE:
            continue
        had[kind] += 1
        first, then = asked_twice(one, measured, sweeps)
        sets.append({"kind": kind, "made": one.made, "first": first, "then": then})
        if kind == "good" and had[kind] == 1:
            chosen = [None, *rng.choice(FAULTS, FAULTS_EACH, replace=False).tolist()]
            faults = [[fault, *beside(one, runs[int(rng.integers(2))], fault)] for fault in chosen]
    return {"seed": seed, "late_by": flies.late_by, "sets": sets, "faults": faults}


def study_600_destabilising_and_600_good_sets() -> None:
    wanted = int(os.environ.get("SETS", SETS))
    path = Path(os.environ.get("SHADOW", "shadow.jsonl"))
    lines = [json.loads(line) for line in path.read_text().splitlines()] if path.exists() else []
    seed = max((one["seed"] for one in lines), default=FIRST_SEED - 1)
    while min(sum(one["kind"] == kind for line in lines for one in line["sets"]) for kind in KINDS) < wanted:
        seed += 1
        lines.append(over_one(seed))
        with path.open("a") as stream:
            stream.write(json.dumps(lines[-1]) + "\n")
    sets = [one for line in lines for one in line["sets"]]
    told(lines, sets)
    of = {kind: [one for one in sets if one["kind"] == kind][:wanted] for kind in KINDS}
    for when in ("first", "then"):
        assert not any(one[when] == "cleared" for one in of["destabilising"])
        assert sum(one[when] == "refused" for one in of["good"]) <= 0.05 * wanted
    assert all(refused == (fault is not None) for line in lines for fault, refused, _ in line["faults"])


def told(lines: list[dict[str, Any]], sets: list[dict[str, Any]]) -> None:
    print(f"\nGains over recorded sweeps of {len(lines)} vehicles, late by 0 to 50 ms that no model has")
    for kind in (*KINDS, "thin"):
        of = [one for one in sets if one["kind"] == kind]
        for when, words in (("first", "sweeps to 10 Hz"), ("then", "as far as asked")):
            counts = Counter(one[when] for one in of)
            each = "; ".join(f"{word} {share_of(counts[word], len(of))}" for word in ("cleared", "refused"))
            print(f"  {kind:14} {words:16} {each}")
        for made in sorted({one["made"] for one in of}):
            counts = Counter(one["then"] for one in of if one["made"] == made)
            print(f"    {made}: " + ", ".join(f"{count} {word}" for word, count in sorted(counts.items())))
    ran_wrong = [(fault, refused, said) for line in lines for fault, refused, said in line["faults"] if fault]
    ran_right = [refused for line in lines for fault, refused, _ in line["faults"] if not fault]
    print(f"  beside, with a fault: refused {share_of(sum(r for _, r, _ in ran_wrong), len(ran_wrong))}")
    print(f"  beside, as it should: refused {share_of(sum(ran_right), len(ran_right))}")
    missed = Counter(fault for fault, refused, _ in ran_wrong if not refused)
    print("\n".join(f"    missed: {fault} {count}" for fault, count in missed.items()) or "    none missed")
