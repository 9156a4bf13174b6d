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
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal, TypeVar

from gcs import documents
from gcs.document_faults import shown
from gcs.errors import LinkError, TippathError
from gcs.flight.identified import Identified
from gcs.flight.session import Session
from gcs.link.events import bits_of_float, float_of_bits
from gcs.link.procedures import NoAnswerError, Parameter, Procedure, ProcedureError, ReadParameter, WriteParameter
from gcs.vehicle.autopilots import (
    ACTIVE,
    ACTIVE_CRC,
    BANK_KNOWN_BY,
    COMMIT,
    LESS_BANK,
    MORE_KNOWN_BY,
    NO_BANK,
    REVERT,
    SHADOW,
    SWITCH,
)

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
FORWARD_MODEL = ("L_p", "M_q", "M_elev")
MORE = (
    *(f"K3{column}" for column in (1, 2, 3, 4)),
    *("G31", "G32"),
    *(name.upper() for name in FORWARD_MODEL),
    *("W1", "W2", "Z1", "Z2"),
    *(f"F{row}{column}" for row in (1, 2, 3) for column in (1, 2, 3, 4)),
)
"""25 further values, of a bank that has them: elevator and dynamic prefilter. Where all are 0 they are not in
the checksum, so that a set without them is the same set on every vehicle."""

ACT_TRIES = 4
PROBES = 2
"""Of a parameter that the vehicle may well not have."""

T = TypeVar("T")


class GainsError(TippathError):
    """A file that holds no set of gains, or a vehicle that does not take it."""

    reason = "gains"


@dataclass(frozen=True, slots=True)
class Gains:
    """One set, as the vehicle holds it."""

    bits: tuple[int, ...]
    """float32 bits, shape (29,), in the order of `BANK`; of a set that has some of `MORE` (54,), those behind."""
    identified: Identified | None = field(default=None, compare=False)
    """What is known of the vehicle that they were designed for."""

    @property
    def crc(self) -> int:
        """24 bits of CRC-32: as many as a float32 carries exactly."""
        told = self.bits if any(self.bits[len(BANK) :]) else self.bits[: len(BANK)]
        return zlib.crc32(struct.pack(f"<{len(told)}I", *told)) & 0xFFFFFF

    @property
    def values(self) -> dict[str, float]:
        return {name: float_of_bits(bits) for name, bits in zip(self.names, self.bits, strict=True)}

    @property
    def names(self) -> tuple[str, ...]:
        return BANK if len(self.bits) == len(BANK) else (*BANK, *MORE)

    @property
    def whole(self) -> Gains:
        """The same with all values of a bank that has `MORE`: a set without any holds zeros there."""
        return replace(self, bits=(*self.bits, *(0,) * (len(BANK) + len(MORE) - len(self.bits))))


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


class Elevator(documents.Open, frozen=True, kw_only=True):
    """The third row of K and of the prefilter."""

    K: Row4
    prefilter: Row2


class DynamicPrefilter(documents.Open, frozen=True, kw_only=True):
    """Models that the rates follow, and what is added to the commands on the way."""

    frequency_rad_s: Row2
    damping: Row2
    F: tuple[Row4, ...]


class GainsDocument(documents.Open, frozen=True, kw_only=True):
    """What a push reads of a GAINS.json."""

    format: Literal["tippath.gains/1"]
    K: tuple[Row4, Row4]
    observer_gain: tuple[Row2, Row2, Row2, Row2]
    prefilter: tuple[Row2, Row2]
    model: _Model
    elevator: Elevator | None = None
    dynamic_prefilter: DynamicPrefilter | None = None
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
    values += _more(held, source)
    names = (*BANK, *MORE)[: len(values)]
    bits = tuple(_bits(value, name, source) for name, value in zip(names, values, strict=True))
    return Gains(bits, held.identified)


def _more(held: GainsDocument, source: str) -> list[float]:
    """In the order of `MORE`, or none where the set has nothing of it. Raises GainsError."""
    third, dynamic = held.elevator, held.dynamic_prefilter
    if third is None and dynamic is None:
        return []
    of_third = [0.0] * 9
    if third is not None:
        missing = [name for name in FORWARD_MODEL[2:] if name not in held.parameters]
        if missing:
            raise GainsError(f"{source}: model.parameters.{missing[0]} is missing, which the elevator's gains need")
        of_third = [*third.K, *third.prefilter, *(held.parameters.get(name, 0.0) for name in FORWARD_MODEL)]
    if dynamic is None:
        return [*of_third, *(0.0,) * 16]
    if len(dynamic.F) != (2 if third is None else 3):
        raise GainsError(f"{source}: dynamic_prefilter.F has {len(dynamic.F)} rows, not one for each command")
    if not min(*dynamic.frequency_rad_s, *dynamic.damping) > 0:
        raise GainsError(f"{source}: dynamic_prefilter: frequency_rad_s and damping are positive")
    rows = [*dynamic.F, (0.0,) * 4][:3]
    return [*of_third, *dynamic.frequency_rad_s, *dynamic.damping, *(value for row in rows for value in row)]


def _bits(value: float, name: str, source: str) -> int:
    try:
        return bits_of_float(value)
    except OverflowError:
        raise GainsError(f"{source}: {name} = {value:g} is too large for the vehicle's float32") from None


def planned_push(session: Session, gains: Gains) -> PushPlan:
    """All that a push asks before it writes, and what it would change. Raises as `push`."""
    require_ready(session)
    gains = _as_held(session, gains)
    crc = _active_crc(session)
    held: tuple[int | None, ...] = _bank(session, ACTIVE, gains.names) if crc else (None,) * len(gains.bits)
    changes = {
        name: (None if now is None else float_of_bits(now), float_of_bits(then))
        for name, now, then in zip(gains.names, held, gains.bits, strict=True)
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
    gains = _as_held(session, gains)
    previous = _active_crc(session)
    if previous == gains.crc and _bank(session, ACTIVE, gains.names) == gains.bits:
        return PushResult(gains.crc, previous, False, gains.values, _switch(session))

    on_progress(f"writing {len(gains.bits)} values to the shadow bank")
    for name, bits in zip(gains.names, gains.bits, strict=True):
        call(session, WriteParameter(SHADOW + name, float_of_bits(bits)))
    on_progress("reading the shadow bank back")
    _require_equal(_bank(session, SHADOW, gains.names), gains, "shadow bank", "nothing was committed")

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
    if active != gains.crc:  # asked a moment before the commit, too: a late copy of that answer proves nothing
        _bank(session, ACTIVE, gains.names)
        active = _active_crc(session)
    if active != gains.crc:
        raise GainsError(
            f"the vehicle did not take the set: {refusal or f'its active bank is {checksum(active)}'}; "
            f"the active bank is {'as before' if active == previous else 'another one'}",
            reason="refused",
        )
    on_progress("reading the active bank back")
    _require_equal(_bank(session, ACTIVE, gains.names), gains, "active bank", "do not fly it: revert")
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


def _as_held(session: Session, gains: Gains) -> Gains:
    """The set with all values that the vehicle's bank has. Raises GainsError where it has fewer than the set."""
    needed = len(gains.bits) > len(BANK)
    try:
        session.call(ReadParameter(MORE_KNOWN_BY) if needed else ReadParameter(MORE_KNOWN_BY, PROBES))
    except ProcedureError as error:
        _require_link(session, error)
        if needed:
            raise GainsError(LESS_BANK, reason="no bank") from error
        return gains
    return gains.whole


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


def _bank(session: Session, prefix: str, names: Sequence[str]) -> tuple[int, ...]:
    return tuple(call(session, ReadParameter(prefix + name)).bits for name in names)


def _require_equal(held: tuple[int, ...], sent: Gains, bank: str, then: str) -> None:
    different = [name for name, a, b in zip(sent.names, held, sent.bits, strict=True) if a != b]
    if different:
        words = f"the vehicle's {bank} differs from what was sent in {', '.join(different)}; {then}"
        raise GainsError(words, reason="differs")
