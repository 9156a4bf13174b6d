"""Sliders for what gains are designed with: a row each, moved by keys or pressed where they shall stand."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from textual.content import Content

from gcs.desk.state import Weights
from gcs.tui.plot import Style
from gcs.tui.pressing import pressed
from gcs.tui.words import fitted

TRACK = 40
"""Columns that all take, the longest's."""


@dataclass(frozen=True, slots=True)
class Slider:
    """One of the weights, with the places where it can stand."""

    name: str
    field: str
    values: tuple[float, ...]
    words: tuple[str, str]
    """What less and more of it does."""

    def place(self, weights: Weights) -> int:
        """Where it stands, or the nearest place to it."""
        value = float(getattr(weights, self.field))
        return min(range(len(self.values)), key=lambda k: (abs(self.values[k] - value), k))

    def at(self, weights: Weights, place: int) -> Weights:
        """The weights with this slider elsewhere."""
        value = self.values[max(0, min(place, len(self.values) - 1))]
        changes: dict[str, Any] = {self.field: bool(value) if self.field == "dynamic" else value}
        return replace(weights, **changes)

    def moved(self, weights: Weights, steps: int) -> Weights:
        """By so many places; one that was typed goes to the next place first."""
        return self.at(weights, self.place(weights) + steps)


def _decades(first: int, last: int, steps: Sequence[float]) -> tuple[float, ...]:
    return tuple(float(f"{step * 10.0**power:.3g}") for power in range(first, last) for step in steps)


SLIDERS = (
    Slider("input cost", "input_cost", _decades(-1, 4, (1, 1.5, 2, 3, 4, 5, 6, 8)), ("faster", "gentler")),
    Slider("flapping", "flapping_cost", _decades(-5, 2, (1, 2, 5)), ("disc free", "disc quiet")),
    Slider(
        "observer",
        "observer",
        (0.0, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0, 1.25, 1.5, 2.0, 2.5, 3.0),
        ("Kalman, slower", "faster"),
    ),
    Slider("prefilter", "dynamic", (0.0, 1.0), ("steady", "dynamic")),
)


def value_words(slider: Slider, weights: Weights) -> str:
    """Where it stands."""
    if slider.field == "dynamic":
        return "dynamic" if weights.dynamic else "steady"
    if slider.field == "observer":
        return "Kalman filter" if not weights.observer else f"{weights.observer:g} x the paper's"
    value, usual = getattr(weights, slider.field), getattr(Weights(), slider.field)
    return f"{value:g}" + (" (the paper's)" if value == usual else "")


def slider_lines(weights: Weights, at: int, width: int, style: Style) -> list[Content]:
    """A row for each; `at` is the one that left and right move."""
    return [_row(number, slider, weights, number == at, width, style) for number, slider in enumerate(SLIDERS)]


def _row(number: int, slider: Slider, weights: Weights, marked: bool, width: int, style: Style) -> Content:
    line, knob = ("-", "O") if style == "ascii" else ("─", "●")
    here = slider.place(weights)
    look = "bold" if marked else ""
    columns = len(slider.values) if len(slider.values) > 2 else 4
    track = []
    for column in range(columns):
        place = column if len(slider.values) > 2 else column * len(slider.values) // columns
        stands = place == here and (column == here or len(slider.values) <= 2)
        shown = knob if stands else line
        track.append(pressed(shown, f"screen.put({number}, {place})", "bold reverse" if stands and marked else look))
    head = f" {'▶' if marked else ' '} {slider.name:<11}"
    less, more = slider.words
    told, pad = value_words(slider, weights), " " * (TRACK - columns)
    if width >= 110:
        told = f"{told:<20} {less} < > {more}"
    return Content.assemble(
        pressed(head, f"screen.choose({number})", look),
        pressed(" < ", f"screen.slide({number}, -1)", look),
        *track,
        pressed(" > ", f"screen.slide({number}, 1)", look),
        (fitted(f"{pad} {told}", max(1, width - len(head) - 6 - columns)), look),
    )
