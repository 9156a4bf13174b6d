"""Cards for ArduPilot: its own, and the paper's as far as it can fly them, by consent."""

from __future__ import annotations

from pathlib import Path

import pytest
from fake_flight import FakeSession, FakeVehicle

from gcs.cards.maneuver import Maneuver, TestCard, load_card, parse_card
from gcs.errors import UsageError
from gcs.flight.folder import create
from gcs.flight.prepare import prepared
from gcs.flight.sweep import fly_card
from gcs.vehicle.profile import CannotFlyError, load_profile
from gcs.vehicle.translate import NO_NOISE, translate

ARDUPILOT, TABLE_1 = load_profile("arducopter"), load_profile("table1")
QUAD, HELI, PLANE = 2, 4, 1


def stock(**more: float) -> FakeSession:
    """An ArduCopter without Table 1's excitation."""
    vehicle = FakeVehicle()
    vehicle.parameters = {name: v for name, v in vehicle.parameters.items() if not name.startswith("SIDX")}
    vehicle.parameters |= more
    return FakeSession(vehicle)


def test_the_readmes_card_is_flown_as_far_as_ardupilot_can() -> None:
    card = load_card("hover")
    made = translate(card, ARDUPILOT)
    assert [(m.kind, m.axis, m.repeat, m.noise_fraction) for m in made.card.maneuvers] == [
        ("chirp", "roll", 2, 0.0),
        ("chirp", "pitch", 2, 0.0),
    ]
    assert len(made.left_out) == 3
    assert made.left_out[0] == NO_NOISE
    assert made.left_out[1].startswith("roll doublet: this vehicle (ArduPilot) flies chirp by itself, no doublet")
    assert parse_card(made.card.text, "again").maneuvers == made.card.maneuvers, "what is kept is what is flown"


@pytest.mark.parametrize("name", ["hover", "quick", "lqr-doublet", "forward"])
def test_nothing_is_left_out_where_the_vehicle_flies_all(name: str) -> None:
    made = translate(load_card(name), TABLE_1)
    assert made.card is load_card(name) or made.card == load_card(name)
    assert made.left_out == ()


def test_a_card_of_which_nothing_is_left_is_refused() -> None:
    with pytest.raises(CannotFlyError, match=r"nothing of this card can be flown: roll rate doublet: .*; pitch rate"):
        translate(load_card("lqr-doublet"), ARDUPILOT)


def test_nonsense_is_not_left_out_but_told() -> None:
    nonsense = Maneuver(kind="chirp", axis="roll", amplitude=0.1, duration_s=3.0, noise_fraction=0.0)
    with pytest.raises(CannotFlyError, match="no two periods"):
        translate(TestCard(name="x", maneuvers=(nonsense,)), ARDUPILOT)


@pytest.mark.parametrize("kind", ["heli", "quad"])
@pytest.mark.parametrize("quick", ["", "-quick"])
def test_ardupilots_own_cards_are_flown_whole(kind: str, quick: str) -> None:
    card = load_card(f"ardupilot-{kind}{quick}")
    assert translate(card, ARDUPILOT).left_out == ()
    planned = [(run, ARDUPILOT.plan(run.maneuver)) for run in card.runs()]
    numbers = [plan.axis_number for _, plan in planned]
    assert numbers == ([10, 11, 7, 8] if quick else [10, 10, 11, 11, 7, 8])
    assert [run.maneuver.purpose for run, _ in planned][-2:] == ["validate", "validate"]
    for run, plan in planned:
        magnitude = dict(plan.writes)["SID_MAGNITUDE"]
        assert not ARDUPILOT.dangerous(plan.axis_number, magnitude)
        assert magnitude == pytest.approx(10.0 if plan.axis_number in (7, 8) else 0.05, rel=0.01)
        if quick:
            assert 8.0 <= run.maneuver.duration_s <= 15.0


@pytest.mark.parametrize(("kind", "name"), [(HELI, "ardupilot-heli"), (QUAD, "ardupilot-quad"), (PLANE, None)])
def test_the_vehicles_own_card_is_its_kinds(kind: int, name: str | None) -> None:
    assert ARDUPILOT.own_card(kind) == name
    assert TABLE_1.own_card(kind) is None


def test_yaw_is_flown_on_the_vehicles_own_axis() -> None:
    yaw = Maneuver(kind="chirp", axis="yaw", amplitude=0.05, duration_s=30.0, noise_fraction=0.0)
    assert ARDUPILOT.plan(yaw).axis_number == 12
    rate = Maneuver(kind="chirp", axis="yaw", amplitude=0.175, duration_s=30.0, noise_fraction=0.0, target="rate")
    assert ARDUPILOT.plan(rate).axis_number == 9
    assert ARDUPILOT.axes["thrust"] == 13
    with pytest.raises(CannotFlyError, match="not yaw"):
        TABLE_1.plan(yaw)


def test_nothing_is_left_out_without_consent() -> None:
    session, asked = stock(), []

    def refuse(left_out: tuple[str, ...]) -> bool:
        asked.append(left_out)
        return False

    with pytest.raises(CannotFlyError, match=r"cannot fly all of the card: .*no doublet.*--leave-out flies the rest"):
        prepared(session, load_card("hover"), consent=refuse, clock=session)
    assert len(asked) == 1
    assert session.vehicle.written == []


def test_without_a_card_the_vehicles_own_is_flown() -> None:
    session = stock()
    ready = prepared(session, None, consent=lambda _: False, clock=session)
    assert (ready.card.name, ready.left_out) == ("ArduPilot helicopter", ())
    bundled = FakeSession(FakeVehicle())
    with pytest.raises(UsageError, match="what to fly"):
        prepared(bundled, None, consent=lambda _: False, clock=bundled)
    assert prepared(bundled, None, consent=lambda _: False, clock=bundled, otherwise=load_card("quick")).card.name


def test_what_was_left_out_is_told_in_the_flights_file(tmp_path: Path) -> None:
    session = stock()
    session.vehicle.parameters["SIDX_KIND"] = 0.0  # the fake's own, which ArduPilot's profile never writes
    folder, left_out = create(tmp_path / "flight"), ("roll doublet: no doublet",)
    chirp = Maneuver(kind="chirp", axis="roll", amplitude=0.05, duration_s=5.0, f_start_hz=2.0, noise_fraction=0.0)
    card = TestCard(name="one", maneuvers=(chirp,))
    fly_card(session, card, ARDUPILOT, folder=folder, clock=session, disk_free=lambda _: 10**12, left_out=left_out)
    about = folder.read()
    assert about["left_out"] == list(left_out)
    assert (about["log"], about["runs"][0]["ending"]) == ("stream", "finished")
