"""PX4's autotune as runs and as a second opinion, in logs written by the format's and the message's own description."""

from __future__ import annotations

import struct
from collections.abc import Callable, Sequence
from itertools import cycle
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import butter, lfilter

from gcs.analysis.vehicles import different_vehicles
from gcs.logs import ingest
from sysid.data.record import Record

Saved = Callable[[bytes, str], Path]
Tippath = Callable[..., tuple[int, str, str]]
Array = np.ndarray
TOPICS = {
    "vehicle_angular_velocity": "uint64_t timestamp;uint64_t timestamp_sample;float[3] xyz;",
    "vehicle_torque_setpoint": "uint64_t timestamp;uint64_t timestamp_sample;float[3] xyz;",
    "autotune_attitude_control_status": "uint64_t timestamp;float[5] coeff;float[5] coeff_var;float fitness;"
    "float innov;float dt_model;float kc;float ki;float kd;float kff;float att_p;float[3] rate_sp;float u_filt;"
    "float y_filt;uint8_t state;",
}
DT, MODEL_DT = 0.0025, 0.0175
DAMPING, CONTROL, MOTOR_S = 2.0, 90.0, 0.04
STATES = {
    "1.13": {"init": 1, "roll": 2, "pause": 3, "pitch": 4, "test": 9},
    "since amplitudes": {"init": 1, "roll": 3, "pause": 4, "pitch": 6, "test": 13},
}
PLAN = (("init", 2.0), ("roll", 15.0), ("pause", 2.0), ("pitch", 15.0), ("pause", 2.0), ("test", 4.0))
"""What it does, and for how long."""


def flight() -> tuple[Array, Array, Array, list[str]]:
    """Rates, torques and added set-points, (n, 2), n for 400 Hz, and what it does at each: a P controller, motors of
    first order, steps that become shorter."""
    doing = [what for what, length_s in PLAN for _ in range(round(length_s / DT))]
    n = len(doing)
    rates, torques, added = np.zeros((n, 2)), np.zeros((n, 2)), np.zeros((n, 2))
    noise = np.random.default_rng(8).normal(0, 0.002, (n, 2))
    acting, rate, sign, left, lengths = np.zeros(2), np.zeros(2), 1.0, 0, cycle(range(120, 8, -8))
    for i, what in enumerate(doing):
        left -= 1
        if left < 0:
            sign, left = -sign, next(lengths)
        excited = {"roll": [1, 0], "pitch": [0, 1], "test": [1, 1]}.get(what, [0, 0])
        added[i] = 0.7 * sign * np.array(excited)
        rates[i] = rate + noise[i]
        torques[i] = 0.08 * (added[i] - rates[i])
        acting = acting + DT / MOTOR_S * (torques[i] - acting)
        rate = rate + DT * (CONTROL * acting - DAMPING * rate)
    return rates, torques, added, doing


def identified(rates: Array, torques: Array) -> list[float]:
    """[a1, a2, b0, b1, b2] by least squares, of signals that a low-pass of 20 Hz let through, every 17.5 ms."""
    b, a = butter(2, 20.0, fs=1 / DT)
    y, u = (lfilter(b, a, values)[:: round(MODEL_DT / DT)] for values in (rates, torques))
    past = np.column_stack([-y[2:-1], -y[1:-2], u[2:-1], u[1:-2], u[:-3]])
    return np.linalg.lstsq(past, y[3:], rcond=None)[0].tolist()


def log_of(version: str, wrong: float = 1.0, wings: bool = False) -> bytes:
    """The flight as PX4 logs it; the gain it identified `wrong` by that factor. With `wings` it says that it flew as a
    fixed wing from 45 s on."""
    rates, torques, added, doing = flight()
    pieces = [b"ULog\x01\x12\x35\x01" + struct.pack("<Q", 0)]

    def add(kind: str, body: bytes) -> None:
        pieces.append(struct.pack("<HB", len(body), ord(kind)) + body)

    add("B", bytes(40))
    topics = {**TOPICS, **({"vehicle_status": "uint64_t timestamp;uint8_t vehicle_type;"} if wings else {})}
    for name, fields in topics.items():
        add("F", f"{name}:{fields}".encode())
    for id, name in enumerate(topics):
        add("A", struct.pack("<BH", 0, id) + name.encode())
    began = {what: doing.index(what) for what in ("roll", "pitch")}
    for i, what in enumerate(doing):
        us = 30_000_000 + round(1e6 * DT * i)
        add("D", struct.pack("<HQQ3f", 0, us, us, *rates[i], 0.0))
        add("D", struct.pack("<HQQ3f", 1, us, us, *torques[i], 0.0))
        if wings and i % 400 == 0:
            add("D", struct.pack("<HQB", 3, us, 1 + (us > 45_000_000)))
        if i % 40 == 0:
            numbers = [0.0] * 5
            if what in began and i - began[what] > 400:
                axis = list(began).index(what)
                a1, a2, *b = identified(rates[began[what] : i, axis], torques[began[what] : i, axis])
                numbers = [a1, a2, *(wrong * one for one in b)]
            rest: Sequence[float] = (0.5, 0.0, MODEL_DT, 0.1, 1.0, 0.0, 0.0, 4.0)
            values = (*numbers, *[0.1] * 5, *rest, *added[i], 0.0, 0.0, 0.0, STATES[version][what])
            add("D", struct.pack("<HQ23fB", 2, us, *values))
    return b"".join(pieces)


@pytest.fixture(scope="module")
def new() -> bytes:
    return log_of("since amplitudes")


@pytest.mark.parametrize("version", STATES)
def test_each_axis_is_a_run(saved: Saved, version: str) -> None:
    """Whatever its states are numbered; where both axes are excited gains are tried out, and nothing is identified."""
    runs = ingest([saved(log_of(version), "a.ulg")]).runs
    assert [(run.maneuver, run.axis, run.reasons) for run in runs] == [
        ("doublet", "roll", ()),
        ("doublet", "pitch", ()),
    ]
    assert [run.start_s for run in runs] == pytest.approx([32.0, 49.0], abs=0.11)
    assert [run.duration_s for run in runs] == pytest.approx([15.0, 15.0], abs=0.15)
    assert "excited by PX4's autotune, which identified p per delta_x" in " ".join(runs[0].notes)


def test_a_vtol_on_its_wings_is_no_multirotor(saved: Saved) -> None:
    """Its own autotune tells the same topic, of commands that are scaled with airspeed."""
    hover, forward = ingest([saved(log_of("since amplitudes", wings=True), "a.ulg")]).runs
    assert hover.record is not None
    assert forward.record is not None
    assert (hover.record.onboard is None, forward.record.onboard is None) == (False, True)
    assert "while it flew as a fixed wing" in " ".join(forward.notes)
    told = different_vehicles([hover.record, forward.record])
    assert told is not None
    assert "flown as rotary wing: a.ulg#1; flown as fixed wing: a.ulg#2" in told


def test_its_model_stands_beside_the_fit(saved: Saved, tippath: Tippath, new: bytes) -> None:
    status, out, _ = tippath("fit", saved(new, "a.ulg"), "--model", "multirotor", "--band", "0.5:15")
    assert status == 0
    lines = [line for line in out[out.index("(PX4's autotune)") :].splitlines() if " per " in line][:2]
    assert [line.split()[:3] for line in lines] == [["p", "per", "delta_x"], ["q", "per", "delta_y"]]
    for line in lines:
        dB, deg = (float(word) for word in line.split()[5:7])
        assert dB < 1.0
        assert deg < 8


def test_one_that_is_off_shows(saved: Saved, tippath: Tippath) -> None:
    status, out, _ = tippath("fit", saved(log_of("1.13", wrong=2.0), "a.ulg"), "--model", "multirotor")
    assert status == 0
    line = next(line for line in out[out.index("(PX4's autotune)") :].splitlines() if "p per delta_x" in line)
    assert float(line.split()[5]) == pytest.approx(6.0, abs=0.8)


def test_a_record_keeps_it(saved: Saved, new: bytes, tmp_path: Path) -> None:
    record = ingest([saved(new, "a.ulg")]).runs[1].record
    record.save(tmp_path / "r.npz")
    kept = Record.load(tmp_path / "r.npz").onboard
    assert kept is not None
    assert kept == record.onboard
    assert (kept.output, kept.command, kept.dt_s) == ("q", "delta_y", pytest.approx(MODEL_DT))
    s = 2j * np.pi * 2.0
    expected = CONTROL / ((s + DAMPING) * (MOTOR_S * s + 1))
    assert kept.response(np.array([2.0]))[0] == pytest.approx(expected, rel=0.1)
    assert min(abs(pole + DAMPING) for pole in kept.poles) < 1.0
