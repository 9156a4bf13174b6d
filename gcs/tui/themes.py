"""Colours: dark and light, and for the sun two of high contrast, black on white and white on black.

The hues are those of Okabe and Ito that eyes of every kind tell apart; all of them are far from the background, and
nothing is told by colour alone. NO_COLOR switches all of it off.
"""

from __future__ import annotations

from textual.theme import Theme

PLAIN = ("text-muted", "text-disabled", "panel-lighten-2", "scrollbar", "scrollbar-hover", "scrollbar-active")
BEHIND = ("scrollbar-background", "scrollbar-background-hover", "scrollbar-background-active")
"""What is black or white in the themes for the sun."""
DARK = Theme(
    "dark",
    primary="#56b4e9",
    secondary="#0072b2",
    accent="#f0e442",
    warning="#e69f00",
    error="#ff8c42",
    success="#5fd7af",
    foreground="#e4e4e4",
    background="#101418",
    surface="#1a2026",
    panel="#252d35",
    dark=True,
)
LIGHT = Theme(
    "light",
    primary="#005a8c",
    secondary="#0072b2",
    accent="#6a3d6a",
    warning="#8a4b00",
    error="#a03000",
    success="#00664a",
    foreground="#101010",
    background="#fbfaf6",
    surface="#f0eee6",
    panel="#e2dfd4",
    dark=False,
)
SUN = Theme(
    "sun",
    primary="#003c6e",
    secondary="#003c6e",
    accent="#000000",
    warning="#5a2d00",
    error="#6e1400",
    success="#003c2a",
    foreground="#000000",
    background="#ffffff",
    surface="#ffffff",
    panel="#ffffff",
    text_alpha=1.0,
    variables=dict.fromkeys(PLAIN, "#000000") | dict.fromkeys(BEHIND, "#ffffff"),
    dark=False,
)
"""Black on white: the most that a screen has against the sun."""
CONTRAST = Theme(
    "contrast",
    primary="#7fd0ff",
    secondary="#7fd0ff",
    accent="#ffffff",
    warning="#ffd75f",
    error="#ffb08a",
    success="#87ffd7",
    foreground="#ffffff",
    background="#000000",
    surface="#000000",
    panel="#000000",
    text_alpha=1.0,
    variables=dict.fromkeys(PLAIN, "#ffffff") | dict.fromkeys(BEHIND, "#000000"),
    dark=True,
)
THEMES = (DARK, LIGHT, SUN, CONTRAST)
NAMES = tuple(one.name for one in THEMES)


def after(name: str) -> str:
    """The theme that follows; the sun's comes first, for whoever presses the key outdoors."""
    order = ("dark", "sun", "contrast", "light")
    return order[(order.index(name) + 1) % len(order)] if name in order else order[0]


def contrast(one: tuple[int, ...], other: tuple[int, ...]) -> float:
    """Of two colours, red, green and blue from 0 to 255: 1 for the same, 21 for black on white (WCAG 2.2)."""
    high, low = sorted((_luminance(one), _luminance(other)), reverse=True)
    return (high + 0.05) / (low + 0.05)


def _luminance(colour: tuple[int, ...]) -> float:
    """Relative, 0 to 1."""
    linear = [x / 12.92 if x <= 0.04045 else ((x + 0.055) / 1.055) ** 2.4 for x in (part / 255 for part in colour)]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]
