"""Effects that could hide, at the largest size that these runs would not show, and the harm of leaving them out."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from sysid.control.stability import Margins
from sysid.diagnose.quantities import quantity
from sysid.fit.result import finite
from sysid.model.parameter import Parameter
from sysid.model.structure import FloatArray, Mode

HARM = 0.1
"""Relative change of a watched parameter, or of the delay margin, that matters for gains."""
MOST = 5
ALIKE = 0.1
"""Relative difference of what two effects do to a fit, below which they are told together."""


@dataclass(frozen=True, kw_only=True)
class Hidden:
    """One effect at the largest size that could hide."""

    effect: str
    title: str
    size: Mapping[str, float]
    """Parameter -> value; those that mean nothing at the null as typical."""
    sized: tuple[Parameter, ...]
    """Parameters that have a null, and with it a size; the largest of them."""
    visible: bool
    """False where these runs show nothing of it that the structure could not do itself: only plausibility limits it."""
    shift: Mapping[str, float]
    """Fitted parameter -> what leaving the effect out adds to it, in its unit."""
    relative: Mapping[str, float]
    """Watched parameter -> the same over the fitted value."""
    modes: tuple[tuple[Mode, Mode], ...]
    """Each of the fit's modes, and that of the vehicle with the effect."""
    margins: tuple[Margins, Margins] | None
    """Of the gains designed on the fit: on the fit, and on the vehicle with the effect."""

    @property
    def delay_loss_ms(self) -> float:
        """Of the delay margin; 0 where there are no gains, or where any delay could be held."""
        if self.margins is None or not math.isfinite(self.margins[0].delay_ms):
            return 0.0
        return self.margins[0].delay_ms - self.margins[1].delay_ms

    @property
    def delay_loss(self) -> float:
        """The same as a share of the delay margin; 1 where the vehicle is not held."""
        if self.margins is None:
            return 0.0
        here, there = (one.delay_ms for one in self.margins)
        return 1.0 if there <= 0 else self.delay_loss_ms / here

    @property
    def harm(self) -> float:
        """The largest relative change of a watched parameter, or loss of delay margin."""
        return float(max([*np.abs(self.done[:-1]), self.done[-1]]))

    @property
    def up_to(self) -> str:
        """`up to tau_s = 12 ms`, `down to limit = 0.3`."""
        way = "down" if any(math.isinf(one.null or 0.0) for one in self.sized) else "up"
        return f"{way} to " + ", ".join(quantity(one, self.size[one.name]) for one in self.sized)

    @property
    def done(self) -> FloatArray:
        """What leaving it out does, as relative changes: watched parameters, delay margin."""
        return np.array([*self.relative.values(), self.delay_loss])

    @property
    def consequences(self) -> str:
        """`M_a would be 16 % low, the delay margin would be 12 ms shorter`."""
        done = [
            f"{name} would be {100 * abs(x):.0f} % {'high' if x > 0 else 'low'}"
            for name, x in sorted(self.relative.items(), key=lambda item: -abs(item[1]))
            if abs(x) >= max(0.01, 0.3 * HARM)
        ]
        done += [
            f"the mode at {here.frequency_hz:.2f} Hz would be at {there.frequency_hz:.2f} Hz"
            for here, there in self.modes
            if abs(there.frequency_hz / here.frequency_hz - 1) >= HARM
        ]
        if self.margins is not None and self.delay_loss >= 0.3 * HARM:
            here, there = self.margins
            if there.delay_ms <= 0:
                done.append(f"gains designed on the fit ({here.words}) would not hold it")
            else:
                done.append(
                    f"the delay margin would be {self.delay_loss_ms:.0f} ms shorter "
                    f"({there.delay_ms:.0f} in place of {here.delay_ms:.0f} ms)"
                )
        seen = "" if self.visible else "; these runs show nothing of it, only what is plausible limits it"
        return f"{', '.join(done) or 'the fit would hardly change'}{seen}"

    def to_json(self) -> dict[str, Any]:
        return {
            "effect": self.effect,
            "size": {name: finite(value) for name, value in self.size.items()},
            "visible": self.visible,
            "shift": dict(self.shift),
            "relative": dict(self.relative),
            "margins": None
            if self.margins is None
            else [
                {"gain_db": finite(one.gain_db), "phase_deg": finite(one.phase_deg), "delay_ms": finite(one.delay_ms)}
                for one in self.margins
            ],
            "consequences": self.consequences,
        }


@dataclass(frozen=True)
class CouldHide:
    """All that could hide. Effects that do the same to the fit stand together: nobody need tell them apart."""

    harmful: tuple[tuple[Hidden, ...], ...]
    """The worst first, at most MOST; of each the worst of its kind first."""
    others: tuple[tuple[Hidden, ...], ...]
    """The rest, the worst first."""

    @property
    def sentences(self) -> tuple[str, ...]:
        said = [_sentence(group) for group in self.harmful]
        if self.others:
            said.append(self._rest())
        return tuple(said)

    def _rest(self) -> str:
        more = [group for group in self.others if group[0].harm >= HARM]
        if more:
            return f"could hide and do harm too: {', '.join(f'{one.effect} {one.up_to}' for one, *_ in more)}"
        first = self.others[0][0]
        name, change = max(first.relative.items(), key=lambda item: abs(item[1]), default=("", 0.0))
        begin = "the others are harmless" if self.harmful else "nothing that could hide here would do harm"
        said = f"{begin}: at worst {first.effect} {first.up_to}"
        if abs(change) >= first.harm - 1e-9:
            percent = "less than 1 %" if abs(change) < 0.01 else f"{100 * abs(change):.0f} %"
            return f"{said} leaves {name} {percent} {'high' if change > 0 else 'low'}"
        return f"{said} makes the delay margin {first.delay_loss_ms:.1f} ms shorter"

    def to_json(self) -> list[str]:
        """The contract's `could_hide`."""
        return list(self.sentences)


def _sentence(group: Sequence[Hidden]) -> str:
    first, *same = group
    also = f", or {', '.join(f'{one.effect} {one.up_to}' for one in same)}" if same else ""
    return f"{first.title} ({first.effect}) {first.up_to}{also} could hide here: {first.consequences}"


def grouped(found: Sequence[Hidden]) -> list[tuple[Hidden, ...]]:
    """The worst first; effects that do the same together."""
    groups: list[list[Hidden]] = []
    for one in sorted(found, key=lambda each: -each.harm):
        for group in groups:
            first = group[0]
            if np.max(np.abs(one.done - first.done)) <= ALIKE * first.harm:
                group.append(one)
                break
        else:
            groups.append([one])
    return [tuple(group) for group in groups]
