"""What is said about a lost link, the log, the disk and the hover before anything may start."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gcs.cards.envelope import Limits
from gcs.cards.maneuver import Maneuver
from gcs.flight.live import LiveWindow
from gcs.flight.log_health import Capacity, LogHealth
from gcs.flight.preflight import carried, controller, flying, hover, lag, lean_stop, recording, streamed
from gcs.vehicle.autopilots import link_loss
from gcs.vehicle.profile import bundled_profiles
from gcs.vehicle.snapshot import VehicleSnapshot

PROFILE = bundled_profiles()[0]
HOVERING = VehicleSnapshot(
    system=1,
    component=1,
    link_age_s=0.1,
    lost=False,
    mode=0,
    mode_name="Stabilize",
    armed=True,
    vehicle_type=4,
    autopilot=3,
    status=4,
)
PLAN = PROFILE.plan(Maneuver(kind="chirp", axis="roll", amplitude=0.2, duration_s=30.0))


@pytest.mark.parametrize(
    ("parameters", "station", "words", "ends"),
    [
        # README of the real logs, "What a lost link does", transmitter on
        ({"FS_GCS_ENABLE": 1, "FS_OPTIONS": 16, "SYSID_MYGCS": 255}, 255, "does NOT stop", False),
        ({"FS_GCS_ENABLE": 1, "FS_OPTIONS": 0, "SYSID_MYGCS": 255}, 255, "returns home after 5 s", True),
        ({"FS_GCS_ENABLE": 0, "FS_OPTIONS": 16, "SYSID_MYGCS": 255}, 255, "does NOT stop", False),
        # our own heartbeat is not the one that counts
        (
            {"FS_GCS_ENABLE": 1, "FS_OPTIONS": 0, "SYSID_MYGCS": 255},
            254,
            "does NOT stop: the failsafe listens to",
            False,
        ),
        ({"FS_GCS_ENABLE": 1, "FS_OPTIONS": 0, "MAV_GCS_SYSID": 254}, 254, "returns home", True),
        (
            {"FS_GCS_ENABLE": 5, "FS_OPTIONS": 0, "FS_GCS_TIMEOUT": 2.5, "SYSID_MYGCS": 255},
            255,
            "lands after 2.5",
            True,
        ),
        ({}, 255, "does not tell", None),
    ],
)
def test_the_answer_to_a_lost_link_is_read_and_said(
    parameters: dict[str, float], station: int, words: str, ends: bool | None
) -> None:
    found = link_loss(parameters, station)
    assert words in found.words
    assert found.words.startswith("if the link drops: ")
    assert found.ends_sweep is ends


def failed(checks: tuple[object, ...]) -> list[str]:
    return [check.name for check in checks if not check.ok]  # type: ignore[attr-defined]


def test_a_hovering_vehicle_in_a_manual_mode_may_start() -> None:
    assert failed(flying(HOVERING, PROFILE)) == []


@pytest.mark.parametrize(
    ("change", "name"),
    [
        ({"lost": True, "link_age_s": 4.0}, "link"),
        ({"armed": False}, "in the air"),
        ({"status": 3}, "in the air"),
        ({"status": 5}, "state"),
        ({"status": 6}, "state"),
        ({"mode": 2, "mode_name": "AltHold"}, "mode"),
        ({"mode": 25, "mode_name": "SystemID"}, "mode"),
        ({"battery_remaining": 0.2, "battery_v": 21.0}, "battery"),
    ],
)
def test_what_must_hold_in_the_air(change: dict[str, object], name: str) -> None:
    assert failed(flying(replace(HOVERING, **change), PROFILE)) == [name]  # type: ignore[arg-type]


def test_a_failsafe_at_height_is_called_one() -> None:
    words = {check.name: check.words for check in flying(replace(HOVERING, status=5), PROFILE)}
    assert "a failsafe is active" in words["state"]
    assert "takes off" not in words["in the air"]


def test_a_vehicle_that_keeps_its_log_to_itself_is_known_before_it_is_armed() -> None:
    assert failed(streamed({"LOG_BACKEND_TYPE": 1.0})) == ["log"]
    assert streamed({"LOG_BACKEND_TYPE": 3.0}) == streamed({}) == ()


def test_a_radio_that_the_log_would_fill_is_known_before_a_word_is_typed() -> None:
    stock = {"LOG_BACKEND_TYPE": 3.0, "LOG_BITMASK": 180222.0, "SCHED_LOOP_RATE": 400.0}
    (check,) = streamed(stock, 5760.0)
    assert not check.ok
    assert "5.8 kB/s and the log needs about 71" in check.words
    assert "sweep --log card" in check.words
    assert streamed(stock, 92_160.0) == ()


def test_a_battery_that_is_not_measured_blocks_nothing() -> None:
    assert failed(flying(replace(HOVERING, battery_v=24.0), PROFILE)) == []
    assert "battery" not in [check.name for check in flying(HOVERING, PROFILE)]


def test_a_log_that_does_not_grow_blocks() -> None:
    now = replace(HOVERING, blocks_received=40)
    assert failed(recording(HOVERING, now, 10**12, 60.0)) == []
    assert failed(recording(now, now, 10**12, 60.0)) == ["log"]
    assert failed(recording(HOVERING, replace(now, recording_problem="no space left"), 10**12, 60.0)) == ["log"]


def test_a_disk_needs_room_for_the_whole_card() -> None:
    now = replace(HOVERING, blocks_received=40)
    assert failed(recording(HOVERING, now, 210_000_000, 60.0)) == ["disk"]
    assert failed(recording(HOVERING, now, 230_000_000, 60.0)) == []
    assert failed(recording(HOVERING, now, None, 60.0)) == []


def window(trim: float = 0.0, spread: float = 0.02, n: int = 1000) -> LiveWindow:
    noise = np.random.default_rng(1).normal(0, spread, n)
    zero = np.zeros(n)
    return LiveWindow(
        t=np.arange(n) * 0.002,
        p=noise,
        q=noise,
        delta_x=zero + trim,
        delta_y=zero,
        excitation_x=zero,
        excitation_y=zero,
    )


def test_a_quiet_centred_hover_may_start() -> None:
    level = replace(HOVERING, roll=0.02, pitch=-0.03)
    assert failed(hover(level, window(), [PLAN], Limits())) == []
    assert failed(hover(replace(level, roll=0.3), window(), [PLAN], Limits())) == ["attitude"]
    assert failed(hover(level, window(spread=0.5), [PLAN], Limits())) == ["rates"]
    assert failed(hover(level, window(trim=-0.3), [PLAN], Limits())) == ["trim"]
    assert failed(hover(level, window(trim=0.2), [PLAN], Limits(command=0.35))) == ["trim"]


def test_what_is_not_known_of_the_hover_is_said_and_blocks_nothing() -> None:
    checks = hover(HOVERING, window(n=10), [PLAN], Limits())
    assert failed(checks) == []
    assert "not known" in checks[0].words


def test_the_controller_that_follows_a_rate_is_the_one_that_is_meant() -> None:
    assert failed(controller(1.0)) == []
    assert failed(controller(0.0)) == ["controller"]
    assert failed(controller(None)) == []


@pytest.mark.parametrize(
    ("lag_s", "answer_age_s", "words", "ok"),
    [
        (0.02, 0.1, "0.02 s", True),
        (0.5, 0.6, "0.50 s", True),
        (0.51, 0.6, "an abort would come too late", False),
        (3.5, 7.1, "answered nothing for 7 s", False),
        (0.02, 12.0, "answered nothing for 12 s", False),
        (None, float("inf"), "one way only, or a vehicle that accepts signed messages only", False),
    ],
)
def test_a_late_or_deaf_link_is_not_ready(lag_s: float | None, answer_age_s: float, words: str, ok: bool) -> None:
    (check,) = lag(replace(HOVERING, lag_s=lag_s, answer_age_s=answer_age_s))
    assert words in check.words
    assert check.ok is ok


def health(carried_by: Capacity | None) -> LogHealth:
    return LogHealth(
        file=0,
        blocks=1000,
        open=3,
        silent_s=0.0,
        log_s=5.0,
        clock_s=5.0,
        capacity=carried_by,
        reported="",
        problem=None,
    )


@pytest.mark.parametrize(
    ("carried_bytes", "numbered", "per_log_s", "ok"),
    [
        (48_000.0, 48_000.0, 47_500.0, True),
        (5_100.0, 5_600.0, 60_000.0, False),  # a queue: the numbers, too, come late
        (5_700.0, 285_000.0, None, False),
        (0.0, 0.0, None, False),
    ],
)
def test_a_link_that_cannot_carry_the_log_is_not_ready_and_says_both_rates(
    carried_bytes: float, numbered: float, per_log_s: float | None, ok: bool
) -> None:
    counted = Capacity(over_s=5.0, carried=carried_bytes, numbered=numbered, per_log_s=per_log_s, advance=None)
    (check,) = carried(health(counted), 500.0)
    assert check.ok is ok
    assert "a sweep adds 24" in check.words
    if not ok:
        assert f"carries {carried_bytes / 1e3:.1f} kB/s and the log needs {counted.needed / 1e3:.0f}" in check.words


@pytest.mark.parametrize("unknown", [None, health(None)])
def test_a_log_that_was_not_counted_is_not_ready(unknown: LogHealth | None) -> None:
    (check,) = carried(unknown, 500.0)
    assert not check.ok


@pytest.mark.parametrize(
    ("parameters", "words"),
    [
        ({"ANGLE_MAX": 3000.0}, "beyond 30°"),
        ({"ATC_ANGLE_MAX": 45.0}, "beyond 45°"),
        ({}, "does not tell"),
    ],
)
def test_the_vehicles_own_lean_stop_is_told(parameters: dict[str, float], words: str) -> None:
    assert words in lean_stop(parameters).words
