"""Which maneuver, or which measurement, would tell rivals apart that these runs cannot.

Every maneuver that a card can hold is imagined: the commands by the chirp's law with its noise, both rivals answering.
What one of them cannot imitate of the other, its parameters refitted to the flown runs and the imagined ones together,
is compared with the noise's spectrum of the flown runs: a separation in standard errors, of which only what the new run
adds counts. The cheapest card that adds NEEDED is proposed: seconds of flight, dearer with amplitude. Amplitudes stay
within twice what was flown and inside the envelope as the flown peaks grow with them. Runs that were flown already
and not fitted are asked first, by what they hold: what these tell need not be flown.

Where no card helps, signals are imagined logged: the servo's position, the flapping, the attitude by another sensor;
then what a hand may do meanwhile: yaw, move the collective, change the rotor speed. That a lag in all servos and one in
both gyros need such a thing is computed here, not listed: every input that a card moves passes the servos, the
elevator's too, and every answer the gyros.

Ignored: the controller, which changes the commands below some 1 Hz; so separations are good to about a factor of two.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import PurePath
from typing import TYPE_CHECKING, Any

import numpy as np

from sysid.data.airframe import Airframe
from sysid.data.dataset import Dataset
from sysid.data.record import CHANNELS, Record, axis_of
from sysid.diagnose.evidence import Candidate
from sysid.diagnose.flown_already import Group, flown_already
from sysid.diagnose.maneuver_plans import Flown, Plan, flew, plans_by_hand, possible_plans
from sysid.diagnose.proposals import (
    FitRuns,
    FurtherApart,
    HalfAndFull,
    LinearHalves,
    LogChannels,
    LogSignal,
    MeasuredNotGuessed,
    SignalTells,
    Why,
)
from sysid.diagnose.rivals import NEEDED, Rivals, name_of
from sysid.diagnose.unlogged_signals import NOISE_OF, told_by_signal
from sysid.fit.noise import Division
from sysid.fit.whitening import Whitening
from sysid.model.effect import catalogue

if TYPE_CHECKING:
    from sysid.diagnose.proposals import Proposal

HOPELESS = 1e-3
"""Linear rivals to which one maneuver on the cyclic adds no more are equal on it, however it is moved."""
SAME_WHATEVER = 0.3
"""Below it in every maneuver, the rivals are the same on these channels."""
MOST_USUAL = 2
"""Parameters that are told of an effect through which a hand acts."""


@dataclass(frozen=True)
class NextManeuver:
    """What to do next."""

    proposal: Proposal
    """What to fly or to log."""
    separates: tuple[str, ...]
    """Rivals, the winner first."""
    why: Why
    sigma: float | None
    """Expected separation, in standard errors; None where it cannot be foretold."""
    card: Mapping[str, Any] | None
    """A test card as its TOML reads, where a card can hold it."""

    @property
    def toml(self) -> str | None:
        """The card as text."""
        return None if self.card is None else _toml(self.card)


def next_maneuver(
    rivals: Sequence[Candidate],
    division: Division,
    whitening: Whitening,
    *,
    doublets: bool = True,
    unfitted: Dataset | None = None,
) -> NextManeuver | None:
    """For the winner and what the data cannot tell from it, the winner first; None where nothing imagined helps.

    doublets: whether the vehicle flies them, besides chirps. unfitted: runs that were flown and not fitted.
    """
    if len(rivals) < 2:
        return None
    winner, *others = rivals
    flown = Flown.of(winner)
    pairs = [Rivals.of(winner, other, whitening) for other in others]
    groups = flown_already(pairs, unfitted, division)
    there = groups[0] if groups and groups[0].tells else None
    if there is not None and there.tells == len(pairs):
        return _to_fit(there, pairs)
    found = _imagined(possible_plans(flown, rivals, doublets=doublets), pairs, flown, division)
    chosen = _cheapest(found)
    if there is not None and (chosen is None or there.tells >= sum(sigma >= NEEDED for sigma, _ in chosen[1])):
        return _to_fit(there, pairs)
    if chosen is not None:
        return _proposal(*chosen, pairs, flown, groups, () if unfitted is None else unfitted.records)
    most = [max((each[i][0] for _, each in found), default=0.0) for i in range(len(pairs))]
    measured = _measurement(pairs, most)
    if measured is not None:
        return measured
    chosen = _cheapest(_imagined(plans_by_hand(flown, rivals), pairs, flown, division))
    return _own_signal(pairs) if chosen is None else _proposal(*chosen, pairs, flown)


def _imagined(
    plans: Sequence[Plan], pairs: Sequence[Rivals], flown: Flown, division: Division
) -> list[tuple[Plan, list[Told]]]:
    """What each plan would tell, the cheapest first; once one tells everything, dearer ones are not asked."""
    found: list[tuple[Plan, list[Told]]] = []
    enough = math.inf
    linear = all(one.model.structure.linear for pair in pairs for one in (pair.truth, pair.rival))
    hopeless = False
    for plan in sorted(plans, key=lambda one: one.cost):
        if plan.cost >= enough:
            break
        if hopeless and plan.effect is None:
            continue
        each = [pair.told_by(plan, flown, division) for pair in pairs]
        found.append((plan, each))
        hopeless |= linear and plan.effect is None and all(sigma < HOPELESS for sigma, _ in each)
        if all(sigma >= NEEDED for sigma, _ in each):
            enough = min(enough, replace(plan, repeats=max(repeats for _, repeats in each)).cost)
    return found


def linear_or_not(parent: Candidate, division: Division) -> NextManeuver | None:
    """For an error that nothing explains: the same chirp at half the amplitude, against what was flown.

    A linear error halves; one that grows with the square is a quarter. `division` is that of the parent's residual.
    """
    flown = Flown.of(parent)
    axis = max(flown.amplitude, key=lambda name: flown.amplitude[name], default=None)
    if axis is None:
        return None
    share = np.sum(np.maximum(np.sum(division.explained, axis=0), 0)) / max(float(np.sum(division.power)), 1e-300)
    beyond = max(division.chi_squared - division.degrees, 0.0) / max(len(parent.dataset.spectra), 1)
    worst = int(np.argmax(parent.estimate.error.residual_power / parent.estimate.error.measured_power))
    wanted = axis_of(parent.model.structure.outputs[worst])
    axis = wanted if wanted in flown.amplitude else axis
    plans = [flown.chirp(axis, part) for part in (0.5, 1)]
    sigma = 0.25 * math.sqrt(beyond)
    tables = [replace(one, repeats=2).table() for one in plans]
    card = _card("half and full", tables) if all(one.on_card for one in plans) else None
    why = LinearHalves(float(share))
    return NextManeuver(HalfAndFull(plans[1]), ("linear", "nonlinear"), why, sigma if sigma > 0 else None, card)


Told = tuple[float, int]


def _cheapest(found: Sequence[tuple[Plan, list[Told]]]) -> tuple[Plan, list[Told]] | None:
    """Of the plans that tell most rivals from the winner, the cheapest."""
    best: tuple[tuple[int, float], Plan, list[Told]] | None = None
    for plan, each in found:
        told = [one for one in each if one[0] >= NEEDED]
        if told:
            repeated = replace(plan, repeats=max(repeats for _, repeats in told))
            key = (-len(told), repeated.cost)
            if best is None or key < best[0]:
                best = (key, repeated, each)
    return None if best is None else best[1:]


def _proposal(
    plan: Plan,
    each: Sequence[Told],
    pairs: Sequence[Rivals],
    flown: Flown,
    groups: Sequence[Group] = (),
    unfitted: Sequence[Record] = (),
) -> NextManeuver:
    names, why = _told([sigma for sigma, _ in each], pairs)
    acting = () if plan.effect is None else catalogue()[plan.effect].parameters
    why = replace(
        why,
        usual=tuple((one, one.typical) for one in acting) if len(acting) <= MOST_USUAL else (),
        repeats=tuple(run.id for run in (*flown.dataset.records, *unfitted) if flew(plan, run)),
        too_little=next(((one.ids, min(one.each)) for one in groups if one.flew(plan)), None),
    )
    card = None if not plan.on_card else _card(_named(names), [plan.table()])
    return NextManeuver(plan, names, why, why.sigma, card)


def _to_fit(group: Group, pairs: Sequence[Rivals]) -> NextManeuver:
    """Runs that need not be flown again."""
    names, why = _told(group.each, pairs)
    one = group.records[0]
    return NextManeuver(FitRuns(group.ids, one.maneuver, one.axis), names, why, why.sigma, None)


def _told(each: Sequence[float], pairs: Sequence[Rivals]) -> tuple[tuple[str, ...], FurtherApart]:
    """Which rivals so many standard errors tell from the winner, the winner first, and how far apart."""
    told = [(pair, sigma) for pair, sigma in zip(pairs, each, strict=True) if sigma >= NEEDED]
    rest = tuple(pair.names[1] for pair, sigma in zip(pairs, each, strict=True) if sigma < NEEDED)
    sigma, before = min(sigma for _, sigma in told), min(pair.flown for pair, _ in told)
    return (pairs[0].names[0], *(pair.names[1] for pair, _ in told)), FurtherApart(
        sigma=sigma, before=before, rest=rest
    )


def _named(rivals: Sequence[str]) -> str:
    """A card's name is shown on a line: of many rivals two, files without their folder."""
    names = [PurePath(name).name for name in rivals]
    more = f" and {len(names) - 2} more" if len(names) > 2 else ""
    return f"{names[0]} or {names[1]}{more}" if len(names) > 1 else names[0]


def _card(name: str, tables: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    return {"name": name, "maneuver": [dict(one) for one in tables]}


def _toml(card: Mapping[str, Any]) -> str:
    lines = [f"name = {_quoted(card['name'])}"]
    for table in card["maneuver"]:
        lines += ["", "[[maneuver]]"]
        lines += [f"{key} = {_quoted(x) if isinstance(x, str) else repr(x)}" for key, x in table.items()]
    return "\n".join(lines) + "\n"


def _quoted(text: str) -> str:
    """A JSON string is a TOML string: a user's effect is named by its path."""
    return json.dumps(text, ensure_ascii=False)


def _measurement(pairs: Sequence[Rivals], most: Sequence[float]) -> NextManeuver | None:
    """The signal that tells most rivals from the winner when the flown maneuvers are flown again with it logged."""
    best: tuple[tuple[int, float], str, list[float]] | None = None
    for signal in NOISE_OF:
        each = [told_by_signal(pair, signal) for pair in pairs]
        reached = [sigma for sigma in each if sigma >= NEEDED]
        if reached and (best is None or (len(reached), min(reached)) > best[0]):
            best = ((len(reached), min(reached)), signal, each)
    if best is None:
        return None
    (_, least), signal, each = best
    told = [i for i, sigma in enumerate(each) if sigma >= NEEDED]
    names = (pairs[0].names[0], *(pairs[i].names[1] for i in told))
    same = all(most[i] < SAME_WHATEVER for i in told)
    by_motors = signal == "servo" and pairs[0].truth.dataset.airframe is Airframe.MULTIROTOR
    return NextManeuver(LogSignal("motors" if by_motors else signal), names, SignalTells(least, same), least, None)


def _own_signal(pairs: Sequence[Rivals]) -> NextManeuver | None:
    """A quantity that one rival is about and the log could hold: measured, it need not be guessed."""
    for pair in pairs:
        for one in (pair.truth, pair.rival):
            known = one.dataset.available
            structure = one.model.structure
            base = (*structure.base_.states, "a", "b")
            own = [name for name in structure.states if name in CHANNELS and name not in base]
            missing = [name for name in own if name not in known]
            if missing:
                why = MeasuredNotGuessed(name_of(one))
                return NextManeuver(LogChannels(tuple(missing)), pair.names, why, None, None)
    return None
