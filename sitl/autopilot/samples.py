"""What of one sample goes into the log: all of it at 500 Hz, or as a stock autopilot's LOG_BITMASK asks for.

A sampler is called once a step, with the log and the sample; what it keeps is when each slower message is due.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple, Protocol

from sitl.autopilot.control_laws import Beside
from sitl.autopilot.logger import DataFlashLog
from sitl.plants import Plant

_DEG = 180 / math.pi

_ATT_US = 100_000
_RPM_US = 25_000
_ARSP_US = 20_000
_AIR_DENSITY = 1.225
_AIR_TEMPERATURE_CDEG = 1500

Rates = tuple[float, float, float]


class SweepSample(NamedTuple):
    """What is logged of a stay in SYSTEMID."""

    time_s: float
    """Since it was entered."""
    target: float
    """In the unit of SID_MAGNITUDE."""
    frequency_hz: float


class Sample(NamedTuple):  # made in every step: a frozen dataclass takes four times as long
    """One instant: what was measured, and the command computed from it. Radians and seconds."""

    time_us: int
    sweep: SweepSample | None
    raw_gyro: Rates
    gyro: Rates
    """Behind the filter on board."""
    wanted: Rates
    commands: tuple[float, float, float, float]
    """delta_x, delta_y, delta_e, delta_c."""
    yaw_command: float
    excitation: Rates
    """Added on roll, pitch and elevator command."""
    attitude: Rates
    rotor_rpm: float
    airspeed: float
    plant: Plant
    beside: Beside | None = None
    """What the LQR would have done, where it runs without authority."""


class Sampler(Protocol):
    def write(self, log: DataFlashLog, sample: Sample) -> None: ...


class Due:
    """Whether a message of this period is due: on its own grid, once a step."""

    def __init__(self, period_us: int, time_us: int) -> None:
        self._period_us = period_us
        self._next_us = time_us

    def __call__(self, time_us: int) -> bool:
        if time_us < self._next_us:
            return False
        self._next_us = time_us - time_us % self._period_us + self._period_us
        return True


def _write_sidd(log: DataFlashLog, sample: Sample, sweep: SweepSample) -> None:
    p, q, r = sample.raw_gyro
    plant = sample.plant
    values = (
        sweep.time_s,
        sweep.target,
        sweep.frequency_hz,
        p * _DEG,
        q * _DEG,
        r * _DEG,
        plant.ax,
        plant.ay,
        plant.az,
    )
    log.write("SIDD", sample.time_us, *values)


def _write_rate(log: DataFlashLog, sample: Sample, acceleration: float) -> None:
    (p, q, r), (p_ref, q_ref, r_ref) = sample.gyro, sample.wanted
    x, y, _, c = sample.commands
    roll, pitch = (p_ref * _DEG, p * _DEG, x), (q_ref * _DEG, q * _DEG, y)
    yaw = (r_ref * _DEG, r * _DEG, sample.yaw_command)
    log.write("RATE", sample.time_us, *roll, *pitch, *yaw, 0.0, acceleration, c, 0.0)


def _write_att(log: DataFlashLog, sample: Sample) -> None:
    phi, theta, psi = sample.attitude
    yaw = psi * _DEG % 360
    log.write("ATT", sample.time_us, 0.0, phi * _DEG, 0.0, theta * _DEG, yaw, yaw, 3)


class OwnSampler:
    """Every sample of rates and commands, with what this vehicle alone logs."""

    def __init__(self, time_us: int, parameter: Callable[[str], float], rate_hz: float) -> None:
        self._rpm, self._arsp, self._att = (Due(us, time_us) for us in (_RPM_US, _ARSP_US, _ATT_US))

    def write(self, log: DataFlashLog, sample: Sample) -> None:
        time_us = sample.time_us
        if sample.sweep is not None:
            _write_sidd(log, sample, sample.sweep)
        _write_rate(log, sample, 0.0)
        log.write("TPEX", time_us, *sample.excitation, *sample.commands[2:])
        if sample.beside is not None:
            log.write("LQRO", time_us, *sample.beside.rate, *sample.beside.command, *sample.beside.innovation)
        if self._rpm(time_us):
            log.write("RPM", time_us, 0, sample.rotor_rpm, 1.0, 1)
        if sample.plant.has_pitot and self._arsp(time_us):
            pressure = 0.5 * _AIR_DENSITY * sample.airspeed**2
            air = (sample.airspeed, pressure, _AIR_TEMPERATURE_CDEG, pressure)
            log.write("ARSP", time_us, 0, *air, 0.0, 1, 1, 1.0, 0.0, 0)
        if self._att(time_us):
            _write_att(log, sample)


_FAST, _MEDIUM, _RC_IN, _IMU, _RC_OUT, _PID, _IMU_FAST = (1 << bit for bit in (0, 1, 6, 7, 10, 12, 18))
"""Bits of LOG_BITMASK."""


class StockSampler:
    """As ArduCopter logs: in a sweep every loop, every second, fourth or eighth, as the two attitude bits say."""

    def __init__(self, time_us: int, parameter: Callable[[str], float], rate_hz: float) -> None:
        """`parameter` gives a parameter's value; `rate_hz` is the loop's."""
        self._parameter = parameter
        self._rate_hz = rate_hz
        self._left = 0  # loops until the next sample of a sweep
        self._slow, self._imu, self._rpm = (Due(us, time_us) for us in (100_000, 40_000, _RPM_US))

    def write(self, log: DataFlashLog, sample: Sample) -> None:
        mask = int(self._parameter("LOG_BITMASK"))
        time_us = sample.time_us
        slow = self._slow(time_us)
        if sample.sweep is not None:
            self._write_sweep(log, sample, sample.sweep, mask)
        elif mask & _FAST or (slow and mask & _MEDIUM):
            self._write_loops(log, sample, mask)
        if slow:
            self._write_slow(log, sample, mask)
        if mask & _IMU_FAST or (mask & _IMU and self._imu(time_us)):
            plant = sample.plant
            values = (*sample.raw_gyro, plant.ax, plant.ay, plant.az)
            log.write("IMU", time_us, 0, *values, 0, 0, 35.0, 1, 1, round(self._rate_hz), round(self._rate_hz))
        if self._rpm(time_us):
            log.write("RPM", time_us, 0, sample.rotor_rpm, 1.0, 1)

    def _write_sweep(self, log: DataFlashLog, sample: Sample, sweep: SweepSample, mask: int) -> None:
        if self._left <= 0:
            _write_sidd(log, sample, sweep)
            self._write_loops(log, sample, mask)
            fast, medium = bool(mask & _FAST), bool(mask & _MEDIUM)
            self._left = {(True, True): 1, (True, False): 2, (False, True): 4, (False, False): 8}[fast, medium]
        self._left -= 1

    def _write_loops(self, log: DataFlashLog, sample: Sample, mask: int) -> None:
        phi, theta, psi = sample.attitude
        yaw = psi * _DEG % 360
        lift = -sample.plant.az / 9.80665 - 1
        _write_rate(log, sample, lift)
        log.write("ANG", sample.time_us, 0.0, phi * _DEG, 0.0, theta * _DEG, yaw, yaw, 1 / self._rate_hz)
        if mask & _PID:
            outputs = (sample.commands[0], sample.commands[1], sample.yaw_command)
            for name, wanted, rate, output in zip(
                ("PIDR", "PIDP", "PIDY"), sample.wanted, sample.gyro, outputs, strict=True
            ):
                values = (wanted, rate, wanted - rate, output, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0)
                log.write(name, sample.time_us, *values)

    def _write_slow(self, log: DataFlashLog, sample: Sample, mask: int) -> None:
        if mask & (_FAST | _MEDIUM):
            _write_att(log, sample)
        x, y, _, c = sample.commands
        if mask & _RC_OUT:
            pulses = [round(1500 + 500 * value) for value in (x, y, c, sample.yaw_command)]
            log.write("RCOU", sample.time_us, *pulses, *(0,) * 10)
        if mask & _RC_IN:
            log.write("RCIN", sample.time_us, 1500, 1500, round(1500 + 500 * c), 1500, *(0,) * 10)
