"""Answers to a checklist, notes and readiness: refused or kept, in flight.json whole, and read again for the report."""

from __future__ import annotations

import threading
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import pytest
from fake_app import READINESS

from gcs.analysis.text.blocks import Sentence
from gcs.analysis.text.session import session_blocks
from gcs.cards.checklist import Question
from gcs.cards.maneuver import card_text, parse_card
from gcs.cli.checklist import typed_checklist
from gcs.errors import TippathError, UsageError
from gcs.flight.folder import FlightFolder
from gcs.flight.session_notes import SessionNote, told_session
from gcs.tui.logbook import Logbook
from gcs.tui.moment import Moment
from gcs.tui.state import Stage, State

NOW = datetime(2026, 11, 23, 10, 0, 0, tzinfo=UTC)
CARD = """
[[checklist]]
ask = "Blades tracked"
[[checklist]]
ask = "Wind"
answer = "number"
unit = "m/s"
most = 6
[[checklist]]
ask = "Pilot"
answer = "text"
[[maneuver]]
kind = "quiet"
duration_s = 5
"""


def book() -> tuple[Logbook, Moment]:
    moment = Moment(State(link="tcp:10.0.0.1:5760", stage=Stage.IDLE))
    made = Logbook(moment, lambda: NOW)
    made.ask(parse_card(CARD, "mine"))
    return made, moment


def test_a_card_s_checklist_is_read_and_written_again():
    card = parse_card(CARD, "mine")
    assert card.checklist[1] == Question(ask="Wind", kind="number", unit="m/s", most=6.0)
    assert parse_card(card_text(card), "again").checklist == card.checklist
    with pytest.raises(UsageError, match="checklist 1: unit, least and most are of a number"):
        parse_card(CARD.replace('"Blades tracked"', '"Blades tracked"\nunit = "m"'), "mine")
    with pytest.raises(UsageError, match="checklist 2: least, 7, lies above most, 6"):
        parse_card(CARD.replace("most = 6", "most = 6\nleast = 7"), "mine")


@pytest.mark.parametrize(
    ("number", "word", "value"),
    [(0, " Yes ", True), (0, "y", True), (1, "3,5", 3.5), (1, "4 m/s", 4.0), (2, " A.  Pilot ", "A. Pilot")],
)
def test_an_answer_is_of_the_kind_that_is_wanted(number, word, value):
    logbook, moment = book()
    logbook.answer(number, word)
    answer = moment.now.answers[number]
    assert answer is not None
    assert answer.value == value
    assert type(answer.value) is type(value)


@pytest.mark.parametrize(
    ("number", "word", "why"),
    [
        (0, "no", "not begun until it is yes"),
        (0, "perhaps", "yes or no is wanted"),
        (1, "strong", "a number in m/s, at most 6 is wanted, not strong"),
        (1, "nan", "is wanted, not nan"),
        (1, "7", "7 m/s is above 6"),
        (2, " ", "a few words are wanted"),
    ],
)
def test_an_answer_that_is_none_or_speaks_against_flying_is_refused_and_takes_the_one_before(number, word, why):
    logbook, moment = book()
    logbook.answer(number, ("yes", "3", "me")[number])
    with pytest.raises(TippathError, match=why):
        logbook.answer(number, word)
    assert moment.now.answers[number] is None
    assert moment.now.unanswered == 0 or number > 0


def test_answers_and_readiness_go_into_flight_json():
    logbook, moment = book()
    for number, word in enumerate(("yes", "3.5", "me")):
        logbook.answer(number, word)
    moment.set(readiness=READINESS)
    told = told_session(logbook.document())
    assert [(one.ask, one.answer, one.unit) for one in told.checklist] == [
        ("Blades tracked", True, ""),
        ("Wind", 3.5, "m/s"),
        ("Pilot", "me", ""),
    ]
    assert (told.ready, told.to_change) == (False, ("LOG_BACKEND_TYPE", "state"))
    logbook.ask(parse_card(CARD, "mine"))
    assert moment.now.unanswered == 0, "the next flight asks anew"
    moment.set(stage=Stage.HELD)
    with pytest.raises(TippathError, match="being flown"):
        logbook.answer(0, "yes")


def test_a_note_waits_for_its_flight_and_is_kept_while_the_flight_is_written(tmp_path: Path):
    logbook, moment = book()
    logbook.note(SessionNote(time=NOW, text="wind from the west"))
    assert logbook.waiting == ("wind from the west",)
    flight = FlightFolder(tmp_path)
    flight.write({"runs": [], "card": "mine"})
    moment.set(flight=tmp_path)
    logbook.begun(tmp_path)
    logbook.note(SessionNote(time=NOW, text="gust", air_s=75.04, run="roll chirp", run_s=4.0))
    assert logbook.waiting == ()
    stop = threading.Event()

    def flies() -> None:
        old = {"runs": [{"n": n} for n in range(9)], "notes": [], "name": "older"}
        while not stop.is_set():
            flight.write(old)

    flying = threading.Thread(target=flies)
    flying.start()
    for number in range(8):
        logbook.note(SessionNote(time=NOW, text=f"note {number}"))
    stop.set()
    flying.join()
    told = told_session(flight.read())
    assert [note.text for note in told.notes] == ["wind from the west", "gust", *(f"note {n}" for n in range(8))]
    assert (told.notes[1].air_s, told.notes[1].run, told.notes[1].run_s) == (75.0, "roll chirp", 4.0)
    assert len(flight.runs()) == 9
    assert flight.notes()[1] == ("2026-11-23T10:00:00.000+00:00", "gust")


def test_the_report_s_blocks_say_all_of_it_and_nothing_hostile():
    logbook, _ = book()
    logbook.answer(1, "3.5")
    told = told_session(
        logbook.document()
        | {
            "notes": [
                {"time": "2026-11-23T10:00:00.000+00:00", "text": "gu\x1bst", "air_s": 75, "run": "roll", "run_s": 4}
            ]
        }
    )
    told = replace(told, ready=False, to_change=("LOG_BACKEND_TYPE",))
    text = " | ".join(
        line.text if isinstance(line, Sentence) else line for one in session_blocks(told) for line in one.lines
    )
    assert text == (
        "checklist | Wind: 3.5 m/s | readiness: to be changed on the vehicle: LOG_BACKEND_TYPE | "
        "notes | 2026-11-23 10:00:00, 1:15 in the air, 4 s into roll: gu?st"
    )
    assert session_blocks(told_session({"notes": "none", "checklist": [3], "readiness": 1})) == ()


def test_a_shell_asks_on_a_terminal_and_says_where_nobody_is_asked(monkeypatch, capsys):
    card = parse_card(CARD, "mine")
    assert [one["answer"] for one in typed_checklist(card)["checklist"]] == [None, None, None]
    assert "is not asked" in capsys.readouterr().err
    words = iter(("yes", "3", "me"))
    monkeypatch.setattr("sys.stdin.isatty", lambda: True, raising=False)
    monkeypatch.setattr("builtins.input", lambda: next(words))
    assert [one["answer"] for one in typed_checklist(card)["checklist"]] == [True, 3.0, "me"]
    monkeypatch.setattr("builtins.input", lambda: "no")
    with pytest.raises(TippathError, match="not begun until it is yes"):
        typed_checklist(card)
    assert typed_checklist(replace(card, checklist=())) == {}
