"""Profiles: what maps, what is refused, and that arithmetic is nothing but arithmetic."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from gcs.errors import TippathError
from gcs.logs import ingest
from gcs.logs.formats.tables import Series
from gcs.logs.profile import mapping, profiles
from gcs.logs.profile.choice import choose
from gcs.logs.profile.expression import Expression
from gcs.logs.profile.profiles import bundled_profiles

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
    t = mine.record.t
    # The mapped file rounds time to 0.1 ms: each of its samples is the raw one within half of that.
    at = np.clip(np.searchsorted(t, theirs.record.t), 1, t.size - 1)
    at -= theirs.record.t - t[at - 1] < t[at] - theirs.record.t
    assert theirs.record.t.size > 35_000
    assert np.array_equal(at, np.arange(at[0], at[0] + at.size))
    assert np.max(np.abs(t[at] - theirs.record.t)) < 5.1e-5
    for name in ("p", "q", "r", "delta_x", "delta_y"):
        ours, their = bundled.record.channels[name][at], theirs.record.channels[name]
        if name in mine.record.channels:
            assert np.array_equal(mine.record.channels[name], bundled.record.channels[name])
        # the mapped file has six figures: nothing differs by more than half of the last of them
        last = 10 ** (np.floor(np.log10(np.maximum(np.abs(their), 1e-30))) - 5)
        assert np.all(np.abs(ours - their) <= 0.5001 * last), name
        assert np.max(np.abs(ours - their)) < 5.01e-5


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
        ("[channels.p]\nsource = 3", r"\[channels.p\]: source is text in quotes or a list, not 3"),
        ("[channels.p]\nsource = ''", "empty"),
        ("[channels.p]\nsource = 'a'\nscale = 'x'", "scale is a number, not 'x'"),
        ("[channels.p]\nsource = 'a'\nscale = nan", "scale is a number that is finite, not nan"),
        ("channels = 3", "channels is a table, not 3"),
        ("[channels]\np = 'x'", "p is a table, not 'x'"),
        ("name = 'x'", "no \\[channels"),
        ("nmae = 'x'", "did you mean name"),
        ("[channels.p]\nsource='a'\n[log]\nkind='xls'", "dataflash"),
        ("[channels.p]\nsource='a'\n[[runs]]\nstart_s=3\nstop_s=1", "before"),
        ("[channels.p]\nsource='a'\n[[runs]]\naxis='sideways'", "axis is one of"),
        ("[channels.p]\nsource='a'\n[time]\nsource=1", r"\[time\]: source is text in quotes, not 1"),
        ("[channels.p]\nsource='a'\n[axes]\ny='lfet'", "y is one of right, left, not 'lfet'; did you mean left"),
        ("[channels.p]\nsource='a'\n[axes]\nw='left'", "unknown key 'w'; there are: x, y, z"),
        ("[channels.p]\nsource='a'\n[axes]\ny='left'", "left-handed: turn x or z as well"),
        ("[channels.p]\nsource='a'\n[axes]\nx='backward'\ny='left'\nz='up'", "left-handed"),
        ("[channels.p]\nsource='a'\n[settings]\naxis='b'", "active is missing"),
        ("[channels.p]\nsource='a'\n[settings]\nactve='b'", "did you mean active"),
        ("[channels.p]\nsource='a'\n[settings]\nactive=1", "active is text in quotes, not 1"),
        ("[channels.p]\nsource='a'\n[settings]\nactive='b'\naxes=['rol']", "did you mean roll"),
        ("[channels.p]\nsource='a'\n[settings]\nactive='b'\nf_start_hz='c'", "go together"),
        ("[channels.p]\nsource='a'\n[settings]\nactive='b'\nmaneuver='chip'", "maneuver is one of"),
        ("[channels.p]\nsource='a'\n[settings]\nactive='b'\n[[runs]]\nstart_s=1", "keep one of them"),
    ],
)
def test_a_wrong_profile_says_where_and_what(saved: Saved, text: str, words: str) -> None:
    path = saved(text.encode(), "mine.toml")
    with pytest.raises(TippathError, match=words) as caught:
        profiles.load(path)
    assert str(path) in str(caught.value)


HUGE_NUMBER = "9" * 400
DAMAGED = {
    "nothing": b"",
    "binary": bytes(range(256)) * 40,
    "a DataFlash log": b"\xa3\x95\x80" * 500,
    "half a profile": QUADROTOR.encode()[:90],
    "UTF-16": QUADROTOR.encode("utf-16"),
    "too large": b"# " + b"x" * (1 << 20),
    "deep lists": b"notes = " + b"[" * 5000 + b"]" * 5000,
    "deep tables": b"a." * 5000 + b"b = 1",
    "deep, but read": b"notes = " + b"[" * 70 + b"]" * 70,
    "a number of very many digits": b"[channels.p]\nsource = 'a'\nscale = " + b"9" * 6000,
    "a whole number beyond a float": f"[channels.p]\nsource = 'a'\nscale = {HUGE_NUMBER}".encode(),
    "a priority beyond every profile": f"[channels.p]\nsource = 'a'\n[log]\npriority = {HUGE_NUMBER}".encode(),
    "a priority that is infinite": b"[channels.p]\nsource = 'a'\n[log]\npriority = inf",
    "a date": b"[channels.p]\nsource = 1979-05-27",
    "no date": b"[channels.p]\nsource = 1979-13-77",
    "a time scale of nothing": b"[channels.p]\nsource = 'a'\n[time]\nscale = 0",
    "NaN in a run": b"[channels.p]\nsource = 'a'\n[[runs]]\nstart_s = nan",
    "NaN in a band": b"[channels.p]\nsource = 'a'\n[[runs]]\nswept_band_hz = [nan, 5]",
    "a band of three": b"[channels.p]\nsource = 'a'\n[[runs]]\nswept_band_hz = [1, 2, 3]",
    "a run that is a number": b"[channels.p]\nsource = 'a'\nruns = [1]",
    "runs that are a table": b"[channels.p]\nsource = 'a'\n[runs]\nstart_s = 1",
    "settings that are a list": b"settings = []\n[channels.p]\nsource = 'a'",
    "a list of sources with a number in it": b"[channels.p]\nsource = ['a', 3]",
    "no source in the list": b"[channels.p]\nsource = []",
    "a list of lists": b"[channels.p]\nsource = [['a']]",
    "a channel within a channel": b"[channels.p.q]\nsource = 'a'",
    "channels as a list of tables": b"[[channels]]\nsource = 'a'",
    "a name of control characters": b'"\\u001b[2J" = 1',
    "a channel of control characters": b'[channels."\\u001b[2J"]\nsource = "a"',
    "a name that is a number": b"name = 3\n[channels.p]\nsource = 'a'",
    "twice the same key": b"name = 'a'\nname = 'b'",
}


@pytest.mark.parametrize("case", DAMAGED)
def test_a_damaged_profile_is_an_error_that_names_it(saved: Saved, case: str) -> None:
    path = saved(DAMAGED[case], "mine.toml")
    with pytest.raises(TippathError) as caught:
        profiles.load(path)
    assert str(caught.value).startswith(str(path))
    assert str(caught.value).isprintable()
    assert len(str(caught.value)) < 600


def test_bytes_changed_anywhere_give_a_profile_or_an_error(saved: Saved) -> None:
    text = bytearray((Path(profiles.__file__).parent / "bundled" / "paparazzi_chirp.toml").read_bytes())
    chance = np.random.default_rng(3)
    refused = 0
    for _ in range(300):
        changed = bytearray(text)
        for place in chance.integers(0, len(text), 3):
            changed[place] = chance.integers(0, 256)
        try:
            profiles.load(saved(bytes(changed), "mine.toml"))
        except TippathError:
            refused += 1
    assert 100 < refused < 300


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
    held = mapping.onto(fast, slow, held=True)
    assert np.array_equal(held[[0, 9, 10, 55]], [0, 0, 1, 5])
    between = mapping.onto(fast, slow, held=False)
    assert between[55] == pytest.approx(5.5)


def test_equal_rates_match_within_half_a_sample_or_not_at_all() -> None:
    clock = Series(np.arange(100) * 0.002, np.zeros(100), "SIDD")
    other = np.delete(np.arange(100), [40, 41]) * 0.002 + 0.0004
    matched = mapping.onto(clock, Series(other, other.copy(), "RATE"), held=True)
    assert np.flatnonzero(np.isnan(matched)).tolist() == [40, 41]
    assert np.nanmax(np.abs(matched - clock.t)) == pytest.approx(0.0004)


def test_axes_turn_the_signs_of_what_is_measured_along_and_about_them() -> None:
    text = "".join(f"[channels.{name}]\nsource='{name}'\noffset=1\n" for name in ("p", "q", "r", "az", "delta_y"))
    plain = profiles.parse(text, "x.toml")
    turned = profiles.parse(text + "[axes]\ny='left'\nz='up'\n", "x.toml")
    for name, sign in (("p", 1), ("q", -1), ("r", -1), ("az", -1), ("delta_y", 1)):
        assert turned.channels[name].scale == sign * plain.channels[name].scale
        assert turned.channels[name].offset == sign * plain.channels[name].offset
    ours = profiles.parse(text + "[axes]\nx='forward'\ny='right'\nz='down'\n", "x.toml")
    assert ours.channels == plain.channels


def paparazzi(seconds: float = 20.0, rate_hz: float = 500.0) -> dict[str, np.ndarray]:
    """An SD logger's integers: quiet, a roll chirp, quiet, a pitch chirp, a yaw chirp at once behind it."""
    t = np.arange(0, 3.5 * seconds, 1 / rate_hz)
    roll, pitch = (t >= 2) & (t < 2 + seconds), (t >= 4 + seconds) & (t < 4 + 2 * seconds)
    yaw = (t >= 4 + 2 * seconds) & (t < 10 + 2 * seconds)
    wave = np.sin(2 * np.pi * (0.5 * t + 0.05 * t * t))
    x, y = 900 * wave * roll, 900 * wave * pitch
    return {
        "time": t,
        "gyro_p": np.round(4096 * (3e-3 * x + 4e-4 * y + 0.02 * np.sin(9 * t))),
        "gyro_q": np.round(4096 * (2e-3 * y + 3e-4 * x + 0.02 * np.sin(8 * t))),
        "gyro_r": 0 * t,
        "cmd_roll": np.round(x + 30 + 9 * np.sin(7 * t)),
        "cmd_pitch": np.round(y - 20 + 9 * np.sin(6 * t)),
        "cmd_yaw": 0 * t,
        "cmd_thrust": 0 * t + 4800,
        "chirp_active": (roll | pitch | yaw).astype(float),
        "chirp_axis": np.select([t < 3 + seconds, t < 4 + 2 * seconds], [0, 1], 2.0),
        "chirp_amplitude": 0 * t + 960,
        "chirp_fstart_hz": 0 * t + 0.5,
        "chirp_fstop_hz": np.where(t < 3 + seconds, 10.0, 8.0),
        "chirp_roll": np.round(x),
        "chirp_pitch": np.round(y),
    }


def test_the_settings_in_a_log_cut_it_into_its_runs(saved: Saved) -> None:
    columns = paparazzi()
    found = ingest([saved(csv_of(columns), "sd.csv")])
    roll, pitch, yaw = found.runs
    assert found.sources[0].profile is not None
    assert found.sources[0].profile.name == "paparazzi_chirp"
    assert (roll.maneuver, roll.axis, roll.swept_band_hz) == ("chirp", "roll", (0.5, 10.0))
    assert (pitch.maneuver, pitch.axis, pitch.swept_band_hz) == ("chirp", "pitch", (0.5, 8.0))
    assert (yaw.maneuver, yaw.axis, yaw.usable) == ("chirp", "yaw", False)
    assert any("no excitation: yaw command 0 of full" in reason for reason in yaw.reasons)
    assert (roll.start_s, roll.duration_s) == (pytest.approx(2), pytest.approx(20, abs=0.01))
    assert roll.usable, roll.reasons
    assert pitch.usable, pitch.reasons
    assert any("amplitudes by the settings of the runs in order: 0.1, 0.1, 0.1" in note for note in roll.notes)
    assert roll.record is not None
    at = (columns["time"] >= 2) & (columns["time"] < 22)
    assert np.allclose(roll.record.channels["p"], columns["gyro_p"][at] / 4096)
    assert np.allclose(roll.record.channels["delta_x"], columns["cmd_roll"][at] / 9600)
    assert np.allclose(roll.record.channels["excitation_x"], columns["chirp_roll"][at] / 9600)


def test_settings_that_never_act_are_said(saved: Saved) -> None:
    columns = paparazzi()
    columns["chirp_active"] = 0 * columns["time"]
    found = ingest([saved(csv_of(columns), "sd.csv")])
    assert any("chirp_active is zero throughout" in hint for hint in found.sources[0].hints)
    assert all(run.maneuver != "doublet" for run in found.runs)


def test_settings_that_are_not_logged_are_named(saved: Saved) -> None:
    profile = saved(
        b"[time]\nsource='ms'\nscale=1e-3\n[settings]\nactive='busy > 0'\n[channels.p]\nsource='q'\n"
        b"[channels.q]\nsource='q'\n[channels.delta_x]\nsource='u1'\n[channels.delta_y]\nsource='u2'\n",
        "mine.toml",
    )
    with pytest.raises(TippathError, match=r"busy of \[settings\] .* is missing; the log has ms,"):
        ingest([saved(csv_of(flight()), "x.csv")], profile)


def test_two_boots_with_settings_do_not_mix_their_clocks(saved: Saved) -> None:
    first, second = paparazzi(6), paparazzi(12)
    columns = {name: np.concatenate([first[name], second[name]]) for name in first}
    found = ingest([saved(csv_of(columns), "sd.csv")])
    assert {run.axis for run in found.runs} <= {"roll", "pitch", "yaw", None}
    assert any("boots" in note for note in (*found.sources[0].notes, *found.sources[0].hints))


def test_paparazzis_file_logger(saved: Saved) -> None:
    t = np.arange(0, 20, 1 / 512)
    wave = 960 * np.sin(2 * np.pi * t)
    zero = 0 * t
    names = ["pos_x", "pos_y", "pos_z", "vel_x", "vel_y", "vel_z", "att_phi", "att_theta", "att_psi"]
    columns = {"time": t, **dict.fromkeys(names, zero), "rate_p": 3e-3 * wave, "rate_q": 2e-3 * wave, "rate_r": zero}
    columns |= {
        "cmd_thrust": zero + 4800,
        "cmd_roll": np.round(wave),
        "cmd_pitch": np.round(0.5 * wave),
        "cmd_yaw": zero,
    }
    (run,) = ingest([saved(csv_of(columns), "00001.csv")]).runs
    assert run.record is not None
    assert run.usable
    assert np.allclose(run.record.channels["delta_y"], np.round(0.5 * wave) / 9600)
    assert np.allclose(run.record.channels["p"], 3e-3 * wave, atol=1e-8)
    assert np.allclose(run.record.channels["delta_c"], 0.5)
    old = {"counter": np.arange(t.size), "gyro_unscaled_p": np.round(2819 * wave / 960), "gyro_unscaled_q": zero + 1}
    old |= {"COMMAND_ROLL": np.round(wave), "COMMAND_PITCH": zero, "COMMAND_YAW": zero, "COMMAND_THRUST": zero}
    (run,) = ingest([saved(csv_of(old), "00002.csv")]).runs
    assert run.record is not None
    assert run.rate_hz == pytest.approx(512)
    assert np.max(run.record.channels["p"]) == pytest.approx(3.0, abs=2e-3)
    assert any("correct a copy of the profile" in note for note in run.notes)


@pytest.mark.data
def test_the_cyclic_comes_back_out_of_three_swashplate_servos(shared_data: Path) -> None:
    """RCOU, whole microseconds at 10 Hz, against the commands that RATE logs in every loop."""
    from gcs.logs.opening import open_log

    heli = profiles.load(Path("arducopter_heli"))
    for name in ("heli_roll_sweep.BIN", "heli_pitch_sweep.BIN"):
        opened = open_log(shared_data / "ardupilot" / name, None)
        assert opened.profile.name == "arducopter"
        (log,) = opened.boots
        for channel, command in (("delta_x", "RATE.ROut"), ("delta_y", "RATE.POut")):
            expression = Expression.parse(heli.channels[channel].sources[0])
            servos = {key: log.series(key) for key in expression.fields}
            t = next(iter(servos.values())).t
            out = log.series(command)
            expected = out.values[np.maximum(np.searchsorted(out.t, t, "right") - 1, 0)]
            worked_out = expression.evaluate({key: series.values for key, series in servos.items()})
            assert np.median(np.abs(worked_out - expected)) < 1e-3
            assert np.quantile(np.abs(worked_out - expected), 0.99) < 0.02


class Logged:
    """A log of nothing but clocks: field -> Hz."""

    path, kind, sampled_s = "x.BIN", "dataflash", 10.0

    def __init__(self, **rates_hz: float) -> None:
        self.rates = {name.replace("_", "."): rate for name, rate in rates_hz.items()}
        self.dropped: dict[str, int] = {}

    def has(self, key: str) -> bool:
        return key in self.rates

    def series(self, key: str) -> Series:
        t = np.arange(0, self.sampled_s, 1 / self.rates[key])
        return Series(t, 0 * t, key.split(".")[0])

    def fields(self) -> tuple[str, ...]:
        return tuple(self.rates)

    def texts(self) -> tuple[tuple[float, str], ...]:
        return ()

    def modes(self) -> tuple[tuple[float, int], ...]:
        return ()

    def armed(self) -> tuple[tuple[float, bool], ...]:
        return ()


@pytest.mark.parametrize(
    ("rate_hz", "gyro_hz", "servo_hz", "plate", "name"),
    [
        (400, 400, 10, False, "arducopter"),
        (400, 2000, 10, False, "arducopter"),  # the gyro alone is no use without its commands
        (10, 50, 50, False, "arducopter_motors"),
        (10, 50, 50, True, "arducopter_heli"),
        (400, 2000, 10, True, "arducopter"),
    ],
)
def test_the_profile_with_the_faster_rates_and_commands_is_chosen(
    rate_hz: float, gyro_hz: float, servo_hz: float, plate: bool, name: str
) -> None:
    fields = dict.fromkeys(("RATE_R", "RATE_P", "RATE_ROut", "RATE_POut"), float(rate_hz))
    fields |= dict.fromkeys(("IMU_GyrX", "IMU_GyrY"), float(gyro_hz))
    fields |= dict.fromkeys(("RCOU_C1", "RCOU_C2", "RCOU_C3", "RCOU_C4"), float(servo_hz))
    fields |= dict.fromkeys(("SWSH_RCyc", "SWSH_PCyc") if plate else (), float(servo_hz))
    chosen = choose(Logged(**fields), bundled_profiles())
    assert chosen is not None
    assert chosen.name == name


def test_a_folder_of_a_profiles_name_does_not_hide_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "px4").mkdir()
    (tmp_path / "mine").mkdir()
    monkeypatch.chdir(tmp_path)
    assert profiles.load(Path("px4")).name == "px4"
    with pytest.raises(TippathError, match="no such profile"):
        profiles.load(Path("mine"))
