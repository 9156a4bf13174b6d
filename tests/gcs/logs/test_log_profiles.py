"""Profiles: what maps, what is refused, and that arithmetic is nothing but arithmetic."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from gcs.errors import TippathError
from gcs.logs import ingest, profiles
from gcs.logs.expression import Expression
from gcs.logs.profiles import bundled_profiles
from gcs.logs.tables import Series

Saved = Callable[[bytes, str], Path]

# the documented example with the channels it leaves out
QUADROTOR = """
name = "quadrotor"
[time]
source = "timestamp_us"
scale = 1e-6
[channels.p]
source = "gyro_x_deg_s"
scale = 0.017453292519943295
[channels.q]
source = "-gyro_y_deg_s"
scale = 0.017453292519943295
[channels.delta_x]
source = "(-m1*m1 - m2*m2 + m3*m3 + m4*m4) / 2 / 65535**2"
[channels.delta_y]
source = "-(-m1*m1 + m2*m2 + m3*m3 - m4*m4) / 2 / 65535**2"
"""


@pytest.mark.data
def test_the_contracts_example_maps_a_measured_flight_as_its_authors_did(shared_data: Path, saved: Saved) -> None:
    profile = saved(QUADROTOR.encode(), "quadrotor.toml")
    raw = shared_data / "crazyflie" / "roll_pitch_pilot.csv"
    (mine,) = ingest([raw], profile).runs
    (bundled,) = ingest([raw]).runs
    (theirs,) = ingest([shared_data / "crazyflie" / "roll_pitch_pilot_mapped.csv"]).runs
    assert mine.usable
    assert mine.record is not None
    assert bundled.record is not None
    assert theirs.record is not None
    at = np.searchsorted(mine.record.t, theirs.record.t[:5000] - 6e-5)  # the mapped file rounds time to 0.1 ms
    for name, tolerance in (("p", 2e-6), ("q", 2e-6), ("delta_x", 1e-7), ("delta_y", 1e-7)):
        assert np.allclose(mine.record.channels[name][at], theirs.record.channels[name][:5000], atol=tolerance)
        assert np.array_equal(mine.record.channels[name], bundled.record.channels[name])


def test_arithmetic_gives_what_python_gives() -> None:
    chance = np.random.default_rng(5)
    a, b = chance.normal(size=100), chance.normal(size=100) + 3
    for text in ("a + b", "-a * b**2 / 3", "(a - b) % 2", "a // b", "2 * pi * a", "a * (b > 3)", "+a - -b", "1.5e-3*a"):
        expected = eval(text, {"a": a, "b": b, "pi": np.pi})
        assert np.allclose(Expression.parse(text).evaluate({"a": a, "b": b}), expected)


def test_fields_are_named_as_the_log_names_them() -> None:
    expression = Expression.parse("IMU[0].GyrX + xyz[2] - vehicle.rates.xyz[1] * m1 * m1")
    assert expression.fields == ("IMU[0].GyrX", "xyz[2]", "vehicle.rates.xyz[1]", "m1")


@pytest.mark.parametrize(
    "text",
    [
        "__import__('os').system('true')",
        "open('x')",
        "[a for a in b]",
        "(lambda: 1)()",
        "a.__class__()",
        "a if b else c",
        "a and b",
        "a < b < c",
        "'text'",
        "True",
        "f'{a}'",
        "a := 3",
        "x[y]",
        "x[0:2]",
        "a @ b",
        "~a",
        "a; b",
        "",
        "((",
        "(" * 900,
        "a+" * 600 + "a",
        "\0",
    ],
)
def test_what_is_no_arithmetic_is_refused(text: str) -> None:
    with pytest.raises(TippathError, match="source"):
        Expression.parse(text)


def test_powers_and_divisions_without_a_value_are_not_finite_and_do_not_hang() -> None:
    for text in ("9**9**9**9 + a", "a / 0", "(0-1)**0.5 * a", "1e308 * 1e308 * a", str(10**400) + " + a"):
        assert not np.isfinite(Expression.parse(text).evaluate({"a": np.ones(3)})).any()


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("not toml", "not TOML"),
        ("[channels.pp]\nsource = 'a'", "did you mean p"),
        ("[channels.t]\nsource = 'a'", r"\[time\]"),
        ("[channels.p]\nsorce = 'a'", "did you mean source"),
        ("[channels.p]\nscale = 1", "source is missing"),
        ("[channels.p]\nsource = 3", "must be text"),
        ("[channels.p]\nsource = ''", "empty"),
        ("[channels.p]\nsource = 'a'\nscale = 'x'", "must be a number"),
        ("[channels.p]\nsource = 'a'\nscale = nan", "must be a number"),
        ("channels = 3", "must be a table"),
        ("[channels]\np = 'x'", "table with source"),
        ("name = 'x'", "no \\[channels"),
        ("nmae = 'x'", "did you mean name"),
        ("[channels.p]\nsource='a'\n[log]\nkind='xls'", "dataflash"),
        ("[channels.p]\nsource='a'\n[[runs]]\nstart_s=3\nstop_s=1", "before"),
        ("[channels.p]\nsource='a'\n[[runs]]\naxis='yaw'", "axis is one of"),
        ("[channels.p]\nsource='a'\n[time]\nsource=1", "name of one field"),
    ],
)
def test_a_wrong_profile_says_where_and_what(saved: Saved, text: str, words: str) -> None:
    path = saved(text.encode(), "mine.toml")
    with pytest.raises(TippathError, match=words) as caught:
        profiles.load(path)
    assert str(path) in str(caught.value)


def test_a_profile_that_is_not_there_lists_those_that_are(tmp_path: Path) -> None:
    with pytest.raises(TippathError, match="arducopter_rate"):
        profiles.load(tmp_path / "absent.toml")
    assert profiles.load(Path("arducopter_rate")).name == "arducopter_rate"


def test_the_packages_profiles_load_and_map_the_required_channels() -> None:
    names = [profile.name for profile in bundled_profiles()]
    assert {"arducopter", "arducopter_rate", "arducopter_motors", "quadrotor"} <= set(names)
    for profile in bundled_profiles():
        assert {"p", "q", "delta_x", "delta_y"} <= set(profile.channels)
        for channel in profile.channels.values():
            for source in channel.sources:
                assert Expression.parse(source).fields


def csv_of(columns: dict[str, np.ndarray]) -> bytes:
    table = np.column_stack(list(columns.values()))
    return (",".join(columns) + "\n" + "\n".join(",".join(f"{v:.9g}" for v in row) for row in table)).encode()


def flight(rate_hz: float = 200.0, seconds: float = 20.0) -> dict[str, np.ndarray]:
    t = np.arange(0, seconds, 1 / rate_hz)
    x = 0.1 * np.sin(2 * np.pi * t)
    return {"ms": 1000 * t, "roll rate (deg/s)": 90 * x, "q": 0.5 * x, "u1": x + 0.5, "u2": 0.2 * x}


def test_columns_of_any_name_scale_and_offset(saved: Saved) -> None:
    columns = flight()
    profile = saved(
        b"[time]\nsource='ms'\nscale=1e-3\n[channels.p]\nsource='roll rate (deg/s)'\nscale=0.0174532925\n"
        b"[channels.q]\nsource='q'\n[channels.delta_x]\nsource='u1'\noffset=-0.5\n[channels.delta_y]\nsource='u2'\n"
        b"[[runs]]\nstart_s=2\nstop_s=8\nmaneuver='chirp'\naxis='roll'\nswept_band_hz=[0.5,5]\n"
        b"[[runs]]\nstart_s=10\nstop_s=18\nmaneuver='doublet'\naxis='pitch'\n",
        "mine.toml",
    )
    first, second = ingest([saved(csv_of(columns), "x.csv")], profile).runs
    assert (first.id, first.maneuver, first.axis, first.swept_band_hz) == ("x.csv#1", "chirp", "roll", (0.5, 5.0))
    assert (second.id, second.maneuver, second.start_s) == ("x.csv#2", "doublet", pytest.approx(10))
    assert first.record is not None
    assert first.record.t[0] == pytest.approx(2)
    assert first.record.t[-1] == pytest.approx(8)
    assert np.allclose(first.record.channels["delta_x"], columns["u1"][400:1601] - 0.5)
    assert np.allclose(first.record.channels["p"], np.deg2rad(columns["roll rate (deg/s)"][400:1601]), atol=1e-8)


def test_a_profile_for_other_columns_names_what_is_missing_and_what_there_is(saved: Saved) -> None:
    with pytest.raises(TippathError) as caught:
        ingest([saved(csv_of(flight()), "x.csv")], saved(QUADROTOR.replace("timestamp_us", "ms").encode(), "q.toml"))
    message = str(caught.value)
    assert "gyro_x_deg_s" in message
    assert "u1" in message
    assert "--profile" in message


def test_a_slow_command_holds_and_a_slow_speed_is_interpolated() -> None:
    fast = Series(np.arange(0, 1, 0.01), np.zeros(100), "GYRO")
    slow = Series(np.arange(0, 1, 0.1), np.arange(10.0), "SLOW")
    held = profiles._onto(fast, slow, held=True)
    assert np.array_equal(held[[0, 9, 10, 55]], [0, 0, 1, 5])
    between = profiles._onto(fast, slow, held=False)
    assert between[55] == pytest.approx(5.5)


def test_equal_rates_match_within_half_a_sample_or_not_at_all() -> None:
    clock = Series(np.arange(100) * 0.002, np.zeros(100), "SIDD")
    other = np.delete(np.arange(100), [40, 41]) * 0.002 + 0.0004
    matched = profiles._onto(clock, Series(other, other.copy(), "RATE"), held=True)
    assert np.flatnonzero(np.isnan(matched)).tolist() == [40, 41]
    assert np.nanmax(np.abs(matched - clock.t)) == pytest.approx(0.0004)
