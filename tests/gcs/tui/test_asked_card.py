"""A card as the app takes it: its word, and options behind it."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from textual.app import App

from gcs.errors import UsageError
from gcs.tui.ask_from import AskFrom
from gcs.tui.asked_card import AskedCard, asked_card, offered_cards


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


def test_a_card_that_the_diagnosis_wrote_is_offered_before_those_that_come_along(tmp_path: Path) -> None:
    table = '[[maneuver]]\nkind = "chirp"\naxis = "roll"\namplitude = 0.1\nduration_s = 9\n'
    (tmp_path / "next.toml").write_text(f'name = "servo_lag or gyro_lag"\n{table}')
    (tmp_path / "next-2.toml").write_text("name = 3")
    os.utime(tmp_path / "next.toml", (1, 1))
    found = offered_cards(tmp_path, "--resume flight-0001")
    assert [word for word, _ in found[:3]] == [
        "--resume flight-0001",
        f"{tmp_path}/next-2.toml",
        f"{tmp_path}/next.toml",
    ]
    assert found[1][1].startswith("no card: ")
    assert found[2][1] == "written by the diagnosis: servo_lag or gyro_lag"
    assert "hover" in [word for word, _ in found]
    assert [word for word, _ in offered_cards(tmp_path / "gone")] == [word for word, _ in offered_cards(None)]


async def test_a_card_is_chosen_by_keys_typed_or_pressed() -> None:
    offers = [("hover", "the hover card"), ("quick [/]", "a short one")]
    taken: list[str | None] = []

    class Asking(App[None]):
        def on_mount(self) -> None:
            self.ask()

        def ask(self, value: str = "") -> None:
            self.push_screen(AskFrom("ascii", "Which card?", "a hint", value, offers), taken.append)

    app = Asking()
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.press("down", "down", "up", "down", "enter")
        app.ask("hover")
        await pilot.pause()
        await pilot.press("end", *" --leave-out", "enter")
        app.ask()
        await pilot.pause()
        await pilot.press("escape")
        app.ask()
        await pilot.pause()
        await pilot.click("#offers", offset=(4, 1))
        await pilot.pause()
        app.push_screen(AskFrom("ascii", "Which?", "", "", offers, several=True), taken.append)
        await pilot.pause()
        await pilot.press("down", "space", "down", "up", "down", "enter")
    assert taken == ["quick [/]", "hover --leave-out", None, "quick [/]", "hover quick [/]"]
