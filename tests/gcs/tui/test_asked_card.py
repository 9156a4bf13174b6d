"""A card as the app takes it: its word, and options behind it."""

from __future__ import annotations

import pytest

from gcs.errors import UsageError
from gcs.tui.asked_card import AskedCard, asked_card


@pytest.mark.parametrize(
    ("text", "asked"),
    [
        ("", AskedCard()),
        ("hover", AskedCard("hover")),
        ("hover --leave-out", AskedCard("hover", leave_out=True)),
        ("'my card.toml' --log card", AskedCard("my card.toml", log="card")),
        ("--log card --leave-out", AskedCard(log="card", leave_out=True)),
        ("quick --log stream", AskedCard("quick")),
        ("--resume 'my flight'", AskedCard(resume="my flight")),
    ],
)
def test_options_stand_behind_the_card(text: str, asked: AskedCard) -> None:
    assert asked_card(text) == asked
    assert asked_card(asked.options.removeprefix("--card ")) == asked


@pytest.mark.parametrize(
    "text",
    [
        "hover --log",
        "--resume",
        "hover --resume here",
        "--resume here --leave-out",
        "hover --log tape",
        "hover quick",
        "hover --yes",
        "'hover",
    ],
)
def test_what_is_not_known_is_refused(text: str) -> None:
    with pytest.raises(UsageError, match="a card, and behind it, where wanted, --leave-out and --log card"):
        asked_card(text)
