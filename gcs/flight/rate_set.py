"""A set of rate gains for a stock autopilot, as it is read from a file, and the set before it, as it is kept.

A `tippath design --for ardupilot` writes both kinds of file: JSON, which also knows what was flown, on which vehicle,
and what the set is worth, and a parameter file, which knows nothing but the new values.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from gcs import documents
from gcs.document_faults import shown
from gcs.flight.gains import LARGEST, GainsError
from gcs.flight.identified import Identified
from gcs.link.events import bits_of_float
from gcs.vehicle.gain_switch import SET

FORMAT = "tippath.rate_gains/1"
BEFORE_FORMAT = "tippath.rate_gains_before/1"
PARAMETER_FILES = (".param", ".parm")
MAKE_IT = "make it with `tippath design --for ardupilot`"
_LINE = re.compile(r"([A-Za-z][A-Za-z0-9_]*)[,\s]\s*(\S+)\s*")


@dataclass(frozen=True, kw_only=True)
class RateSet:
    """New values by parameter, and what is known of the vehicle that they are for."""

    new: Mapping[str, float]
    flown: Mapping[str, float] | None = None
    """What they were designed from; None where the file does not tell."""
    identified: Identified | None = None
    verdict: str | None = None
    """`holds`, `poor` or `fails`, as the design judged; None where the file does not tell."""
    against: tuple[str, ...] = ()
    """What failed."""
    has_models: bool = False
    """Whether the file holds the models that they can be judged on anew."""


@dataclass(frozen=True, kw_only=True)
class SetBefore:
    """What a push replaced, so that it can be put back."""

    before: Mapping[str, float]
    pushed: Mapping[str, float]

    def to_json(self) -> dict[str, Any]:
        each = {name: {"before": value, "pushed": self.pushed[name]} for name, value in self.before.items()}
        return {"format": BEFORE_FORMAT, "parameters": each}


class _Pair(documents.Open, frozen=True, kw_only=True):
    flown: float
    new: float


class _Judged(documents.Open, frozen=True, kw_only=True):
    verdict: str


class _Margins(documents.Open, frozen=True, kw_only=True):
    gain_db: float | None = None
    phase_deg: float | None = None
    delay_ms: float | None = None


class _Loop(documents.Open, frozen=True, kw_only=True):
    held: bool
    margins: _Margins | None = None


class _Document(documents.Open, frozen=True, kw_only=True):
    format: Literal["tippath.rate_gains/1"]
    parameters: dict[str, _Pair]
    new: _Loop | None = None
    asked: _Margins | None = None
    judged: _Judged | None = None
    judged_on: Any = None
    identified: Identified | None = None


class _Was(documents.Open, frozen=True, kw_only=True):
    before: float
    pushed: float


class _Before(documents.Open, frozen=True, kw_only=True):
    format: Literal["tippath.rate_gains_before/1"]
    parameters: dict[str, _Was]


def is_rate_set(path: Path) -> bool:
    """Whether a file is a set of rate gains; one that cannot be read is none."""
    if path.suffix.lower() in PARAMETER_FILES:
        return True
    try:
        document = documents.json_value(documents.read_text(path, "set of gains", LARGEST), str(path))
    except documents.DocumentError:
        return False
    return isinstance(document, dict) and document.get("format") == FORMAT


def load_rate_set(path: Path) -> RateSet:
    """Read either kind of file. Raises GainsError saying what is wrong with it."""
    try:
        if path.suffix.lower() in PARAMETER_FILES:
            return RateSet(new=_of_lines(documents.read_text(path, "parameter file", LARGEST), path))
        held = documents.read_json(path, _Document, what="set of gains", largest=LARGEST)
    except documents.DocumentError as error:
        raise GainsError(f"{error}; {MAKE_IT}") from error
    against = _too_little(held)
    return RateSet(
        new=_checked({name: pair.new for name, pair in held.parameters.items()}, path),
        flown=_checked({name: pair.flown for name, pair in held.parameters.items()}, path),
        identified=held.identified,
        verdict=_verdict(held, against),
        against=against,
        has_models=held.judged_on is not None,
    )


def load_before(path: Path) -> SetBefore:
    """Read what a push kept. Raises GainsError saying what is wrong with it."""
    try:
        held = documents.read_json(path, _Before, what="set before a push", largest=LARGEST)
    except documents.DocumentError as error:
        raise GainsError(f"{error}; it is the file that `tippath push` kept of a stock autopilot's gains") from error
    return SetBefore(
        before=_checked({name: one.before for name, one in held.parameters.items()}, path),
        pushed=_checked({name: one.pushed for name, one in held.parameters.items()}, path),
    )


def _verdict(held: _Document, against: tuple[str, ...]) -> str | None:
    if against:
        return "fails"
    if held.judged is not None:
        return held.judged.verdict
    return None if held.new is None or held.asked is None else "holds"


def _too_little(held: _Document) -> tuple[str, ...]:
    """Where the margins in the file are not what the file says was asked."""
    if held.new is None:
        return ()
    if not held.new.held:
        return ("the loop is not held",)
    if held.new.margins is None or held.asked is None:
        return ()
    short = []
    for name, unit in (("gain_db", "dB"), ("phase_deg", "°"), ("delay_ms", "ms")):
        has, asked = getattr(held.new.margins, name), getattr(held.asked, name)
        if has is not None and asked is not None and has < asked:
            short.append(f"{name.split('_')[0]} margin {has:.1f} {unit} (asked {asked:g})")
    return tuple(short)


def _of_lines(text: str, path: Path) -> dict[str, float]:
    found: dict[str, float] = {}
    for number, line in enumerate(text.splitlines(), 1):
        words = line.split("#", 1)[0].strip()
        if not words:
            continue
        matched = _LINE.fullmatch(words)
        if matched is None:
            raise GainsError(f"{path}: line {number} is no `NAME,value`: {shown(words)}; {MAKE_IT}")
        name = matched[1]
        try:
            value = float(matched[2])
        except ValueError:
            raise GainsError(f"{path}: line {number}: {shown(matched[2])} is no number; {MAKE_IT}") from None
        if name in found:
            raise GainsError(f"{path}: line {number}: {name} stands there twice; {MAKE_IT}")
        found[name] = value
    return _checked(found, path)


def _checked(values: Mapping[str, float], path: Path) -> dict[str, float]:
    if not values:
        raise GainsError(f"{path}: there is no gain in it; {MAKE_IT}")
    for name, value in values.items():
        if name not in SET:
            raise GainsError(f"{path}: {shown(name)} is none of the rate gains that are pushed ({', '.join(SET)})")
        if not math.isfinite(value):
            raise GainsError(f"{path}: {name} is {value}: a gain is a finite number; {MAKE_IT}")
        try:
            bits_of_float(value)
        except OverflowError:
            raise GainsError(f"{path}: {name} = {value:g} is too large for the vehicle's float32") from None
    return dict(values)
