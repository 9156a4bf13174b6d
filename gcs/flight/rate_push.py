"""Rate gains to a stock autopilot as one verified set, with the set before it kept, and back again.

PARAM_SET writes one value. Where the vehicle runs the script that holds a second set behind the pilot's switch, the new
set goes to the script's own parameters, is read back bit for bit, and its checksum commits it: what flies is not
touched. Where it does not, each gain itself is written and read back, on the ground; a set that cannot be written whole
is taken back, and what stands otherwise is said gain by gain.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from gcs.errors import LinkError
from gcs.flight.gains import GainsError, call, checksum, require_disarmed
from gcs.flight.rate_set import SetBefore
from gcs.flight.session import Session
from gcs.link.events import bits_of_float, float_of_bits
from gcs.link.procedures import TRIES, AwaitParameter, ProcedureError, ReadParameter, ReadSeveral, WriteParameter
from gcs.vehicle import gain_switch as script
from gcs.vehicle.autopilots import BANK_KNOWN_BY

ARMED = "nothing was written"


@dataclass(frozen=True, kw_only=True)
class Switch:
    """The script on the vehicle."""

    active: int
    """Checksum of the set behind the switch; 0: none."""
    flies: bool
    channel: int | None
    """Of the pilot's switch; None where none has the option."""
    option: float


@dataclass(frozen=True, kw_only=True)
class Held:
    """What the vehicle has now."""

    bits: Mapping[str, int]
    """float32 of each gain of a set."""
    switch: Switch | None
    """None where no script runs."""

    @property
    def values(self) -> dict[str, float]:
        return {name: float_of_bits(bits) for name, bits in self.bits.items()}


@dataclass(frozen=True, kw_only=True)
class RatePush:
    """What a push did."""

    before: Mapping[str, float]
    now: Mapping[str, float]
    """As read back: behind the switch, or of the autopilot itself."""
    committed: bool
    """False where the vehicle had this set already."""
    crc: int
    behind: Switch | None
    """The switch that it is behind; None where it flies from now on."""

    def to_json(self) -> dict[str, Any]:
        behind = None if self.behind is None else {"channel": self.behind.channel, "option": self.behind.option}
        return {
            "format": "tippath.push/1",
            "parameters": {name: {"before": was, "now": self.now[name]} for name, was in self.before.items()},
            "crc": self.crc,
            "checksum": checksum(self.crc),
            "committed": self.committed,
            "verified": len(self.now),
            "behind_switch": behind,
        }


def held(session: Session, names: Mapping[str, float]) -> Held:
    """All that a push asks before it writes. Raises GainsError for an armed vehicle, and one without these gains."""
    require_disarmed(session, ARMED)
    answered = call(session, ReadSeveral(script.SET))
    lacking = [name for name in names if answered.get(name) is None]
    if lacking:
        raise GainsError(
            f"the vehicle has no {', '.join(lacking)}: another frame or firmware than these gains are for; nothing was "
            "written",
            reason="no parameter",
        )
    bits = {name: one.bits for name in script.SET if (one := answered.get(name)) is not None}
    return Held(bits=bits, switch=_switch(session))


def _switch(session: Session) -> Switch | None:
    answered = call(session, ReadSeveral((script.ACTIVE, script.FLIES, script.FUNC), TRIES))
    active, flies, option = (answered.get(name) for name in (script.ACTIVE, script.FLIES, script.FUNC))
    if active is None or flies is None or option is None:
        return None
    options = call(session, ReadSeveral(script.OPTIONS, TRIES))
    told = {name: one.value for name, one in options.items() if one is not None}
    channel = script.channel_of(told, option.value)
    return Switch(active=int(active.value), flies=flies.value == 1.0, channel=channel, option=option.value)


def has_switch(session: Session) -> bool:
    """Whether the script runs on this vehicle, which has no bank then."""
    asked = call(session, ReadSeveral((script.ACTIVE, BANK_KNOWN_BY), TRIES))
    return asked.get(BANK_KNOWN_BY) is None and asked.get(script.ACTIVE) is not None


def whole(new: Mapping[str, float], now: Held) -> dict[str, int]:
    """A set's float32 bits; gains that it does not name stay as they are."""
    return {name: bits_of_float(new[name]) if name in new else bits for name, bits in now.bits.items()}


def push_behind(
    session: Session, new: Mapping[str, float], now: Held, on_progress: Callable[[str], None] = lambda _: None
) -> RatePush:
    """The set behind the pilot's switch. Raises GainsError, ProcedureError, LinkError; what flies stays as it is."""
    assert now.switch is not None
    wanted = whole(new, now)
    values = {name: float_of_bits(bits) for name, bits in wanted.items()}
    crc = script.checksum(tuple(values[name] for name in script.SET))
    done = RatePush(before=now.values, now=values, committed=True, crc=crc, behind=now.switch)
    on_progress(f"writing {len(wanted)} values beside those that fly")
    for name, value in values.items():
        require_disarmed(session, "nothing was committed")
        call(session, WriteParameter(script.NEW[name], value))
    on_progress("reading them back")
    back = {name: call(session, ReadParameter(script.NEW[name])).bits for name in wanted}
    _require_same(back, wanted, "the script's new set differs from what was sent in", "nothing was committed")
    _require_unchanged(session, now)
    on_progress(f"committing {checksum(crc)}")
    cursor, _ = session.texts_since(0)
    call(session, WriteParameter(script.COMMIT, float(crc)))
    _finish(session, cursor)
    active = int(call(session, ReadParameter(script.ACTIVE)).value)
    if active != crc:
        said = " / ".join(text.text for text in session.texts_since(cursor)[1])
        raise GainsError(f"the script did not take the set: {said or checksum(active)}; what flies is as before")
    return done


def forget_behind(session: Session) -> int:
    """No new set behind the switch any more; the checksum of the one that was. Raises as `push_behind`."""
    require_disarmed(session, "nothing was written; in the air the pilot's switch is the way back")
    was = int(call(session, ReadParameter(script.ACTIVE)).value)
    if not was:
        raise GainsError("no new set is behind the switch: there is nothing to go back from", reason="no bank")
    cursor, _ = session.texts_since(0)
    call(session, WriteParameter(script.COMMIT, script.FORGET))
    _finish(session, cursor)
    if call(session, ReadParameter(script.ACTIVE)).value:
        said = " / ".join(text.text for text in session.texts_since(cursor)[1])
        raise GainsError(f"the script did not forget its set{f': {said}' if said else ''}", reason="refused")
    return was


def _finish(session: Session, cursor: int) -> None:
    """Wait until the script has done what was asked of it."""
    try:
        call(session, AwaitParameter(script.COMMIT, 0.0))
    except ProcedureError as error:
        said = " / ".join(text.text for text in session.texts_since(cursor)[1])
        raise GainsError(
            f"the script does not answer ({error}){f'; it says: {said}' if said else ''}: restart the vehicle, and "
            "look whether the script runs; what flies is as before",
            reason="no answer",
        ) from error


def push_directly(
    session: Session,
    new: Mapping[str, float],
    now: Held,
    *,
    keep: Callable[[SetBefore], object],
    on_progress: Callable[[str], None] = lambda _: None,
) -> RatePush:
    """Each gain itself; it flies from the next take-off. `keep` is given the set before it, before a gain is written.

    Raises GainsError, ProcedureError, LinkError; the message says which gains are new where not all were taken back.
    """
    wanted = whole(new, now)
    values = {name: float_of_bits(bits) for name, bits in wanted.items()}
    changed = {name: bits for name, bits in wanted.items() if bits != now.bits[name]}
    crc = script.checksum(tuple(values[name] for name in wanted))
    if changed:
        keep(SetBefore(before=now.values, pushed=values))
        _require_unchanged(session, now)
        _write_all(session, changed, now.bits, on_progress)
        on_progress("reading the set back")
        back = _read(session, tuple(wanted))
        _require_same(back, wanted, "the vehicle holds other values than were sent in", "do not fly it: revert")
    return RatePush(before=now.values, now=values, committed=bool(changed), crc=crc, behind=None)


def put_back(session: Session, kept: SetBefore, *, anyway: bool = False) -> dict[str, float]:
    """The set before a push again, a half-written one included; what was changed.

    Raises GainsError, reason `differs`, where a gain is neither what was there nor what was pushed, unless `anyway`.
    """
    now = held(session, kept.before)
    wanted = {name: bits_of_float(value) for name, value in kept.before.items()}
    pushed = {name: bits_of_float(value) for name, value in kept.pushed.items()}
    others = [name for name, bits in wanted.items() if now.bits[name] not in (bits, pushed[name])]
    if others and not anyway:
        raise GainsError(
            f"somebody else has changed {', '.join(others)} since the push; nothing was written: find out who, or say "
            "--why",
            reason="differs",
        )
    changed = {name: bits for name, bits in wanted.items() if bits != now.bits[name]}
    _write_all(session, changed, now.bits, lambda _: None)
    back = _read(session, tuple(wanted))
    _require_same(back, wanted, "the vehicle holds other values than were sent in", "do not fly it")
    return {name: float_of_bits(bits) for name, bits in changed.items()}


def _write_all(
    session: Session, wanted: Mapping[str, int], before: Mapping[str, int], on_progress: Callable[[str], None]
) -> None:
    """Every one, or none: what was written is taken back where one is refused. What cannot be is said."""
    written: list[str] = []
    try:
        for name, bits in wanted.items():
            require_disarmed(session, "the set is taken back")
            on_progress(f"writing {name} {float_of_bits(bits):.6g}")
            written.append(name)
            call(session, WriteParameter(name, float_of_bits(bits)))
    except (ProcedureError, LinkError, GainsError) as error:
        left = _take_back(session, written, before)
        stands = f"these are not known to be as before: {', '.join(left)}; do not fly it, and revert by the kept file"
        told = f"{error}; {stands if left else 'every gain is as before'}"
        raise GainsError(told, reason="half written" if left else getattr(error, "reason", "refused")) from error


def _take_back(session: Session, written: list[str], before: Mapping[str, int]) -> list[str]:
    """Those that could not be."""
    left: list[str] = []
    for number, name in enumerate(written):
        if session.snapshot().lost:
            return [*left, *written[number:]]
        try:
            call(session, WriteParameter(name, float_of_bits(before[name])))
        except (ProcedureError, LinkError):
            left.append(name)
    return left


def _require_unchanged(session: Session, now: Held) -> None:
    require_disarmed(session, ARMED)
    others = [name for name, bits in _read(session, tuple(now.bits)).items() if bits != now.bits[name]]
    if others:
        raise GainsError(
            f"somebody else has changed {', '.join(others)} meanwhile; nothing was written: find out who, and push "
            "again",
            reason="differs",
        )


def _require_same(back: Mapping[str, int], sent: Mapping[str, int], words: str, then: str) -> None:
    different = [name for name, bits in sent.items() if back[name] != bits]
    if different:
        raise GainsError(f"{words} {', '.join(different)}; {then}", reason="differs")


def _read(session: Session, names: tuple[str, ...]) -> dict[str, int]:
    answered = call(session, ReadSeveral(names))
    missing = [name for name in names if answered.get(name) is None]
    if missing:
        raise GainsError(f"not answered: {', '.join(missing)}", reason="no answer")
    return {name: one.bits for name, one in answered.items() if one is not None}
