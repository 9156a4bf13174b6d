"""A blackbox writer of the tests' own, by Betaflight's description of the format, and flights made with it.

It shares nothing with the reader. No flight with Betaflight's or INAV's chirp and none of Rotorflight could be had, so
those here are made: a first-order motor behind a rate controller, written as the firmware writes its fields.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

SVB, UVB, NEG14, TAG8_8SVB, TAG2_3S32, TAG8_4S16, NULL = 0, 1, 3, 6, 7, 8, 9
ZERO, PREVIOUS, LINE, AVERAGE, MINTHROTTLE, MOTOR0, INC, HOME, CENTRE, VBAT, LAST_TIME, MINMOTOR = range(12)

Field = tuple[str, int, int, int, int, int]
"""Name, signed, predictor and encoding of whole frames, predictor and encoding of differences."""

BETAFLIGHT: tuple[Field, ...] = (
    ("loopIteration", 0, ZERO, UVB, INC, NULL),
    ("time", 0, ZERO, UVB, LINE, SVB),
    *((f"axisP[{i}]", 1, ZERO, SVB, PREVIOUS, SVB) for i in range(3)),
    *((f"axisI[{i}]", 1, ZERO, SVB, PREVIOUS, TAG2_3S32) for i in range(3)),
    *((f"axisD[{i}]", 1, ZERO, SVB, PREVIOUS, SVB) for i in range(2)),
    *((f"axisF[{i}]", 1, ZERO, SVB, PREVIOUS, SVB) for i in range(3)),
    *((f"rcCommand[{i}]", int(i < 3), ZERO, SVB if i < 3 else UVB, PREVIOUS, TAG8_4S16) for i in range(4)),
    *((f"setpoint[{i}]", 1, ZERO, SVB, PREVIOUS, TAG8_4S16) for i in range(4)),
    ("vbatLatest", 0, VBAT, NEG14, PREVIOUS, TAG8_8SVB),
    ("amperageLatest", 1, ZERO, SVB, PREVIOUS, TAG8_8SVB),
    ("rssi", 0, ZERO, UVB, PREVIOUS, TAG8_8SVB),
    *((f"gyroADC[{i}]", 1, ZERO, SVB, AVERAGE, SVB) for i in range(3)),
    *((f"accSmooth[{i}]", 1, ZERO, SVB, AVERAGE, SVB) for i in range(3)),
    *((f"debug[{i}]", 1, ZERO, SVB, AVERAGE, SVB) for i in range(8)),
    ("motor[0]", 0, MINMOTOR, UVB, AVERAGE, SVB),
    *((f"motor[{i}]", 0, MOTOR0, SVB, AVERAGE, SVB) for i in range(1, 4)),
)
ROTORFLIGHT: tuple[Field, ...] = (
    ("loopIteration", 0, ZERO, UVB, INC, NULL),
    ("time", 0, ZERO, UVB, LINE, SVB),
    *((f"setpoint[{i}]", 1, ZERO, SVB, PREVIOUS, TAG8_4S16) for i in range(4)),
    *((f"mixer[{i}]", 1, ZERO, SVB, PREVIOUS, TAG8_4S16) for i in range(4)),
    *((f"axisP[{i}]", 1, ZERO, SVB, PREVIOUS, TAG2_3S32) for i in range(3)),
    *((f"attitude[{i}]", 1, ZERO, SVB, PREVIOUS, TAG2_3S32) for i in range(3)),
    *((f"gyroADC[{i}]", 1, ZERO, SVB, AVERAGE, SVB) for i in range(3)),
    *((f"accADC[{i}]", 1, ZERO, SVB, AVERAGE, SVB) for i in range(3)),
    ("headspeed", 0, ZERO, UVB, AVERAGE, SVB),
    *((f"servo[{i}]", 0, CENTRE, SVB, AVERAGE, SVB) for i in range(3)),
)
SLOW: tuple[Field, ...] = (
    ("flightModeFlags", 0, ZERO, UVB, ZERO, UVB),
    ("stateFlags", 0, ZERO, UVB, ZERO, UVB),
    *((name, 0, ZERO, TAG2_3S32, ZERO, TAG2_3S32) for name in ("failsafePhase", "rxSignalReceived", "rxValid")),
)
GPS: tuple[Field, ...] = (
    ("time", 0, LAST_TIME, UVB, ZERO, UVB),
    ("GPS_numSat", 0, ZERO, UVB, ZERO, UVB),
    *((f"GPS_coord[{i}]", 1, HOME, SVB, ZERO, SVB) for i in range(2)),
)
SETTINGS = {
    "Firmware type": "Betaflight",
    "Firmware revision": "Betaflight 2025.12.0 (0123456) STM32F7X2",
    "minthrottle": "1070",
    "motorOutput": "158,2047",
    "gyro_scale": "0x3f800000",
    "acc_1G": "2048",
    "vbatref": "2490",
    "pidsum_limit": "500",
    "pidsum_limit_yaw": "400",
}


def unsigned(value: int) -> bytes:
    value &= 0xFFFFFFFF
    out = bytearray()
    while value > 127:
        out.append(value & 127 | 128)
        value >>= 7
    return bytes([*out, value])


def signed(value: int) -> bytes:
    return unsigned((value << 1) ^ (value >> 31))


def three(values: Sequence[int]) -> bytes:
    """TAG2_3S32."""
    a, b, c = values
    if all(-2 <= value < 2 for value in values):
        return bytes([(a & 3) << 4 | (b & 3) << 2 | c & 3])
    if all(-8 <= value < 8 for value in values):
        return bytes([0x40 | a & 15, (b & 15) << 4 | c & 15])
    if all(-32 <= value < 32 for value in values):
        return bytes([0x80 | a & 63, b & 63, c & 63])
    sizes = [next(n for n in (1, 2, 3, 4) if -(1 << (8 * n - 1)) <= value < 1 << (8 * n - 1)) for value in values]
    lead = 0xC0 | sum((size - 1) << (2 * i) for i, size in enumerate(sizes))
    return bytes([lead]) + b"".join(v.to_bytes(n, "little", signed=True) for v, n in zip(values, sizes, strict=True))


def four(values: Sequence[int]) -> bytes:
    """TAG8_4S16, second version: the bits one after the other, high ones first."""
    selector, bits = 0, ""
    for i, value in enumerate(values):
        kind = next(k for k, n in enumerate((0, 4, 8, 16)) if value == 0 or (n and -(1 << n - 1) <= value < 1 << n - 1))
        width = (0, 4, 8, 16)[kind]
        selector |= kind << (2 * i)
        bits += format(value & ((1 << width) - 1), f"0{width}b") if width else ""
    bits += "0" * (-len(bits) % 8)
    return bytes([selector]) + bytes(int(bits[i : i + 8], 2) for i in range(0, len(bits), 8))


def eight(values: Sequence[int]) -> bytes:
    """TAG8_8SVB."""
    if len(values) == 1:
        return signed(values[0])
    header = sum(1 << i for i, value in enumerate(values) if value)
    return bytes([header]) + b"".join(signed(value) for value in values if value)


def encoded(values: Sequence[int], encodings: Sequence[int]) -> bytes:
    out, at = b"", 0
    while at < len(values):
        kind, count = encodings[at], 1
        if kind == TAG8_8SVB:
            while count < 8 and at + count < len(values) and encodings[at + count] == kind:
                count += 1
            out += eight(values[at : at + count])
        elif kind in (TAG2_3S32, TAG8_4S16):
            count = 3 if kind == TAG2_3S32 else 4
            out += (three if count == 3 else four)(values[at : at + count])
        elif kind == NEG14:
            out += unsigned(-values[at] & 0x3FFF)
        elif kind != NULL:
            out += unsigned(values[at]) if kind == UVB else signed(values[at])
        at += count
    return out


@dataclass
class Writer:
    """One log; `data` is its bytes."""

    fields: Sequence[Field] = BETAFLIGHT
    settings: Mapping[str, str] = field(default_factory=lambda: SETTINGS)
    every: int = 32
    """Loops from whole frame to whole frame."""
    of: int = 2
    """Loops from frame to frame."""
    pieces: list[bytes] = field(default_factory=list)
    frames: int = 0
    before: list[list[int]] = field(default_factory=list)

    def __post_init__(self) -> None:
        lines = ["Product:Blackbox flight data recorder by Nicholas Sherlock", "Data version:2"]
        kinds = {"I": (self.fields, (2, 3)), "S": (SLOW, (2, 3)), "G": (GPS, (2, 3))}
        for kind, (fields, places) in kinds.items():
            lines += [
                f"Field {kind} name:{','.join(one[0] for one in fields)}",
                f"Field {kind} signed:{','.join(str(one[1]) for one in fields)}",
            ]
            for what, place in zip(("predictor", "encoding"), places, strict=True):
                lines.append(f"Field {kind} {what}:{','.join(str(one[place]) for one in fields)}")
        lines.append(f"Field P predictor:{','.join(str(one[4]) for one in self.fields)}")
        lines.append(f"Field P encoding:{','.join(str(one[5]) for one in self.fields)}")
        lines += [f"I interval:{self.every}", f"P interval:{self.of}"]
        lines += [f"{name}:{value}" for name, value in self.settings.items()]
        self.pieces.append("".join(f"H {line}\n" for line in lines).encode())

    @property
    def data(self) -> bytes:
        return b"".join(self.pieces)

    def add(self, values: Mapping[str, int]) -> None:
        """A main frame; what `values` does not name is zero. loopIteration is counted here."""
        loop = self.frames * self.of
        now = [loop if one[0] == "loopIteration" else int(values.get(one[0], 0)) for one in self.fields]
        names = [one[0] for one in self.fields]
        whole = loop % self.every == 0
        constants = {
            MINMOTOR: int(self.settings.get("motorOutput", "1150").split(",")[0]),
            MOTOR0: now[names.index("motor[0]")] if "motor[0]" in names else 0,
            VBAT: int(self.settings.get("vbatref", "4095")),
            CENTRE: 1500,
            MINTHROTTLE: int(self.settings.get("minthrottle", "1150")),
        }
        raw = []
        for i, value in enumerate(now):
            _, _, first, _, later, _ = self.fields[i]
            predictor = first if whole else later
            guess = constants.get(predictor, 0)
            if not whole:
                last, earlier = self.before[-1][i], self.before[-2][i]
                guess = {PREVIOUS: last, LINE: 2 * last - earlier, AVERAGE: int((last + earlier) / 2)}.get(
                    predictor, guess
                )
            raw.append(value - guess)
        encodings = [one[3] if whole else one[5] for one in self.fields]
        self.pieces.append((b"I" if whole else b"P") + encoded(raw, encodings))
        self.before = [now, now] if whole else [self.before[-1], now]
        self.frames += 1

    def slow(self, *values: int) -> None:
        self.pieces.append(b"S" + encoded(values, [one[3] for one in SLOW]))

    def gps(self, *values: int) -> None:
        self.pieces.append(b"G" + encoded(values, [one[3] for one in GPS]))

    def event(self, kind: int, body: bytes) -> None:
        self.pieces.append(b"E" + bytes([kind]) + body)

    def end(self) -> None:
        self.event(255, b"End of log\0")


RATE_HZ = 1000
MOTOR_S, GAIN, KP = 0.03, 180.0, 0.09
LOW_HZ, HIGH_HZ, LASTS_S, AMPLITUDE = 0.5, 40.0, 14, 90.0
CHIRP = {
    "chirp_lag_freq_hz": "3",
    "chirp_lead_freq_hz": "30",
    "chirp_amplitude_roll": "90",
    "chirp_amplitude_pitch": "90",
    "chirp_amplitude_yaw": "90",
    "chirp_frequency_start_deci_hz": f"{10 * LOW_HZ:.0f}",
    "chirp_frequency_end_deci_hz": f"{10 * HIGH_HZ:.0f}",
    "chirp_time_seconds": str(LASTS_S),
    "blackbox_high_resolution": "1",
    "looptime": "500",
    "pid_process_denom": "2",
}


@dataclass(frozen=True)
class Flight:
    """Axes as the autopilot has them: y left, z up; (n, 2) are roll and pitch."""

    t: np.ndarray
    rate: np.ndarray
    """(n, 2), deg/s"""
    u: np.ndarray
    """(n, 2), of full command"""
    setpoint: np.ndarray
    axis: np.ndarray
    """-1 where no chirp is flown."""
    phase: np.ndarray
    frequency: np.ndarray
    chirp: np.ndarray


def flight(seed: int = 3) -> Flight:
    """A chirp on roll, then one on pitch: rates follow motors (`MOTOR_S`) by `GAIN` rad/s^2, closed by `KP`."""
    gap, count = 2 * RATE_HZ, LASTS_S * RATE_HZ
    n = 3 * gap + 2 * count
    axis, phase, frequency, chirp = np.full(n, -1), np.zeros(n), np.zeros(n), np.zeros(n)
    since = np.arange(count) / RATE_HZ
    beta = (HIGH_HZ / LOW_HZ) ** (1 / LASTS_S)
    for place in range(2):
        here = slice(gap + place * (gap + count), gap + place * (gap + count) + count)
        axis[here], frequency[here] = place, LOW_HZ * beta**since
        phase[here] = (math.tau / math.log(beta) * (frequency[here] - LOW_HZ)) % math.tau
        chirp[here] = np.cos(phase[here]) * np.minimum(frequency[here], 1)
    gusts = np.random.default_rng(seed).normal(0, 0.6, (n, 2))
    rate, motor, u, setpoint = np.zeros((n, 2)), np.zeros(2), np.zeros((n, 2)), np.zeros((n, 2))
    p = np.zeros(2)
    for i in range(n):
        if axis[i] >= 0:
            setpoint[i, axis[i]] = AMPLITUDE * chirp[i]
        rate[i] = np.degrees(p)
        u[i] = KP * np.radians(setpoint[i] - rate[i])
        motor += (u[i] - motor) / (MOTOR_S * RATE_HZ)
        p += (GAIN * motor + gusts[i] - 0.3 * p) / RATE_HZ
    return Flight(np.arange(n) / RATE_HZ, rate, u, setpoint, axis, phase, frequency, chirp)


def logged(flown: Flight, kind: str, settings: Mapping[str, str] = SETTINGS) -> bytes:
    """The flight as a log, every fourth loop. kind: `new` and `old` Betaflight, `inav`, or `none` for no chirp mode."""
    log = Writer(
        settings={**settings, **(CHIRP if kind in ("new", "old") else {"blackbox_high_resolution": "1"})}, of=4
    )
    log.slow(1, 0, 0, 1, 1)
    for i in range(0, flown.t.size, 4):
        debug = [0, 0, 0, 0]
        if kind == "new":
            debug = [5e3 * flown.phase[i], flown.axis[i], 10 * flown.frequency[i], 1e3 * flown.chirp[i]]
        elif kind == "old":
            debug[0] = 5e3 * flown.phase[i]
        elif kind == "inav":
            on = flown.axis[i] >= 0
            output = AMPLITUDE * flown.chirp[i] if on else 0
            debug = [3 if on else 1, max(flown.axis[i], 0) + 1, 100 * output, 100 * flown.frequency[i]]
        values = {"time": 7_000_000 + 1000 * i, "motor[0]": 900, "motor[1]": 910, "motor[2]": 880, "motor[3]": 905}
        values |= {"vbatLatest": 2480, "accSmooth[2]": 2048, "setpoint[3]": 350, "rcCommand[3]": 13500}
        for k in range(2):
            values[f"gyroADC[{k}]"] = round(10 * flown.rate[i, k])
            values[f"setpoint[{k}]"] = round(10 * flown.setpoint[i, k])
            values[f"axisP[{k}]"] = round(1000 * flown.u[i, k])
        values |= {f"debug[{k}]": round(float(value)) for k, value in enumerate(debug)}
        log.add(values)
    log.end()
    return log.data
