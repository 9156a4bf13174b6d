"""A year of two vehicles, one with a change and one with a drift, and 100 campaigns in which nothing changed.

Every flight is flown by the simulated vehicle without a clock, its log read and fitted as `tippath campaign` does. The
null campaigns draw flights (whole fits with their covariance) from a pool that flew with unchanged vehicles, on dates
of their own: resampled, since 20,000 flights would take an hour and a half.
"""

from __future__ import annotations

import time
from datetime import UTC, datetime, timedelta
from pathlib import Path

import msgspec
import numpy as np
import pytest
from flying import CHIRP, PITCH, ROLL, fly_maneuver, log_of

from gcs.campaign.findings import found
from gcs.campaign.given import Given
from gcs.campaign.groups import placed
from gcs.campaign.page import write_page
from gcs.campaign.sentences import event_sentence
from gcs.campaign.when import When
from gcs.campaign.work import Outcome, Settings, worked_on
from sitl.autopilot.vehicle import make_vehicle
from sitl.plants.hover import HoverPlant
from sitl.plants.table4 import TABLE_4

PLANT = "hover-ideal"
FLIGHTS, POOL, NULLS = 200, 160, 100
BEGIN = datetime(2026, 1, 3, 10, tzinfo=UTC)
CHANGED_DAY, CHANGED = 150, -0.06
"""Another blade on the first vehicle: M_a;"""
DRIFT = -0.10
"""and L_b of the second, in a year."""
FIRST_SEED = 40_000
MOST_FALSE = 5


def fly(folder: Path, name: str, seed: int, monkeypatch: pytest.MonkeyPatch, *, L_b: float = 1.0, M_a: float = 1.0,
        sweeps: bool = True) -> Path:  # fmt: skip
    """One short flight of a vehicle with these of its numbers multiplied."""
    table = TABLE_4._replace(L_b=L_b * TABLE_4.L_b, M_a=M_a * TABLE_4.M_a)
    (folder / name).mkdir(parents=True)
    with monkeypatch.context() as patch:
        patch.setattr(HoverPlant.__init__, "__defaults__", (table,))
        vehicle = make_vehicle(PLANT, seed=seed, directory=folder / name)
        for axis, size in ((ROLL, 0.10), (PITCH, 0.15)) if sweeps else ():
            fly_maneuver(vehicle, CHIRP, axis, size, 6.0)
        for _ in range(0 if sweeps else 3000):
            vehicle.step()
        log = log_of(vehicle, folder / name)
    path = folder / f"{name}.BIN"
    log.replace(path)
    return path


def study_campaign(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    chance, began = np.random.default_rng(FIRST_SEED), time.process_time()
    days = np.sort(chance.integers(0, 365, FLIGHTS))
    groups: dict[str, list[Outcome]] = {"A": [], "B": []}
    for number, day in enumerate(days):
        vehicle, date = "AB"[number % 2], BEGIN + timedelta(days=int(day))
        path = fly(
            tmp_path,
            f"{date:%Y-%m-%d}-{vehicle}-{number:03d}",
            FIRST_SEED + number,
            monkeypatch,
            M_a=1 + CHANGED * (vehicle == "A" and day >= CHANGED_DAY),
            L_b=1 + DRIFT * day / 365.25 * (vehicle == "B"),
            sweeps=number not in (17, 90),
        )
        if number in (40, 41):
            path.write_bytes(chance.bytes(20_000))
        if number == 60:
            path.write_bytes(path.read_bytes()[: path.stat().st_size // 8])
        groups[vehicle].append(worked_on(path, Settings()))
        if number != 30:
            path.unlink()
    copied = next(tmp_path.glob("*-030.BIN"))
    groups["A"].append(worked_on(copied.rename(tmp_path / f"2026-12-01-copy-of-{copied.name[11:]}"), Settings()))
    each_s = (time.process_time() - began) / FLIGHTS
    failed = [one for some in groups.values() for one in some if one.fit is None]
    groups = {vehicle: list(placed(each, Given())) for vehicle, each in groups.items()}
    said = found(groups, 1)
    write_page(said, groups, failed, tmp_path / "campaign.html")
    print(f"\n{FLIGHTS} flights of two 6 s sweeps, {each_s:.2f} CPU s each, flown, read and fitted")
    for event in said.events:
        print("  ", event_sentence(event))
    print("   goes with:", [(one.group, one.parameter, one.condition) for one in said.goes_with])
    print("   apart:", [(one.group, one.parameters) for one in said.apart])
    print("   without a fit:", [(Path(one.path).name, one.reason, one.words[:60]) for one in failed])
    false = _nulls(tmp_path, chance, monkeypatch)
    print(
        f"{NULLS} null campaigns of {FLIGHTS} flights: {false} with any claim; {time.process_time() - began:.0f} CPU s"
    )
    step, drift = said.events
    assert (step.group, step.kind, step.named, step.sizes[0].parameter) == ("A", "step", "one", "M_a")
    begin = int(BEGIN.timestamp() // 86400)
    assert step.days[0] < begin + CHANGED_DAY <= step.days[1]
    assert (drift.group, drift.kind, drift.named, drift.sizes[0].parameter) == ("B", "drift", "one", "L_b")
    assert len(failed) >= 4
    assert len(said.copies) == 1
    assert false <= MOST_FALSE


def _nulls(folder: Path, chance: np.random.Generator, monkeypatch: pytest.MonkeyPatch) -> int:
    """How many of the campaigns in which nothing changed claim a change of anything."""
    pool = []
    for number in range(POOL):
        path = fly(folder, f"2026-01-01-null-{number}", FIRST_SEED + 1000 + number, monkeypatch)
        pool.append(worked_on(path, Settings()))
        path.unlink()
    return sum(found(_null(pool, chance), seed).claims > 0 for seed in range(NULLS))


def _null(pool: list[Outcome], chance: np.random.Generator) -> dict[str, list[Outcome]]:
    """Two vehicles, flights drawn from the pool, on days of a year."""
    groups = {}
    for vehicle in "AB":
        drawn = chance.integers(0, len(pool), FLIGHTS // 2)
        days = chance.integers(0, 365, FLIGHTS // 2)
        groups[vehicle] = [
            msgspec.structs.replace(
                pool[i], key=f"{place:064x}", seen=f"{place}", sketch=(), path=f"{vehicle}{place}",
                when=When(utc=(BEGIN + timedelta(days=int(day))).isoformat(timespec="seconds"), told_by="name"),
            )
            for place, (i, day) in enumerate(zip(drawn, days, strict=True))
        ]  # fmt: skip
    return groups
