"""A card is offered to those whose vehicle flies cards."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from gcs.analysis import diagnosis
from gcs.vehicle.sweeps import flies_cards
from sysid.diagnose.next_maneuver import NextManeuver

CARD = {"name": "next", "maneuver": []}


@pytest.mark.parametrize("source", ["SIDD", "RATE", "IMU", "ATTITUDE", "HIGHRES_IMU"])
def test_ardupilot_flies_them(source: str) -> None:
    assert flies_cards(source)


@pytest.mark.parametrize(
    "source",
    [
        "gyroADC",
        "vehicle_angular_velocity",
        "sensor_combined",
        "fixedFrequency",
        "IMU_GYRO",
        "STAB_ATTITUDE",
        "csv",
        "",
    ],
)
def test_others_and_nobody_knows_whose_do_not(source: str) -> None:
    assert not flies_cards(source)


@pytest.mark.parametrize(("sources", "card"), [(["SIDD", "SIDD"], CARD), (["gyroADC"], None), (["SIDD", "csv"], None)])
def test_the_maneuver_is_told_in_either_case(
    sources: list[str], card: dict[str, Any] | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Users of Betaflight were told to write a card, which `tippath sweep` does not fly for them."""
    told: Any = SimpleNamespace(kind="a plan")
    proposed = NextManeuver(proposal=told, separates=("a", "b"), why=told, sigma=3.0, card=CARD)
    monkeypatch.setattr(diagnosis, "_next", lambda found: proposed)
    records = [SimpleNamespace(rate_source=source) for source in sources]
    found: Any = SimpleNamespace(parent=SimpleNamespace(dataset=SimpleNamespace(records=records)))
    given = diagnosis._by_card_or_hand(found)
    assert given is not None
    assert given.card == card
    assert given.proposal is told
