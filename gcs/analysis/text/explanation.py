"""Why a diagnosis says what it says, in the words of somebody who flies."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from typing import Any, assert_never

from gcs.analysis.quantities import amount, amount_signed, listed, plausible_range, quantity
from gcs.analysis.text.blocks import WIDTH
from sysid.diagnose.explain import Explanation
from sysid.diagnose.reasons import (
    Alike,
    BestLinear,
    Change,
    ComesNear,
    EffectFound,
    FitRises,
    GainFalls,
    GainStays,
    GoesWithChannel,
    GrowsWithCommand,
    ImplausibleBefore,
    InOneBand,
    InStepWithCommand,
    ModesMove,
    NearerResponses,
    NoLinearAnswer,
    NothingKnown,
    NothingMissing,
    Nrmse,
    OnOneAxis,
    ParametersMove,
    PhaseFalls,
    Resemblance,
    Shown,
    Size,
    StandsIn,
    What,
)
from sysid.model.structure import Mode


def explanation_document(explanation: Explanation) -> dict[str, Any]:
    """`effects`, and the sentences of each part."""
    return {"effects": list(explanation.effects), **_parts(explanation)}


def explanation_lines(explanation: Explanation, width: int = WIDTH) -> list[str]:
    """As text, a heading for each part, continued lines indented."""
    parts = _parts(explanation)
    lines = []
    for heading, key in (
        ("what it is", "what"),
        ("why", "why"),
        ("what changes", "changes"),
        ("what else could look so", "resembles"),
    ):
        if parts[key]:
            lines.append(heading)
            for sentence in parts[key]:
                lines += textwrap.wrap(sentence, width, initial_indent="  ", subsequent_indent="    ")
    return lines


def _parts(explanation: Explanation) -> dict[str, list[str]]:
    why = [f"Its mark: {mark}." for mark in explanation.marks] + [shown_text(one) for one in explanation.shown]
    return {
        "what": [_what(one) for one in explanation.what],
        "why": why + ([] if explanation.rise is None else [_rise(explanation.rise)]),
        "changes": [_change(one) for one in explanation.changes],
        "resembles": [_resemblance(one) for one in explanation.resembles],
    }


def _what(what: What) -> str:
    match what:
        case NothingMissing(nrmse):
            left = f"what the model leaves (fit {_reached(nrmse)}) is noise"
            return f"Nothing is missing that these runs could show: {left}."
        case NothingKnown(nrmse):
            left = f"What the model leaves (fit {_reached(nrmse)}) is more than noise"
            return f"{left}, and no effect of the catalogue explains it."
        case EffectFound(effect, sizes, none):
            values = [_judged(size) for size in sizes]
            values += [f"not to be told from none: {listed(none)}"] if none else []
            title = effect.title[0].upper() + effect.title[1:]
            return f"{title}: {effect.equation}; {', '.join(values)}. Source: {effect.source}."
    assert_never(what)


def _reached(nrmse_percent: Nrmse) -> str:
    return ", ".join(f"{name} {value:.1f} %" for name, value in nrmse_percent.items())


def _judged(size: Size) -> str:
    """A value, and what is plausible for it."""
    allowed = plausible_range(size.parameter)
    said, wild = _quantity(size), size.parameter.implausible(size.value, size.error or 0.0)
    return f"{said} ({'NOT ' if wild else ''}plausible: {allowed})" if allowed else said


def shown_text(shown: Shown) -> str:
    """What these runs show of an effect."""
    match shown:
        case PhaseFalls(degrees, top_hz, late_s):
            late = ", ".join(f"{output} {1000 * delay:.0f} ms" for output, delay in late_s.items())
            far = f"by {degrees:.0f} degrees up to {top_hz:.1f} Hz"
            return f"The phase falls in proportion to frequency, {far}: {late} late."
        case GainFalls(lost_db):
            return f"The gain falls too, by {lost_db:.1f} dB there, as behind a lag: a pure delay would keep it."
        case GainStays(within_db, of_lag_db):
            return (
                f"The gain stays within {max(within_db, 0.1):.1f} dB, as behind a delay: a first-order lag would lose "
                f"{of_lag_db:.1f} dB."
            )
        case NearerResponses(without, with_it):
            off = f"Without it the responses are {without[0]:.1f} dB and {without[1]:.1f} degrees off"
            return f"{off}, with it {with_it[0]:.1f} dB and {with_it[1]:.1f} degrees."
        case OnOneAxis(axis, share):
            return f"{100 * share:.0f} % of the error that it takes away is in {axis}."
        case InOneBand(axis, share, (low, high)):
            where = f"in {low:.1f}-{high:.1f} Hz" if low > 0 else f"below {high:.1f} Hz"
            return f"{100 * share:.0f} % of the {axis} error it removes lies {where}."
        case NoLinearAnswer(share):
            return f"{100 * share:.0f} % of the error that it takes away is no linear answer to the commands."
        case InStepWithCommand(axis, share, command):
            return f"{100 * share:.0f} % of the {axis} error it removes is in step with {command}."
        case GoesWithChannel(channel, correlation):
            return f"The error comes and goes with {channel} (correlation {correlation:.2f})."
        case GrowsWithCommand(command, times):
            return f"Twice the command ({command}) makes {times:.1f} times the error: it grows with amplitude."
        case BestLinear(effects, share):
            best = f"The best effect with constant coefficients, {_named(effects)},"
            return f"{best} gets {100 * share:.0f} % of the way."
    assert_never(shown)


def _rise(rise: FitRises) -> str:
    each = ", ".join(f"{name} {rise.before[name]:.1f} → {rise.after[name]:.1f} %" for name in rise.before)
    return f"With it the fit goes from {each}."


def _change(change: Change) -> str:
    match change:
        case ParametersMove(moves, more):
            each = [f"{old.parameter.name} {_turned(old, new)}" for old, new in moves]
            return f"Before and after: {'; '.join([*each, *([f'{more} more'] if more else [])])}."
        case ModesMove(moves, new):
            turned = [f"{_mode(old)} → {_mode(after)}" for old, after in moves]
            equal_once = dict.fromkeys(f"new {_mode(mode)}" for mode in new)  # equal servos have equal modes
            return f"Modes: {', '.join([*turned, *equal_once])}."
        case ImplausibleBefore():
            return _implausible(change)
    assert_never(change)


def _turned(old: Size, new: Size) -> str:
    """`459 ± 2 → 709 ± 4 1/s^2`: the unit once where it is the same."""
    first, second = (amount(size.parameter, size.value, size.error) for size in (old, new))
    units = (" ms", f" {old.parameter.unit}")
    unit = next((each for each in units if first.endswith(each) and second.endswith(each)), "")
    return f"{first.removesuffix(unit)} → {second}"


def _mode(mode: Mode) -> str:
    return f"{mode.frequency_hz:.2f} Hz {mode.damping_ratio:.2f}"


def _implausible(change: ImplausibleBefore) -> str:
    size = change.size
    value, allowed = amount_signed(size.parameter, size.value), plausible_range(size.parameter)
    begin = f"{value} is not plausible ({allowed}): it stands in for something"
    if change.now is None:
        return f"{begin}, and no effect that was refitted makes it plausible."
    now = amount(change.now.parameter, change.now.value, change.now.error)
    if change.added:
        return f"{begin}. With {' and '.join(change.cure)} it becomes {now}."
    more = f" So would {listed([_named(effects) for effects in change.others])}." if change.others else ""
    return f"{begin}. {_named(change.cure)} would make it plausible: {now}.{more}"


def _resemblance(resemblance: Resemblance) -> str:
    match resemblance:
        case StandsIn():
            return _stands_in(resemblance)
        case Alike(effects):
            values = [name if sizes is None else f"{name} ({_quantities(sizes)})" for name, sizes in effects]
            return f"These runs cannot tell it from {listed(values)}."
        case ComesNear(effects, share, outside):
            only = f"only with {_outside(outside)}"
            return f"{_named(effects)} comes near ({100 * share:.0f} %), but {only}: it stands in."
    assert_never(resemblance)


def _stands_in(winner: StandsIn) -> str:
    begin = f"{_outside(winner.outside)}: {_named(winner.effects)} stands in for something else."
    if winner.beside:
        return f"{begin} Beside {_named(winner.beside)} its values would be plausible: {_quantities(winner.sizes)}."
    if winner.instead:
        nearly = f"{_named(winner.instead)} explains nearly as much at plausible values"
        return f"{begin} {nearly}: {_quantities(winner.sizes)}."
    return begin


def _outside(sizes: Sequence[Size]) -> str:
    return listed(
        [f"{amount_signed(one.parameter, one.value)} (plausible: {plausible_range(one.parameter)})" for one in sizes]
    )


def _quantity(size: Size) -> str:
    return quantity(size.parameter, size.value, size.error)


def _quantities(sizes: Sequence[Size]) -> str:
    return ", ".join(_quantity(size) for size in sizes)


def _named(effects: Sequence[str]) -> str:
    return " + ".join(effects)
