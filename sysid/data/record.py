"""A record: the time-aligned channels of one flown run, and the file that keeps them.

Records hold what was measured, untouched: no filtering, no interpolation, gaps left as they are.
`sysid.data.preprocess` makes uniform segments of them.
"""

from __future__ import annotations

import json
import struct
import tokenize
import zipfile
import zlib
from collections.abc import Collection, Mapping
from dataclasses import KW_ONLY, dataclass, field, replace
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Any, Literal

import msgspec
import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

from sysid.data.airframe import Airframe
from sysid.data.onboard_model import OnboardModel
from sysid.document import Open, converted, parsed_bytes
from sysid.errors import SysidError

FloatArray = NDArray[np.float64]
CHANNELS: Mapping[str, str] = MappingProxyType(
    {
        "t": "s",
        "p": "rad/s",
        "q": "rad/s",
        "r": "rad/s",
        "delta_x": "-1..1",
        "delta_y": "-1..1",
        "delta_e": "-1..1",
        "delta_c": "-1..1",
        "delta_r": "-1..1",
        "delta_a": "-1..1",
        "excitation_x": "-1..1",
        "excitation_y": "-1..1",
        "excitation_e": "-1..1",
        "excitation_c": "-1..1",
        "excitation_r": "-1..1",
        "omega": "rad/s",
        "airspeed": "m/s",
        "alpha": "rad",
        "beta": "rad",
        "phi": "rad",
        "theta": "rad",
        "a": "rad",
        "b": "rad",
        "u": "m/s",
        "v": "m/s",
        "w": "m/s",
        "ax": "m/s^2",
        "ay": "m/s^2",
        "az": "m/s^2",
    }
)
"""Every channel name a record may have, with its unit. Only `REQUIRED` must be there."""
REQUIRED = ("t", "p", "q", "delta_x", "delta_y")
FORMAT = "tippath.record/1"
LARGEST = 192 << 20
"""Bytes of all channels of a record: 20 of them at 1 kHz for 20 minutes."""
DAMAGED = (
    *(ValueError, KeyError, EOFError, TypeError, zipfile.BadZipFile, zlib.error, struct.error, OverflowError),
    *(MemoryError, NotImplementedError, RuntimeError, SyntaxError, tokenize.TokenError),
)
"""What readers of archives and arrays raise of one that is damaged."""


class _Onboard(Open, frozen=True, kw_only=True):
    output: str
    command: str
    a: tuple[float, ...]
    b: tuple[float, ...]
    dt_s: Annotated[float, Meta(gt=0)]
    told_by: str

    @property
    def model(self) -> OnboardModel:
        return OnboardModel(**msgspec.structs.asdict(self))


class _About(Open, frozen=True, kw_only=True):
    format: Literal["tippath.record/1"]
    id: str
    maneuver: str
    axis: str | None
    rate_source: str
    path: str
    sha256: str
    swept_band_hz: tuple[float, float] | None
    chirp_noise: float | None = None
    airframe: str | None = None
    notes: tuple[str, ...]
    vehicle: dict[str, str] = {}
    loop_dt_s: float | None = None
    loop_told_by: str = ""
    excitation_from: str = ""
    onboard: _Onboard | None = None


BY_THE_RUNS = "by these runs"
"""Who tells of a loop that no log, profile or user did: what the commands' hold left in the rates."""


class RecordError(SysidError):
    """A record that cannot be made or read; the message says what is wrong and what to do."""


@dataclass(frozen=True, eq=False)
class Record:
    """One run with its data. All channels have the same length as `t`."""

    id: str
    """What the user types for it: `flight.BIN#2`, or a file name."""
    channels: Mapping[str, FloatArray]
    """Name -> samples, shape (n,), units of `CHANNELS`. `t` increases strictly."""
    _: KW_ONLY
    maneuver: str = "unknown"
    """`chirp`, `doublet`, `quiet` or `unknown`."""
    axis: str | None = None
    """`roll`, `pitch`, `elevator`, `yaw`, `thrust`, or None where it is not known."""
    rate_source: str = "csv"
    """The kind of message p and q come from (`SIDD`, `RATE`, `csv`): fits never mix them."""
    path: str = ""
    """The log it was cut from."""
    sha256: str = ""
    """Of that log's bytes, hexadecimal."""
    swept_band_hz: tuple[float, float] | None = None
    """First and last frequency of the chirp, where known."""
    chirp_noise: float | None = None
    """Of the noise flown with the chirp, over its amplitude; None where the log does not tell."""
    airframe: Airframe | None = None
    """What kind of rotorcraft flew; None where neither log nor user tells."""
    notes: tuple[str, ...] = field(default=())
    """What the reader of the log wants the user to know."""
    vehicle: Mapping[str, str] = field(default_factory=dict)
    """What the log says of the vehicle and how it was set up, by name; empty where it says nothing."""
    loop_dt_s: float | None = None
    """How long the vehicle's loop held each command, s, where that is known: shorter than a sample of a log that has
    not every loop. None: not known, and taken as held from sample to sample."""
    loop_told_by: str = ""
    """Where that is from: a setting in the log, a profile, the user, or `BY_THE_RUNS`."""
    excitation_from: str = ""
    """What the excitation was rebuilt from; empty where it was logged, or is not known."""
    onboard: OnboardModel | None = None
    """What the vehicle itself identified in this run."""

    def __post_init__(self) -> None:
        missing = [name for name in REQUIRED if name not in self.channels]
        if missing:
            raise RecordError(f"{self.id}: channel {', '.join(missing)} missing")
        unknown = sorted(set(self.channels) - set(CHANNELS))
        if unknown:
            raise RecordError(f"{self.id}: unknown channel {', '.join(unknown)}")
        channels = {name: np.ascontiguousarray(values, dtype=np.float64) for name, values in self.channels.items()}
        if self.loop_dt_s is not None and not 0 < self.loop_dt_s < float("inf"):
            raise RecordError(f"{self.id}: a loop of {self.loop_dt_s:g} s holds no command")
        n = channels["t"].size
        for name, values in channels.items():
            if values.shape != (n,):
                raise RecordError(f"{self.id}: channel {name} has shape {values.shape}, t has {n} samples")
            if not np.all(np.isfinite(values)):
                first = int(np.flatnonzero(~np.isfinite(values))[0])
                raise RecordError(f"{self.id}: channel {name} is not a finite number at sample {first + 1}")
            values.flags.writeable = False
        if n < 2 or not np.all(np.diff(channels["t"]) > 0):
            raise RecordError(f"{self.id}: time must increase from sample to sample")
        object.__setattr__(self, "channels", MappingProxyType(channels))

    @property
    def loop_known(self) -> bool:
        """Whether the loop's rate was told, and not only found in what was flown."""
        return self.loop_dt_s is not None and self.loop_told_by != BY_THE_RUNS

    def held(self, loop_s: float | None) -> Record:
        """The run with commands held so long, s, as runs showed (None: from sample to sample), unless it was told."""
        if self.loop_known or self.loop_dt_s == loop_s:
            return self
        return replace(self, loop_dt_s=loop_s, loop_told_by="" if loop_s is None else BY_THE_RUNS)

    def without(self, names: Collection[str]) -> Record:
        """The run without these channels."""
        return replace(self, channels={name: each for name, each in self.channels.items() if name not in names})

    @property
    def t(self) -> FloatArray:
        return self.channels["t"]

    @property
    def duration_s(self) -> float:
        return float(self.t[-1] - self.t[0])

    def window(self, start_s: float | None, stop_s: float | None) -> Record:
        """The part with start_s <= t <= stop_s of the record's own time; open ends are None."""
        keep = np.ones(self.t.size, dtype=bool)
        if start_s is not None:
            keep &= self.t >= start_s
        if stop_s is not None:
            keep &= self.t <= stop_s
        if keep.sum() < 2:
            first, last = (
                "its start" if start_s is None else f"{start_s:g} s",
                "its end" if stop_s is None else f"{stop_s:g} s",
            )
            raise RecordError(
                f"{self.id}: no samples between {first} and {last}; it runs from {self.t[0]:.3f} to {self.t[-1]:.3f} s"
            )
        return replace(self, channels={name: values[keep] for name, values in self.channels.items()})

    def save(self, path: Path) -> None:
        """Write as a compressed NumPy archive, whole or not at all; the description travels as JSON inside.

        Raises OSError where the disk does not take it, RecordError for more than `LARGEST`.
        """
        about = {
            "format": FORMAT,
            "id": self.id,
            "maneuver": self.maneuver,
            "axis": self.axis,
            "rate_source": self.rate_source,
            "path": self.path,
            "sha256": self.sha256,
            "swept_band_hz": self.swept_band_hz,
            "chirp_noise": self.chirp_noise,
            "airframe": self.airframe,
            "notes": list(self.notes),
            "vehicle": dict(self.vehicle),
            "loop_dt_s": self.loop_dt_s,
            "loop_told_by": self.loop_told_by,
            "excitation_from": self.excitation_from,
            "onboard": None if self.onboard is None else self.onboard.to_json(),
        }
        if sum(values.nbytes for values in self.channels.values()) > LARGEST:
            raise RecordError(f"{self.id}: more than {LARGEST >> 20} MB; write shorter runs: ingest --window")
        part = path.with_name(path.name + ".part")
        arrays: dict[str, Any] = dict(self.channels)
        try:
            with part.open("wb") as stream:
                np.savez_compressed(stream, about=np.frombuffer(json.dumps(about).encode(), np.uint8), **arrays)
            part.replace(path)
        except BaseException:
            part.unlink(missing_ok=True)
            raise

    @classmethod
    def load(cls, path: Path) -> Record:
        """Read what `save` wrote. Raises RecordError where the file is not a record."""
        try:
            arrays = _inflated(path)
            about = converted(parsed_bytes(arrays.pop("about").tobytes()), _About)
            return cls(
                about.id,
                arrays,
                maneuver=about.maneuver,
                axis=about.axis,
                rate_source=about.rate_source,
                path=about.path,
                sha256=about.sha256,
                swept_band_hz=about.swept_band_hz,
                chirp_noise=about.chirp_noise,
                airframe=None if about.airframe is None else Airframe(about.airframe),
                notes=about.notes,
                vehicle=about.vehicle,
                loop_dt_s=about.loop_dt_s,
                loop_told_by=about.loop_told_by,
                excitation_from=about.excitation_from,
                onboard=None if about.onboard is None else about.onboard.model,
            )
        except RecordError:
            raise
        except DAMAGED as error:
            reason = (str(error).splitlines() or [type(error).__name__])[0][:200]
            raise RecordError(f"{path}: not a record ({reason})") from error


def _inflated(path: Path) -> dict[str, FloatArray]:
    """The arrays of an archive. Raises `DAMAGED`, OSError where the file cannot be opened."""
    with path.open("rb") as stream:
        try:
            return _arrays(zipfile.ZipFile(stream))
        except OSError as error:  # a place in the file that there is none of
            raise ValueError(error.strerror or str(error)) from error


def _arrays(archive: zipfile.ZipFile) -> dict[str, FloatArray]:
    """Raises ValueError before more than `LARGEST` would be inflated."""
    entries = archive.infolist()
    if sum(entry.file_size for entry in entries) > LARGEST:
        raise ValueError(f"it inflates to more than {LARGEST >> 20} MB; write shorter runs: ingest --window")
    if any(entry.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED) for entry in entries):
        raise ValueError("it is packed in a way that no record is")
    arrays = {}
    for entry in entries:
        with archive.open(entry) as part:
            array = np.lib.format.read_array(part, allow_pickle=False)
        if array.dtype.kind not in "fiu":
            raise ValueError(f"{entry.filename[:40]!r} holds no numbers")
        arrays[entry.filename.removesuffix(".npy")] = array
    return arrays


RATES = ("p", "q")
"""Measured in every run, and outputs of every model whose base says no other."""
CYCLIC = ("delta_x", "delta_y")
"""Roll and pitch command: in every run, and read by every model whose base says no other."""
COMMANDS = ("delta_x", "delta_y", "delta_e", "delta_c", "delta_r", "delta_a")
AXIS_OF = {
    "delta_x": "roll",
    "delta_y": "pitch",
    "delta_e": "elevator",
    "delta_c": "thrust",
    "delta_r": "yaw",
    "p": "roll",
    "q": "pitch",
    "r": "yaw",
    "az": "thrust",
    "a": "longitudinal flapping",
    "b": "lateral flapping",
    "phi": "roll angle",
    "theta": "pitch angle",
}
"""The axis of a command or an output in words; its unit is that of `CHANNELS`."""


def axis_of(name: str) -> str:
    """The axis of a command or an output in words, or the channel's own name."""
    return AXIS_OF.get(name, name)
