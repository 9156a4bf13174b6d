"""Who else speaks on a link is shown for some seconds, and is taken for the vehicle only where that is known."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from gcs.flight.neighbours import HEARD_FOR_S, Neighbours
from gcs.link.events import Heartbeat, RadioStatus
from gcs.vehicle.snapshot import VehicleSnapshot

STATION, AUTOPILOT = (6, 8), (4, 3)


def transport(newcomer: str | None = None) -> Any:
    made = SimpleNamespace(counts=(7, 3), strangers=5, newcomer=newcomer, taken=0)

    def take_over() -> bool:
        made.taken += 1
        return True

    made.take_over = take_over
    return made


def beat(system: int, kind: tuple[int, int]) -> Heartbeat:
    return Heartbeat(system, 1, vehicle_type=kind[0], autopilot=kind[1], armed=False, mode=0, status=3)


def test_stations_vehicles_and_radios_are_counted_while_they_are_heard() -> None:
    neighbours = Neighbours(transport(), None)
    radio = RadioStatus(51, 68, here=180, there=175, noise_here=40, noise_there=38, room=90, errors=12)
    for event in (beat(255, STATION), beat(1, AUTOPILOT), beat(2, AUTOPILOT), radio):
        neighbours.hear(event, 1, 100.0)
    seen = neighbours.seen(100.0 + HEARD_FOR_S)
    assert (seen["other_stations"], seen["other_vehicles"], seen["radio"]) == (1, 1, radio)
    assert (seen["frames"], seen["bad_bytes"], seen["strangers"]) == (7, 3, 5)
    seen = neighbours.seen(100.1 + HEARD_FOR_S)
    assert (seen["other_stations"], seen["other_vehicles"], seen["radio"]) == (0, 0, None)


@pytest.mark.parametrize(
    ("signed", "recording", "taken"), [(True, False, 1), (True, True, 0), (False, False, 0), (False, True, 0)]
)
def test_a_newcomer_is_taken_unasked_only_where_it_has_the_key_and_nothing_is_recorded(
    signed: bool, recording: bool, taken: int
) -> None:
    link = transport("127.0.0.1:5000")
    signing: Any = SimpleNamespace(keep=lambda: None, refusals=tuple) if signed else None
    Neighbours(link, signing).tend(recording=recording)
    assert link.taken == taken


def test_a_newcomer_is_told_with_what_is_known_of_it() -> None:
    quiet = VehicleSnapshot(system=3, component=1)
    assert quiet.newcomer_words == ""
    told = VehicleSnapshot(system=3, component=1, newcomer="10.0.0.7:14550").newcomer_words
    assert told == "10.0.0.7:14550 speaks as system 3 now, which this one's address does no more"
