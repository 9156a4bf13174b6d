"""One set of gains to the vehicle, whole or not at all, and back again.

PARAM_SET writes one value, so a set goes to the vehicle's shadow bank, is read back bit for bit, and one write of its
checksum makes it the active bank. What the vehicle then flies is read back once more. Commit and revert act when
written, so neither is ever sent twice blindly: a lost answer is made good by asking which bank is active, because a
second commit would overwrite the bank to go back to.
"""

from __future__ import annotations

import math
import struct
import zlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, TypeVar

from gcs import documents
from gcs.document_faults import shown
from gcs.errors import LinkError, TippathError
from gcs.flight.identified import Identified
from gcs.flight.session import Session
from gcs.link.events import bits_of_float, float_of_bits
from gcs.link.procedures import NoAnswerError, Parameter, Procedure, ProcedureError, ReadParameter, WriteParameter
from gcs.vehicle.autopilots import ACTIVE, ACTIVE_CRC, BANK_KNOWN_BY, COMMIT, NO_BANK, REVERT, SHADOW, SWITCH

LARGEST = 2**20
"""Bytes; what `tippath design` writes is a thousandth of it."""

MODEL = ("L_b", "M_a", "tau_f", "A_b", "B_a", "A_lat", "A_lon", "B_lat", "B_lon")
BANK = (
    *(f"K{row}{column}" for row in (1, 2) for column in (1, 2, 3, 4)),
    *(f"L{row}{column}" for row in (1, 2, 3, 4) for column in (1, 2)),
    *(f"G{row}{column}" for row in (1, 2) for column in (1, 2)),
    *(name.upper() for name in MODEL),
)
"""The 29 values of a bank, in the order of its checksum."""

ACT_TRIES = 4

T = TypeVar("T")


class GainsError(TippathError):
    """A file that holds no set of gains, or a vehicle that does not take it."""

    reason = "gains"


@dataclass(frozen=True, slots=True)
class Gains:
    """One set, as the vehicle holds it."""

    bits: tuple[int, ...]
    """float32 bits, shape (29,), in the order of `BANK`."""
    identified: Identified | None = field(default=None, compare=False)
    """What is known of the vehicle that they were designed for."""

    @property
    def crc(self) -> int:
        """24 bits of CRC-32: as many as a float32 carries exactly."""
        return zlib.crc32(struct.pack(f"<{len(self.bits)}I", *self.bits)) & 0xFFFFFF

    @property
    def values(self) -> dict[str, float]:
        return {name: float_of_bits(bits) for name, bits in zip(BANK, self.bits, strict=True)}


@dataclass(frozen=True, slots=True)
class PushResult:
    """What a push did, with what the vehicle now flies when its pilot's switch says so."""

    crc: int
    previous_crc: int
    """Of the bank that was active before: what a revert goes back to; 0 where there was none."""
    committed: bool
    """False where the vehicle had this very set already."""
    values: Mapping[str, float]
    """Read back from the active bank, each bit equal to what was sent."""
    switch_on: bool | None
    """Whether the pilot's switch selects the LQR now; None where the vehicle does not say."""

    def to_json(self) -> dict[str, Any]:
        return {
            "format": "tippath.push/1",
            "crc": self.crc,
            "checksum": checksum(self.crc) if self.crc else None,
            "previous_crc": self.previous_crc,
            "previous_checksum": checksum(self.previous_crc) if self.previous_crc else None,
            "committed": self.committed,
            "verified": len(self.values),
            "values": dict(self.values),
            "switch_on": self.switch_on,
        }


@dataclass(frozen=True, slots=True)
class PushPlan:
    """What a push would do, by what the vehicle told; nothing was written."""

    crc: int
    """Of the set;"""
    active_crc: int
    """of the bank that is active; 0 where there is none."""
    changes: Mapping[str, tuple[float | None, float]]
    """Values of the active bank that would become others: now (None where no bank is active), then."""
    switch_on: bool | None
    """As in `PushResult`."""

    def to_json(self) -> dict[str, Any]:
        return {
            "format": "tippath.push/1",
            "dry_run": True,
            "crc": self.crc,
            "checksum": checksum(self.crc),
            "previous_crc": self.active_crc,
            "previous_checksum": checksum(self.active_crc) if self.active_crc else None,
            "committed": False,
            "changes": {name: {"now": now, "then": then} for name, (now, then) in self.changes.items()},
            "switch_on": self.switch_on,
        }


@dataclass(frozen=True, slots=True)
class RevertResult:
    """What a revert did."""

    crc: int
    """Of the bank that is active now; 0: none."""
    reverted_crc: int
    """Of the bank that was active before."""

    def to_json(self) -> dict[str, Any]:
        return {
            "format": "tippath.revert/1",
            "crc": self.crc,
            "checksum": checksum(self.crc) if self.crc else None,
            "reverted_crc": self.reverted_crc,
            "reverted_checksum": checksum(self.reverted_crc) if self.reverted_crc else None,
        }


def checksum(crc: int) -> str:
    """A checksum as it is written everywhere: six hexadecimal digits; `none` for no bank."""
    return f"{crc:06x}" if crc else "none"


Row2 = tuple[float, float]
Row4 = tuple[float, float, float, float]


class _Value(documents.Open, frozen=True, kw_only=True):
    """A parameter as a fit writes it."""

    value: float


class _Model(documents.Open, frozen=True, kw_only=True):
    structure: str
    parameters: dict[str, float | _Value]


class GainsDocument(documents.Open, frozen=True, kw_only=True):
    """What a push reads of a GAINS.json."""

    format: Literal["tippath.gains/1"]
    K: tuple[Row4, Row4]
    observer_gain: tuple[Row2, Row2, Row2, Row2]
    prefilter: tuple[Row2, Row2]
    model: _Model
    identified: Identified | None = None
    """What is known of the vehicle that the model is of; nothing in an older file."""

    @property
    def parameters(self) -> dict[str, float]:
        """Of the model, by name."""
        return {name: v.value if isinstance(v, _Value) else v for name, v in self.model.parameters.items()}


def load_gains(path: Path) -> Gains:
    """Read a GAINS.json of `tippath design`. Raises GainsError saying what is wrong with it."""
    try:
        text = documents.read_text(path, "set of gains", LARGEST)
        document = documents.json_value(text, str(path))
    except documents.DocumentError as error:
        raise GainsError(f"{error}; make it with `tippath design`") from error
    return gains_of(document, str(path))


def gains_of(document: object, source: str = "the gains") -> Gains:
    """The set that a GAINS.json document holds; `source` names it in messages. Raises GainsError."""
    try:
        held = documents.convert(document, GainsDocument, source)
    except documents.DocumentError as error:
        raise GainsError(f"{error}; make it with `tippath design`") from error
    model = held.model
    if model.structure != "tpp":
        raise GainsError(f"{source}: the model is {shown(model.structure)}; the vehicle's observer holds tpp")
    parameters = held.parameters
    missing = [name for name in MODEL if name not in parameters]
    if missing:
        raise GainsError(f"{source}: model.parameters.{missing[0]} is missing, which the vehicle's observer needs")
    rows = (*held.K, *held.observer_gain, *held.prefilter)
    values = [value for row in rows for value in row] + [parameters[name] for name in MODEL]
    bits = tuple(_bits(value, name, source) for name, value in zip(BANK, values, strict=True))
    return Gains(bits, held.identified)


def _bits(value: float, name: str, source: str) -> int:
    try:
        return bits_of_float(value)
    except OverflowError:
        raise GainsError(f"{source}: {name} = {value:g} is too large for the vehicle's float32") from None


def planned_push(session: Session, gains: Gains) -> PushPlan:
    """All that a push asks before it writes, and what it would change. Raises as `push`."""
    require_ready(session)
    crc = _active_crc(session)
    held: tuple[int | None, ...] = _bank(session, ACTIVE) if crc else (None,) * len(BANK)
    changes = {
        name: (None if now is None else float_of_bits(now), float_of_bits(then))
        for name, now, then in zip(BANK, held, gains.bits, strict=True)
        if now != then
    }
    return PushPlan(gains.crc, crc, changes, _switch(session))


def planned_revert(session: Session) -> int:
    """All that a revert asks before it writes; the checksum of the bank that it would leave. Raises as `revert`."""
    require_disarmed(session, "nothing was written; in the air the pilot's switch is the way back")
    _require_bank(session)
    crc = _active_crc(session)
    if not crc:
        raise GainsError("no LQR is active: there is nothing to go back from", reason="no bank")
    return crc


def push(session: Session, gains: Gains, *, on_progress: Callable[[str], None] = lambda _: None) -> PushResult:
    """Write a set to the shadow bank, prove it, commit it, and prove what is active; only disarmed.

    Raises GainsError or ProcedureError, with the vehicle's own words where it gave any; the active bank is then what
    it was, unless the message says otherwise. Raises LinkError where the link is gone.
    """
    require_ready(session)
    previous = _active_crc(session)
    if previous == gains.crc and _bank(session, ACTIVE) == gains.bits:
        return PushResult(gains.crc, previous, False, gains.values, _switch(session))

    on_progress(f"writing {len(BANK)} values to the shadow bank")
    for name, bits in zip(BANK, gains.bits, strict=True):
        call(session, WriteParameter(SHADOW + name, float_of_bits(bits)))
    on_progress("reading the shadow bank back")
    _require_equal(_bank(session, SHADOW), gains.bits, "shadow bank", "nothing was committed")

    require_disarmed(session, "nothing was committed")
    meanwhile = _active_crc(session)
    if meanwhile != previous:
        raise GainsError(
            f"somebody else has committed {checksum(meanwhile)} meanwhile, in place of {checksum(previous)}; nothing "
            "was committed: find out who, and push again",
            reason="differs",
        )
    on_progress(f"committing {checksum(gains.crc)}")
    refusal = _act(session, COMMIT, float(gains.crc), previous)
    active = _active_crc(session)
    if active != gains.crc:
        raise GainsError(
            f"the vehicle did not take the set: {refusal or f'its active bank is {checksum(active)}'}; "
            f"the active bank is {'as before' if active == previous else 'another one'}",
            reason="refused",
        )
    on_progress("reading the active bank back")
    _require_equal(_bank(session, ACTIVE), gains.bits, "active bank", "do not fly it: revert")
    return PushResult(gains.crc, previous, True, gains.values, _switch(session))


def revert(session: Session) -> RevertResult:
    """Go back to the bank before the last commit; only disarmed.

    Raises GainsError where the vehicle refuses, has nothing to go back to, or offers no bank.
    """
    require_disarmed(session, "nothing was written; in the air the pilot's switch is the way back")
    _require_bank(session)
    before = _active_crc(session)
    refusal = _act(session, REVERT, 1.0, before)
    after = _active_crc(session)
    if after == before and refusal is not None:
        words = f"the vehicle did not go back: {refusal}; the active bank is as before ({checksum(before)})"
        raise GainsError(words, reason="refused")
    return RevertResult(after, before)


def require_ready(session: Session) -> None:
    """Raises GainsError for a vehicle that is armed or has no bank."""
    require_disarmed(session, "nothing was written")
    _require_bank(session)


def require_disarmed(session: Session, then: str) -> None:
    """Raises GainsError, which ends with `then`."""
    if session.snapshot().armed:
        raise GainsError(f"the vehicle is armed: land and disarm first; {then}", reason="armed")


def _require_bank(session: Session) -> None:
    try:
        session.call(ReadParameter(BANK_KNOWN_BY))
    except ProcedureError as error:
        _require_link(session, error)
        raise GainsError(NO_BANK, reason="no bank") from error


def _require_link(session: Session, error: ProcedureError) -> None:
    if session.snapshot().lost:
        raise LinkError(f"the link to the vehicle is lost: {error}") from error


def call(session: Session, procedure: Procedure[T]) -> T:
    """As `Session.call`; raises LinkError where the link is gone."""
    try:
        return session.call(procedure)
    except ProcedureError as error:
        _require_link(session, error)
        raise


def _act(session: Session, name: str, value: float, before: int) -> str | None:
    """Write a parameter that acts, once. Gives why it was refused or not answered, None where it was done.

    `before` is the checksum of the active bank. Only where nothing was said, and that bank is still the active one
    long after, did the write itself get lost, and is sent again.
    """
    for _ in range(ACT_TRIES):
        cursor, _texts = session.texts_since(0)
        try:
            call(session, WriteParameter(name, value, repeat=False))
        except NoAnswerError as error:
            said = " / ".join(text.text for text in session.texts_since(cursor)[1])
            if _active_crc(session) != before:
                return None
            if said:
                return said
            silence = str(error)
        except ProcedureError as error:
            return _in_hex(str(error), name, value)
        else:
            return None
    return _in_hex(silence, name, value)


def _in_hex(text: str, name: str, value: float) -> str:
    """What is said about a write of a checksum, with the checksum as it is written everywhere else."""
    return text.replace(f"{value:.9g}", checksum(int(value))) if name == COMMIT else text


def _active_crc(session: Session) -> int:
    return int(_finite(call(session, ReadParameter(ACTIVE_CRC))))


def _finite(parameter: Parameter) -> float:
    if not math.isfinite(parameter.value):
        raise GainsError(f"the vehicle reports {parameter.name} = {parameter.value}")
    return parameter.value


def _switch(session: Session) -> bool | None:
    try:
        return session.call(ReadParameter(SWITCH, 2)).value == 1.0
    except ProcedureError:
        return None


def _bank(session: Session, prefix: str) -> tuple[int, ...]:
    return tuple(call(session, ReadParameter(prefix + name)).bits for name in BANK)


def _require_equal(held: tuple[int, ...], sent: tuple[int, ...], bank: str, then: str) -> None:
    different = [name for name, a, b in zip(BANK, held, sent, strict=True) if a != b]
    if different:
        words = f"the vehicle's {bank} differs from what was sent in {', '.join(different)}; {then}"
        raise GainsError(words, reason="differs")
