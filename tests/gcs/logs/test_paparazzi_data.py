"""Paparazzi's .log with .data: made as its ground station writes them, with the message of its chirp module."""

from __future__ import annotations

import random
from pathlib import Path

import numpy as np
import pytest
from injuries import COUNTS, bounded_turns, injure

from gcs.errors import TippathError
from gcs.logs import ingest
from gcs.logs.formats import paparazzi

LOG = """<?xml version="1.0"?>
<configuration time_of_day="1580000000." data_file="{data}">
 <conf><aircraft name="Delta" ac_id="12" airframe="x.xml">
  <airframe><commands><axis name="THRUST" failsafe_value="0"/><axis name="PITCH" failsafe_value="0"/>
   <axis name="ROLL" failsafe_value="0"/><axis name="YAW" failsafe_value="0"/></commands></airframe></aircraft></conf>
 <protocol><msg_class name="telemetry">
  <message name="IMU_GYRO" id="200"><field name="id" type="uint8"/><field name="gp" type="float" unit="rad/s"/>
   <field name="gq" type="float" unit="rad/s"/><field name="gr" type="float" unit="rad/s"/></message>
  <message name="COMMANDS" id="102"><field name="values" type="int16[]"/></message>
  <message name="CHIRP" id="45">{chirp}</message>
  <message name="INFO_MSG" id="2"><field name="msg" type="char[]"/></message>
 </msg_class></protocol>
</configuration>
"""
CHIRP = (
    *("active", "percentage_done", "current_frequency", "axis", "amplitude", "fstart", "fstop"),
    *("noise_onaxis_ratio", "noise_offaxis", "current_value", "fade_in", "exponential"),
)
FIELDS = "".join(f'<field name="{name}" type="float"/>' for name in CHIRP)
LENGTH_S, PERIOD = 8.0, 10.0


def wave(t: np.ndarray | float) -> np.ndarray:
    """One sweep from 0.5 to 8 Hz every `PERIOD`, which begins 1 s into it."""
    since = np.asarray(t) % PERIOD - 1
    on = (since >= 0) & (since < LENGTH_S)
    return np.where(on, np.sin(2 * np.pi * (0.5 * since + 7.5 / (2 * LENGTH_S) * since**2)), 0.0)


def flown(chirp_every: int = 1, rate_hz: int = 250, order: str = "TPRY", aircraft: tuple[int, ...] = (12,)) -> bytes:
    """A sweep on roll, one on pitch. CHIRP with every so many commands."""
    lines = []
    for i in range(int(2 * PERIOD * rate_hz)):
        t = i / rate_hz
        axis, e = int(t >= PERIOD), float(wave(t))
        shake = 0.02 * np.sin(40 * t)
        active = int(0 <= t % PERIOD - 1 < LENGTH_S)
        x, y = (e, 0.0) if axis == 0 else (0.0, e)
        commands = {"T": 4000, "P": round(1920 * y), "R": round(1920 * x), "Y": 7}
        listed = ",".join(str(commands[letter]) for letter in order)
        for number in aircraft:
            lines.append(f"{30 + t:.4f} {number} IMU_GYRO 0 {x + shake:.6f} {0.8 * y + shake:.6f} 0.02")
            lines.append(f"{30 + t:.4f} {number} COMMANDS {listed}")
            if i % chirp_every == 0:
                tail = f"0.5 8 0 0 {round(1920 * e)} 0 1"
                lines.append(f"{30 + t:.4f} {number} CHIRP {active} 12 1.5 {axis} 1920 {tail}")
        if i % 500 == 0:
            lines.append(f'{30 + t:.4f} {aircraft[0]} INFO_MSG "hello there"')
    return ("\n".join(lines) + "\n").encode()


@pytest.fixture
def pair(tmp_path: Path) -> Path:
    """The .log of a flight; its .data lies beside it under another name."""
    (tmp_path / "20_06.data").write_bytes(flown())
    log = tmp_path / "20_06_02.log"
    log.write_text(LOG.format(data="/home/somebody/var/logs/20_06.data", chirp=FIELDS))
    return log


def test_the_chirp_message_finds_the_runs(pair: Path) -> None:
    found = ingest([pair])
    assert [(run.maneuver, run.axis, run.usable) for run in found.runs] == [
        ("chirp", "roll", True),
        ("chirp", "pitch", True),
    ]
    for place, run in enumerate(found.runs):
        assert run.record is not None
        channels, t = run.record.channels, run.record.t
        assert run.record.swept_band_hz == pytest.approx((0.5, 8))
        assert channels[("delta_x", "delta_y")[place]] == pytest.approx(0.2 * wave(t - 30), abs=2e-4)
        assert channels[("excitation_x", "excitation_y")[place]] == pytest.approx(0.2 * wave(t - 30), abs=2e-4)
        assert channels["r"] == pytest.approx(0.02)
        assert channels["delta_c"] == pytest.approx(4000 / 9600)
    first = found.runs[0].record
    assert first is not None
    assert first.channels["p"] == pytest.approx(0.02 * np.sin(40 * (first.t - 30)) + wave(first.t - 30), abs=1e-5)


def test_a_slow_chirp_message_tells_runs_but_no_excitation(tmp_path: Path) -> None:
    (tmp_path / "slow.data").write_bytes(flown(chirp_every=50, order="RPYT"))
    found = ingest([tmp_path / "slow.data"])
    assert [run.axis for run in found.runs] == ["roll", "pitch"]
    assert any("slow.log is not beside it" in hint for hint in found.sources[0].hints)
    for run in found.runs:
        assert run.record is not None
        assert run.record.channels["delta_x" if run.axis == "roll" else "delta_y"].std() > 0.1
        assert run.record.excitation_from or "excitation_x" not in run.record.channels


def test_the_data_is_read_with_the_log_beside_it(pair: Path) -> None:
    data = pair.with_name("20_06_02.data")
    data.write_bytes(pair.with_name("20_06.data").read_bytes())
    (roll, _) = ingest([data]).runs
    assert roll.record is not None
    assert roll.record.channels["delta_c"] == pytest.approx(4000 / 9600), "the order is the airframe's"


def test_a_log_that_comes_later_is_not_missed(pair: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("TIPPATH_CACHE")
    data = pair.with_name("20_06.data")
    taken = []
    for beside in (False, True):
        if beside:
            data.with_suffix(".log").write_text(pair.read_text())
        record = ingest([data]).runs[0].record
        assert record is not None
        taken.append(float(record.channels["delta_c"].mean()))
    assert taken == pytest.approx([7 / 9600, 4000 / 9600])


def test_each_aircraft_is_a_log(tmp_path: Path) -> None:
    (tmp_path / "two.data").write_bytes(flown(aircraft=(12, 13), order="RPYT"))
    found = ingest([tmp_path / "two.data"])
    assert [run.axis for run in found.runs] == ["roll", "pitch"] * 2
    assert any("2 aircraft in this log: 12, 13" in note for note in found.sources[0].notes)


NOT_READ = {
    "empty.data": (b"", "not a .data of Paparazzi"),
    "words.data": (b"this is no log\n" * 50, "not a .data of Paparazzi"),
    "alone.log": (LOG.format(data="gone.data", chirp=FIELDS).encode(), "gone.data, which is not beside it"),
    "few.data": (b"30.5 12 IMU_GYRO 0 0 0 0\n", "not a .data of Paparazzi"),
}


@pytest.mark.parametrize("name", NOT_READ)
def test_what_cannot_be_read_is_told(tmp_path: Path, name: str) -> None:
    raw, words = NOT_READ[name]
    (tmp_path / name).write_bytes(raw)
    with pytest.raises(TippathError, match=words) as caught:
        ingest([tmp_path / name])
    assert str(caught.value).startswith(str(tmp_path / name))


@pytest.mark.parametrize("count", COUNTS)
def test_no_injury_makes_the_reader_fail(tmp_path: Path, count: int) -> None:
    data, log = flown(rate_hz=10), LOG.format(data="x.data", chirp=FIELDS).encode()
    chance = random.Random(41)
    read = 0
    for i in bounded_turns(count):
        (tmp_path / "x.data").write_bytes(
            injure(data, chance, lambda chance: b" \n,"[chance.randrange(3) :][:1], cut=True)
        )
        path = tmp_path / "x.log"
        path.write_bytes(injure(log, chance, lambda _: b'<field name="', cut=True) if i % 2 else log)
        try:
            file = paparazzi.read(tmp_path / "x.data")
            for run in ingest([tmp_path / "x.data"]).runs if i % 5 == 0 else ():
                assert run.record is None or np.all(np.diff(run.record.t) > 0)
        except TippathError:
            continue
        read += 1
        for each in file.logs:
            for key in each.fields():
                series = each.series(key)
                assert np.all(np.diff(series.t) > 0)
                assert series.t.size == series.values.size
    assert read > 0.5 * count


@pytest.mark.data
def test_the_real_log_is_read_and_too_slow(shared_data: Path) -> None:
    path = shared_data / "measured" / "paparazzi_80_01_06__06_58_24_SD.data"
    if not path.exists():
        pytest.skip(f"NOT CHECKED: {path} is absent")
    found = ingest([path])
    (run,) = found.runs
    assert not run.usable
    assert any("IMU_GYRO at 50 Hz: too slow" in reason for reason in run.reasons)
    assert any("delta_x is logged at 20 Hz only" in reason for reason in run.reasons)
    log = paparazzi.read(path).logs[0]
    assert log.series("IMU_GYRO.gp").values[:2].tolist() == [-0.085693, -0.081299]
    assert log.series("ATTITUDE.phi").t.size == 6114
