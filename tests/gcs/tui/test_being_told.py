"""What newcomers stumbled over is told: a key that came too early, a typo, what can be judged, where commands reach."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest
from fake_app import IDLE, VEHICLE, app_on, screen_text, settle
from fake_desk import CLEARED, DESKS, GAINS, MODEL, PRESENT
from textual.widgets import Input

from gcs.analysis.standing import NOT_ASKED
from gcs.errors import UsageError
from gcs.tui import gains_words
from gcs.tui.connections import simulated
from gcs.tui.moment import Moment
from gcs.tui.next_step import next_words
from gcs.tui.reconnect import begun_in_a_shell
from gcs.tui.state import Bank, Mark, RunView, State, joined
from gcs.tui.vehicle_link import SHELL_LINK, VehicleLink
from gcs.tui.words import progress_line, screens_line
from sysid.control.judgement import Limits, judge
from sysid.control.regulator import design

LQR = Bank(PRESENT.crc, None, True)
DOUBLETS = tuple(
    RunView(number=k, label=f"{axis} doublet", numbers="", kind="doublet", mark=Mark.KEEP)
    for k, axis in enumerate(("roll", "pitch"), 1)
)
FEW: Any = SimpleNamespace(proof=SimpleNamespace(verdict="too few to say", runs=()))


async def test_a_typo_leaves_the_box_open_with_what_is_wrong(monkeypatch):
    app, engine = app_on(replace(IDLE, bank=LQR))

    def choose(word: str) -> None:
        engine.asked.append(word)
        if word != "proof":
            raise UsageError(f"{word}: no such card; {'one of these, ' * 15}")

    monkeypatch.setattr(engine, "choose_card", choose)
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.press("c")
        assert app.screen.query_one(Input).value == "proof", "under the LQR the card that can be judged"
        await pilot.press("end", "x", "enter")
        await app.workers.wait_for_complete()
        await settle(app)
        assert "proofx: no such card" in "\n".join(screen_text(app))
        assert screen_text(app)[0].rstrip().endswith("F12 ABORT"), "a long answer leaves the line above as it is"
        await pilot.press("end", "backspace", "enter")
        await app.workers.wait_for_complete()
        assert engine.asked == ["proofx", "proof"]
        await pilot.press("3", "o", *"nowhere", "enter")
        await settle(app)
        assert "nowhere: no such folder or log" in "\n".join(screen_text(app))
        await pilot.press("escape", "question_mark", "escape")
        assert app.current_mode == "runs", "help goes back to where it was asked for"


def test_after_an_lqr_flight_its_proof_is_next_and_two_runs_are_too_few():
    desk = replace(DESKS["open"], present=PRESENT)
    state = joined(replace(IDLE, card="lqr-doublet", runs=DOUBLETS, flight=desk.path), desk)
    assert next_words(state, "Fly").startswith("8, then F")
    assert (
        next_words(replace(state, vehicle=replace(VEHICLE, armed=False)), "Fly") == "8, then F: flown against predicted"
    )
    assert "8" not in next_words(replace(state, card="quick"), "Fly")
    judged = joined(state, replace(desk, proof=FEW, ladder=()))
    assert "card proof" in next_words(judged, "Controller")


async def test_a_proof_has_room_for_all_its_rows(monkeypatch):
    told = [" row 1", *(f" row {k}" for k in range(2, 15))]
    monkeypatch.setattr(gains_words, "proof_said", lambda _: told)
    monkeypatch.setattr("gcs.tui.controller.flown", lambda *_: gains_words_plot())
    app, _ = app_on(joined(IDLE, replace(DESKS["designed"], proof=FEW)))
    async with app.run_test(size=(120, 40)) as pilot:
        await pilot.press("8")
        await settle(app)
        text = "\n".join(screen_text(app))
        assert all(row.strip() in text for row in told)


def gains_words_plot() -> Any:
    from gcs.tui.draw_gains import answers

    return answers(gains_words.columns(joined(IDLE, DESKS["designed"])), 0)


def test_gains_of_a_model_that_nobody_asked_do_not_hold_without_a_word():
    lax = judge(design(MODEL), [("fit", MODEL)], Limits(overshoot=9.0, coupling=9.0, peak_db=99.0))
    asked = replace(GAINS, clearance=replace(CLEARED, judgement=lax))
    unasked = replace(asked, clearance=replace(asked.clearance, standing=NOT_ASKED))
    for designed, words in ((asked, "✓ holds"), (unasked, "! if complete")):
        state = joined(IDLE, replace(DESKS["open"], designed=designed))
        assert any(words in str(line) for line in gains_words.controller_lines(state, 80)), words


@pytest.mark.parametrize(("seed", "words"), [(None, ""), (7, " --seed 7")])
def test_commands_of_a_simulated_vehicle_begin_one_that_a_shell_can_reach(seed, words):
    begun = begun_in_a_shell(simulated("hover", seed=seed))
    assert begun == f"tippath sim --plant hover{words} &"
    moment = Moment(State(link=""))
    link = VehicleLink(moment, None, None, open_session=lambda: None, primary=True, begun_by=begun)  # type: ignore[arg-type]
    for what in ("sweep", "push"):
        link.did(f"tippath {what} --connect {link.shell_words}")
    assert moment.now.commands == (
        begun,
        f"tippath sweep --connect {SHELL_LINK}",
        f"tippath push --connect {SHELL_LINK}",
    )


def test_words_are_whole_or_not_there_and_what_is_over_is_not_said():
    line = screens_line(replace(IDLE, plant="hover-ideal"), "Fly", 120).plain
    assert line.rstrip().endswith(" SIMULATED")
    assert screens_line(replace(IDLE, plant="hover-ideal"), "Fly", 200).plain.rstrip().endswith("hover-ideal")
    told = replace(IDLE, so_far="so far p 84 q 74")
    assert "so far" in progress_line(told, 120, "braille")
    assert "so far" not in progress_line(joined(told, DESKS["compared"]), 120, "braille")
