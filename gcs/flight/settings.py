"""The vehicle's parameters around a maneuver: asked for, written, read back at the start, and given back afterwards.

No answer is never "has none". A vehicle does not say that it lacks a parameter, it is silent; so is a link that lost
the answer, a one-way link, and a vehicle that accepts signed messages only. So a silence counts only where a question
that was sent later was answered, several times in a row.

What scales a maneuver (its magnitude) means another thing on each axis: 15 is 15 degrees on one and fifteen times full
command on another. So axis and magnitude are written in an order in which the pair is never a dangerous one, and a
magnitude that would be dangerous on the axis that stays in the vehicle is not put back.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import chain
from typing import Protocol, TypeVar

from gcs.errors import LinkError, TippathError
from gcs.flight.live import SweepSettings
from gcs.link.encode import ParamRead
from gcs.link.events import bits_of_float
from gcs.link.procedures import NoAnswerError, Procedure, ReadParameter, ReadSeveral, RefusedError, WriteParameter
from gcs.vehicle.autopilots import AROUND_A_MANEUVER, RENAMED
from gcs.vehicle.profile import Plan, VehicleProfile, choose_profile, wanted_parameters
from gcs.vehicle.snapshot import Said, VehicleSnapshot

T = TypeVar("T")

SILENCES = 6
"""So many unanswered questions, each with a later one answered, until a vehicle is believed to lack a parameter: on a
link that loses 30 % each way one in 3,000 is believed that is there."""
SILENCES_OF_NEEDED = 8
"""So many where the vehicle was recognised by having such parameters: a poor link is likelier than a lack."""
CONFIRM_EVERY_S = 0.25
CONFIRM_AT_ONCE = 6
"""Two hundred bytes: an order to end the maneuver waits 35 ms behind them on a slow radio."""
MOST_QUESTIONS = 12
"""So many questions without an answer to anything, and the vehicle counts as one that does not answer."""


class Asking(Protocol):
    """What is needed of a session."""

    def snapshot(self) -> VehicleSnapshot: ...
    def call(self, procedure: Procedure[T], timeout_s: float | None = None) -> T: ...


class Clock(Protocol):
    def now(self) -> float: ...


def recognise(session: Asking, clock: Clock, profiles: Sequence[VehicleProfile] = ()) -> VehicleProfile:
    """What kind of vehicle this is, of these or those that come with the package.

    Raises CannotFlyError; NoAnswerError where it answers nothing.
    """
    held: dict[str, float] = {}
    absent: set[str] = set()
    for names in wanted_parameters(profiles):
        for name in names:
            if name not in held and not absent.intersection(names):
                value = ask(session, clock, name)
                if value is None:
                    absent.add(name)
                else:
                    held[name] = value
    return choose_profile(held, session.snapshot().autopilot, profiles)


def ask(session: Asking, clock: Clock, name: str, most_silences: int = SILENCES) -> float | None:
    """A parameter's value; None where the vehicle certainly has none of that name.

    Raises NoAnswerError where it answers nothing at all, LinkError where the link is lost meanwhile.
    """
    silences = 0
    for _ in range(MOST_QUESTIONS):
        if session.snapshot().lost:
            raise LinkError("the link was lost while the parameters were read; nothing was flown")
        began = clock.now()
        try:
            return session.call(ReadParameter(name, tries=2)).value
        except RefusedError:
            return None  # newer firmware says so
        except NoAnswerError:
            # A later question that was answered came to a vehicle that had this one, or lost it.
            silences += clock.now() - session.snapshot().answer_age_s > began
        if silences >= most_silences:
            return None
    why = (
        "it signs what it says, so it accepts signed messages only: give its key with --key"
        if session.snapshot().signs
        else "a link that carries one way only, or a vehicle that accepts signed messages only"
    )
    raise NoAnswerError(
        f"the vehicle is heard, but answers nothing (asked {MOST_QUESTIONS} times for {name}): {why}; nothing was flown"
    )


def _needed(session: Asking, clock: Clock, name: str) -> float:
    value = ask(session, clock, name, SILENCES_OF_NEEDED)
    if value is None:
        raise NoAnswerError(f"the vehicle answers, but not for {name}, which a maneuver writes; nothing was flown")
    return value


def ask_together(session: Asking, clock: Clock, names: Sequence[str]) -> dict[str, float]:
    """Those of `names` that the vehicle has. All are asked for at once: what it lacks costs the time of one.

    Raises as `ask`.
    """
    held: dict[str, float] = {}
    silences = dict.fromkeys(names, 0)
    for _ in range(MOST_QUESTIONS):
        if not silences:
            return held
        if session.snapshot().lost:
            raise LinkError("the link was lost while the parameters were read; nothing was set")
        began = clock.now()
        answers = session.call(ReadSeveral(tuple(silences), tries=2))
        held |= {name: answer.value for name, answer in answers.items() if answer is not None}
        later = clock.now() - session.snapshot().answer_age_s > began
        silences = {
            name: count + later for name, count in silences.items() if name not in answers and count + later < SILENCES
        }
    if not silences:
        return held
    raise NoAnswerError(
        f"the vehicle is heard, but answers nothing (asked {MOST_QUESTIONS} times for {next(iter(silences))}): a link "
        "that carries one way only, or a vehicle that accepts signed messages only; nothing was set"
    )


def read_settings(session: Asking, clock: Clock, profile: VehicleProfile) -> dict[str, float]:
    """The present values of all that a maneuver writes, and of what decides about a lost link and a steep lean.

    Raises ProcedureError where a maneuver's parameter is not answered: what is not known cannot be put back. Otherwise
    as `ask`.
    """
    settings = {name: _needed(session, clock, name) for name in profile.settings}
    return settings | ask_together(session, clock, (*AROUND_A_MANEUVER, *chain.from_iterable(RENAMED)))


# ------------------------------------------------------------------------------------------------ writing


@dataclass(frozen=True, slots=True)
class Pair:
    """What a maneuver's size is made of: the axis, and the magnitude in the axis' own unit."""

    axis: float
    magnitude: float


def ordered(
    profile: VehicleProfile, now: Mapping[str, float], wanted: Mapping[str, float]
) -> tuple[tuple[str, float], ...]:
    """The writes that lead from the settings `now` to those wanted, so that no step leaves a dangerous pair behind.

    A magnitude of 0 goes in between where neither order would do. What is NaN in `now` is not known, may be anything.
    """
    axis, magnitude = profile.parameters["axis"], profile.parameters["amplitude"]
    rest = tuple((name, value) for name, value in wanted.items() if name not in (axis, magnitude))
    if axis not in wanted or magnitude not in wanted:
        return tuple(wanted.items())
    before = Pair(now.get(axis, 0.0), now.get(magnitude, 0.0))
    after = Pair(wanted[axis], wanted[magnitude])
    to_axis, to_magnitude = (axis, after.axis), (magnitude, after.magnitude)
    if not profile.dangerous(after.axis, before.magnitude):
        first: tuple[tuple[str, float], ...] = (to_axis, to_magnitude)
    elif not math.isnan(before.axis) and not profile.dangerous(before.axis, after.magnitude):
        first = (to_magnitude, to_axis)
    else:
        first = ((magnitude, 0.0), to_axis, to_magnitude)
    return (*first, *rest)


def write_plan(session: Asking, plan: Plan, profile: VehicleProfile, now: dict[str, float]) -> None:
    """Write a maneuver's parameters, each until the vehicle echoes its very bits, and note it in `now`.

    One that was written and not echoed may be there or not: it is NaN in `now`.
    Raises ProcedureError where one is refused, TippathError in the excitation mode, which reads them at once.
    """
    for name, value in ordered(profile, now, dict(plan.writes)):
        if session.snapshot().mode == profile.excitation_mode:
            raise TippathError("the vehicle is in its excitation mode: no parameter is written now")
        now[name] = math.nan
        session.call(WriteParameter(name, value))
        now[name] = value


def changed_since(session: Asking, plan: Plan) -> str:
    """What the vehicle holds otherwise than was written and shown; empty where all is as planned.

    Raises ProcedureError where it does not answer.
    """
    for name, value in plan.writes:
        held = session.call(ReadParameter(name))
        if bits_of_float(held.value) != bits_of_float(value):
            return (
                f"{name} is {held.value:g} in the vehicle, not {value:g} as shown: somebody else changed it; "
                "nothing was started"
            )
    return ""


class SettingsInFlight:
    """What the vehicle says, once a maneuver is about to start, of the settings that it flies by.

    Vehicles tell all stations what one of them wrote. Such a word may be lost, and the vehicle's own record of the
    maneuver does not come where its log stays on the card: there all are asked for once more, after the start.
    """

    def __init__(self, plan: Plan, heard: int) -> None:
        """`heard` is the number of the last word that is not to be listened to."""
        self.otherwise = ""
        """What is not as planned; empty as far as all is."""
        self._planned = dict(plan.writes)
        self._open = deque(self._planned)
        self._asked_at = -math.inf
        self._heard = heard

    @property
    def unanswered(self) -> tuple[str, ...]:
        """Those that were not told of since the start."""
        return tuple(self._open)

    def hear(self, said: Sequence[Said], *, flying: bool) -> None:
        """What was said until now. After the maneuver only answers count that it was waited for: others may change
        what is flown no more."""
        new = [one for one in said if one.number > self._heard and one.name in self._planned]
        self._heard = said[-1].number if said else self._heard
        for one in new:
            awaited = one.name in self._open and self._asked_at > -math.inf
            if (flying or awaited) and bits_of_float(one.value) != bits_of_float(planned := self._planned[one.name]):
                self.otherwise = (
                    f"{one.name} is {one.value:g} in the vehicle, not {planned:g}: somebody else changed it"
                )
            if awaited:
                self._open.remove(one.name)

    def ask(self, now: float) -> list[ParamRead]:
        """Some of what was not told of yet, in turn."""
        if now - self._asked_at < CONFIRM_EVERY_S:
            return []
        self._asked_at = now
        self._open.rotate(-CONFIRM_AT_ONCE)
        return [ParamRead(name) for name in tuple(self._open)[-CONFIRM_AT_ONCE:]]


_RECORDED = {
    "axis": "axis",
    "amplitude": "magnitude",
    "f_start_hz": "f_start_hz",
    "f_stop_hz": "f_stop_hz",
    "fade_in_s": "fade_in_s",
    "duration_s": "duration_s",
    "fade_out_s": "fade_out_s",
    "kind": "kind",
    "law": "law",
    "c1": "c1",
    "noise_fraction": "noise",
    "pulse_s": "pulse_s",
}
"""Our word for a setting -> where the vehicle's own record of the maneuver has it."""


def flown_otherwise(plan: Plan, recorded: SweepSettings) -> str:
    """What the vehicle's own record of the maneuver says otherwise than planned; empty where it does not.

    What it does not record is not compared.
    """
    differing = []
    for word, value in plan.asked.items():
        held = getattr(recorded, _RECORDED[word]) if word in _RECORDED else None
        if held is not None and not math.isclose(held, value, rel_tol=1e-5, abs_tol=1e-6):
            differing.append(f"{word} {held:g}, not {value:g}")
    return f"the vehicle flies {', '.join(differing)}" if differing else ""


def give_back(
    session: Asking, profile: VehicleProfile, now: Mapping[str, float], before: Mapping[str, float]
) -> list[str]:
    """Put the vehicle's own settings back, as they were `before`; in words what could not be, or must not be.

    For a vehicle that is certainly not excited. Stops at the first that is not taken. Never raises ProcedureError.
    """
    axis, magnitude = profile.parameters["axis"], profile.parameters["amplitude"]
    wanted = {name: before[name] for name in reversed(profile.settings) if name in before}
    words = []
    if axis in wanted and magnitude in wanted and profile.dangerous(wanted[axis], wanted[magnitude]):
        kept = 0.0 if profile.dangerous(wanted[axis], now.get(magnitude, 0.0)) else now.get(magnitude, 0.0)
        words.append(
            f"{magnitude} {wanted[magnitude]:g} is not put back: on axis {wanted[axis]:g}, which stays in the vehicle, "
            f"it would be dangerous; it is {kept:g} now"
        )
        wanted[magnitude] = kept
    settings = dict(now)
    for name, value in ordered(profile, now, wanted):
        snapshot = session.snapshot()
        if snapshot.mode == profile.excitation_mode:
            words.append(f"{name} is not as it was before: the mode is {snapshot.mode_name}, nothing is written now")
            break
        try:
            session.call(WriteParameter(name, value))
        except (NoAnswerError, RefusedError) as error:
            refused = isinstance(error, RefusedError)
            words.append(
                f"{name} is not as it was before: {error}" if refused else f"{name} may not be as before: {error}"
            )
            if name == axis:
                held = settings.get(magnitude, 0.0)
                words.append(f"{magnitude} stays {'as it is' if math.isnan(held) else f'{held:g}'} with it")
            break
        settings[name] = value
    return words
