"""The reduction from events to a snapshot, as a pure function."""

from __future__ import annotations

import dataclasses
import math

import pytest

from gcs.link.events import Attitude, AutopilotVersion, Battery, Encoding, Heartbeat, RotorSpeed, StatusText
from gcs.vehicle.autopilots import mode_name
from gcs.vehicle.snapshot import KEPT_TEXTS, VehicleSnapshot, reduce

START = VehicleSnapshot(system=1, component=1)


def test_only_the_autopilot_itself_tells_mode_and_armed() -> None:
    flying = reduce(START, Heartbeat(1, 1, vehicle_type=4, autopilot=3, armed=True, mode=25, status=4), 1.0)
    assert (flying.mode, flying.mode_name, flying.armed) == (25, "SystemID", True)
    for other in (
        Heartbeat(2, 1, vehicle_type=4, autopilot=3, armed=False, mode=0, status=4),
        Heartbeat(1, 191, vehicle_type=4, autopilot=3, armed=False, mode=0, status=4),
    ):
        assert reduce(flying, other, 2.0) == flying


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_what_is_no_number_is_not_known(bad: float) -> None:
    after = reduce(START, Attitude(1, 1, boot_s=1.0, roll=bad, pitch=0.5, yaw=bad, p=bad, q=bad, r=0.25), 3.0)
    assert (after.roll, after.pitch, after.yaw, after.p, after.q, after.r) == (None, 0.5, None, None, None, 0.25)
    assert after.attitude_at_s == 3.0
    assert reduce(START, RotorSpeed(1, 1, bad), 3.0).rpm is None


def test_a_clock_that_goes_back_is_a_reboot_and_a_late_packet_is_not() -> None:
    seen = START
    for boot_s in (100.0, 100.1, 99.5, 100.2, 2.0, 3.0):
        seen = reduce(seen, Attitude(1, 1, boot_s=boot_s, roll=0, pitch=0, yaw=0, p=0, q=0, r=0), boot_s)
    assert (seen.reboots, seen.boot_s) == (1, 3.0)


def test_texts_are_numbered_and_the_oldest_leave() -> None:
    seen = START
    for number in range(KEPT_TEXTS + 7):
        seen = reduce(seen, StatusText(1, 1, 6, f"{number}"), number)
    assert [text.number for text in seen.texts] == list(range(8, KEPT_TEXTS + 8))
    assert seen.texts[-1].text == f"{KEPT_TEXTS + 6}"


def test_modes_have_names_only_where_the_numbers_are_known() -> None:
    assert mode_name(0, 4, 3) == "Stabilize"
    assert mode_name(25, 2, 3) == "SystemID"
    assert mode_name(25, 4, 12) == "mode 25"
    assert mode_name(25, 1, 3) == "mode 25"
    assert mode_name(77, 4, 3) == "mode 77"


def test_the_encoding_follows_the_capabilities() -> None:
    assert START.encoding is Encoding.C_CAST
    assert reduce(START, AutopilotVersion(1, 1, 16, "1.14.0"), 0.0).encoding is Encoding.BYTEWISE
    assert reduce(START, AutopilotVersion(1, 1, 131074, "4.7.0"), 0.0).encoding is Encoding.C_CAST


def test_a_snapshot_does_not_change_under_its_readers() -> None:
    with pytest.raises(dataclasses.FrozenInstanceError):
        START.mode = 3  # type: ignore[misc]
    reduce(START, Battery(1, 1, 22.1, 3.0, 0.5), 0.0)
    assert START.battery_v is None
