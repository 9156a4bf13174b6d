"""What was hidden on one blind flight beside what was said of it."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

VISIBLE_POINTS = 2.0
"""NRMSE that an effect costs, from which on it must be found."""
LARGEST_CLASS = 3
RESEMBLES = 0.25
"""Relative, of a value at which an entry is something that the catalogue does not have by itself;"""
WITHIN = 2.0
"""or so many of its standard errors, where a flight tells it no better."""
TABLE_4 = {"L_b": 147.548, "M_a": 713.378, "tau_f": 0.091}
MOTORS = ("L_lat", "M_lon")
"""What a quadrotor has in their place."""
TABLE_5 = {"L_b": 147.550, "M_a": 713.380, "tau_f": 0.075}
TIED = ("attitude_stiffness",)
"""What physics allows in no free flight: it stands in, "unexplained", and is said to be the answer on a tether."""
SURE = 0.9
LITTLE_POINTS, LITTLE_HARM = 0.5, 0.05
"""NRMSE that a hidden effect costs, and relative error of the base's numbers that it makes, up to which it matters
little: tighter than what margins that count as sensible bear."""


@dataclass(frozen=True)
class Flight:
    """One line of the study."""

    said: dict[str, Any]

    @property
    def failed(self) -> str | None:
        return self.said.get("failed")

    @property
    def hidden(self) -> list[dict[str, Any]]:
        found = self.said["hidden"]
        return found if isinstance(found, list) else [found]

    @property
    def name(self) -> str:
        return "+".join(self.said["case"]["names"])

    @property
    def level(self) -> str:
        return "two" if len(self.hidden) == 2 else str(self.hidden[0]["level"])

    @property
    def answers(self) -> list[set[str]]:
        """For each hidden effect the ids that are right."""
        return [{one["answer"], *one["accepts"]} - {None} for one in self.hidden]

    @property
    def cost_points(self) -> float:
        """NRMSE of the noise floor less the fit's, the larger of both axes."""
        floor, fit = self.said["noise_floor_percent"], self.said["nrmse_percent"]
        return max(floor[axis] - fit[axis] for axis in fit)

    @property
    def strange(self) -> bool:
        """Whether vehicle and flight were drawn by `strangers`."""
        return "flight" in self.said

    @property
    def excitation_logged(self) -> bool:
        return not self.strange or bool(self.said["flight"]["excitation_logged"])

    @property
    def shown(self) -> float:
        """How much the flight shows that is no noise: less the power of ten of the chance."""
        told = self.said["log10_chance"]
        return math.inf if told is None else -float(told)

    @property
    def loop_known(self) -> bool:
        """Whether the log tells how long commands were held: by itself, or having every sample of the loop."""
        flight = self.said.get("flight")
        return flight is None or bool(flight["loop_told"]) or flight["log_hz"] == flight["loop_hz"]

    @property
    def samples(self) -> int | None:
        """Of all its runs; None where that was not kept."""
        return self.said.get("flight", {}).get("samples")

    @property
    def detectability(self) -> float | None:
        """Times what is just detectable, by the truth; known of strangers alone, and None where nothing is hidden."""
        told = self.said.get("detectability")
        return None if told is None else float(told)

    @property
    def visible(self) -> bool:
        """Whether it must be found."""
        if self.strange:
            return self.detectability is not None and self.detectability >= 1.0
        return self.cost_points >= VISIBLE_POINTS

    @property
    def alarm(self) -> bool:
        """Something is said to be missing; what only the loop may have made is none, nor are thinned commands where
        they are."""
        excused = self.said.get("reason") == "feedback" or (bool(self.said.get("clocks")) and not self.loop_known)
        return self.said["verdict"] != "complete" and not excused

    @property
    def answer_right(self) -> bool:
        """Whether the verdict is what it should be: `complete` of what no flight of this kind could show as well, or of
        what matters little; `unexplained` of a tether that stands in for itself, too."""
        if self.said["verdict"] == "complete":
            return self.level == "none" or not self.visible or self.spared
        tether = self.said["stands_in"] and self.said["effect"] in TIED
        if (self.said["verdict"] == "missing" or tether) and self.level != "beyond":
            return self.level != "none" and self.right_in_class
        return self.level == "beyond" and self.right

    @property
    def explainable(self) -> float:
        """Over noise, as the fits found it."""
        return (self.said["E0"] - self.said["N"]) / max(self.said["N"], 1e-12)

    @property
    def harm(self) -> float:
        """Largest relative error of L_b, M_a, tau_f in the fit without the effect."""
        truth = TABLE_5 if self.said["case"]["plant"] == "forward" else TABLE_4
        if self.strange:
            table = self.said["flight"]["table"]
            truth = {name: table[name] for name in (*TABLE_4, *MOTORS) if name in table}
        found = self.said.get("parent", {})
        return max((abs(found[name] / value - 1) for name, value in truth.items() if name in found), default=0.0)

    @property
    def spared(self) -> bool:
        """Whether what is hidden was called nothing that matters, and by the truth matters little."""
        little = self.cost_points <= LITTLE_POINTS and self.harm <= LITTLE_HARM
        return bool(self.said["verdict"] == "complete") and little

    @property
    def unweighed(self) -> Flight:
        """As all that shows is told, whether it matters or not."""
        return Flight(self.said | (self.said.get("unweighed") or {}))

    @property
    def right(self) -> bool:
        """The first answer, or the verdict where there is none to name."""
        if self.level == "none":
            return bool(self.said["verdict"] == "complete")
        if self.level == "beyond":
            return bool(self.said["verdict"] == "unexplained") or self._named_as_it_resembles
        return bool(self._as_good(self.said["effect"]) & self.answers[0])

    def _as_good(self, effect: str) -> set[str]:
        """An entry, and those that predict the same on the flight: one answer, however it is called."""
        return {effect, *self.said.get("equivalent", {}).get(effect, ())}

    @property
    def _named_as_it_resembles(self) -> bool:
        """Not in the catalogue, but what an entry is at certain values, and found at those."""
        wanted = self.hidden[0].get("resembles", {}).get(self.said["effect"])
        found = next((one for one in self.said["candidates"] if one["effect"] == self.said["effect"]), None)
        if not wanted or found is None:
            return False
        values, errors = found["parameters"], found["standard_errors"]
        return all(
            values.get(name) is not None
            and abs(values[name] - value) < max(RESEMBLES * abs(value), WITHIN * (errors.get(name) or 0.0))
            for name, value in wanted.items()
        )

    @property
    def right_in_class(self) -> bool:
        """Right, or among at most three that it says cannot be told apart."""
        alike = {self.said["effect"], *self.said["indistinguishable"]}
        every = set().union(*map(self._as_good, alike))
        size = len(alike) + len(self.said.get("indistinguishable_pairs", ()))
        return self.right or (size <= LARGEST_CLASS and bool(every & self.answers[0]))

    @property
    def in_first_two(self) -> bool:
        first = [one["effect"] for one in self.said["candidates"][:2]]
        return self.right_in_class or bool(set(first) & self.answers[0])

    @property
    def both_found(self) -> bool:
        """Two hidden: named in the first answer's chain, or when asked again with it added; or a pair that the runs do
        not tell from the one which is named."""
        told: set[str] = set()
        for said in (self.said, self.said.get("second") or {}):
            named = {said.get("effect"), *said.get("chain", ()), *said.get("indistinguishable", ())} - {None}
            told |= named.union(*(said.get("equivalent", {}).get(name, ()) for name in named))
        instead = (set(pair) for pair in self.said.get("indistinguishable_pairs", ()))
        return any(all(answers & one for answers in self.answers) for one in (told, *instead))

    def sizes_off(self) -> list[float]:
        """(estimate - truth)/standard error of the true entry's parameters, where the truth is known."""
        hidden = self.hidden[0]
        truth = {**hidden["expect"], **(hidden["sizes"] if hidden["level"] == "catalogue" else {})}
        for one in self.said["candidates"]:
            if one["effect"] == hidden["answer"]:
                errors = one["standard_errors"]
                return [
                    (one["parameters"][name] - value) / errors[name]
                    for name, value in truth.items()
                    if errors.get(name) and one["parameters"].get(name) is not None
                ]
        return []

    def base_off(self) -> dict[str, float]:
        """(estimate - truth)/standard error of the base's numbers, where nothing at all was hidden: by `tippath fit`,
        or as the diagnosis begins with them (before the eleventh judgement)."""
        if not self.strange or self.name != "none":
            return {}
        of = "fit" if "fit" in self.said else "parent"
        truth, errors = self.said["flight"]["table"], self.said.get(f"{of}_errors", {})
        return {name: (self.said[of][name] - truth[name]) / errors[name] for name in errors if name in truth}

    def short_of_best(self) -> float | None:
        """Validation NRMSE of the winner below the best of all refits, in points, the worse axis."""
        fits = [one for one in (*self.said["candidates"], *self.said["pairs"]) if one["validation_nrmse_percent"]]
        chain = set(self.said["chain"])
        mine = [one for one in fits if set(one["effect"].split("+")) == chain]
        if not mine:
            return None
        own = mine[0]["validation_nrmse_percent"]
        return max(max(one["validation_nrmse_percent"][axis] for one in fits) - own[axis] for axis in own)


def load(paths: Iterable[Path]) -> list[Flight]:
    """All flights of all files, each once: of one that was flown twice the later. A line that was cut off is none."""
    flights: dict[str, Flight] = {}
    for path in paths:
        for number, line in enumerate(path.read_text(encoding="utf-8").splitlines()):
            try:
                said = json.loads(line)
            except json.JSONDecodeError:
                continue
            flights[said.get("key") or f"{path} {number}"] = Flight(said)
    return list(flights.values())
