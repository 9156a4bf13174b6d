"""Effects that could hide, how large, and the harm of leaving them out, in sentences."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

from gcs.analysis.quantities import quantity

if TYPE_CHECKING:
    from sysid.diagnose.hidden import CouldHide, Hidden
    from sysid.model.structure import Mode


def hidden_sentences(hiding: CouldHide) -> tuple[str, ...]:
    """A sentence for each harmful effect, and one for the rest."""
    sentences = [_sentence(group) for group in hiding.harmful]
    return (*sentences, _rest(hiding)) if hiding.others else tuple(sentences)


def up_to(hidden: Hidden) -> str:
    """`up to tau_s = 12 ms`, `down to limit = 0.3`."""
    way = "down" if any(math.isinf(one.null or 0.0) for one in hidden.sized) else "up"
    return f"{way} to " + ", ".join(quantity(one, hidden.size[one.name]) for one in hidden.sized)


def consequences(hidden: Hidden) -> str:
    """`M_a would be 16 % low, the delay margin would be 12 ms shorter`."""
    done = [f"{name} would be {_changed(change)}" for name, change in hidden.changed.items()]
    done += [f"the mode at {here.frequency_hz:.2f} Hz would {_moved(there)}" for here, there in hidden.moved_modes]
    if hidden.margins is not None and hidden.costs_margin:
        here, there = hidden.margins
        if there.delay_ms <= 0:
            done.append(f"gains designed on the fit ({here.words}) would not hold it")
        else:
            margins = f"{there.delay_ms:.0f} in place of {here.delay_ms:.0f} ms"
            done.append(f"the delay margin would be {hidden.delay_loss_ms:.0f} ms shorter ({margins})")
    seen = "" if hidden.visible else "; these runs show nothing of it, only what is plausible limits it"
    return f"{', '.join(done) or 'the fit would hardly change'}{seen}"


def _sentence(group: Sequence[Hidden]) -> str:
    first, *same = group
    also = f", or {_sizes(same)}" if same else ""
    return f"{first.title} ({first.effect}) {up_to(first)}{also} could hide here: {consequences(first)}"


def _rest(hiding: CouldHide) -> str:
    more = hiding.harmful_others
    if more:
        return f"could hide and do harm too: {_sizes([one for one, *_ in more])}"
    first = hiding.others[0][0]
    name, change = max(first.relative.items(), key=lambda item: abs(item[1]), default=("", 0.0))
    begin = "the others are harmless" if hiding.harmful else "nothing that could hide here would do harm"
    worst = f"{begin}: at worst {_sizes([first])}"
    if abs(change) >= first.harm - 1e-9:
        return f"{worst} leaves {name} {_changed(change)}"
    return f"{worst} makes the delay margin {first.delay_loss_ms:.1f} ms shorter"


def _sizes(each: Sequence[Hidden]) -> str:
    return ", ".join(f"{one.effect} {up_to(one)}" for one in each)


def _moved(there: Mode) -> str:
    return f"be at {there.frequency_hz:.2f} Hz" if there.pole.imag > 0 else "no longer oscillate"


def _changed(change: float) -> str:
    percent = "less than 1 %" if abs(change) < 0.01 else f"{100 * abs(change):.0f} %"
    return f"{percent} {'high' if change > 0 else 'low'}"
