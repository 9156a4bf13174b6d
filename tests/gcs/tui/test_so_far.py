"""The fit of what was flown so far: one at a time, the newest state, by the command; and what is told of it."""

from __future__ import annotations

import threading
from dataclasses import replace
from pathlib import Path

import pytest
from fake_app import FLYING, IDLE
from flown_folder import fly_folder

from gcs.tui import so_far
from gcs.tui.so_far import FitsSoFar, SoFar
from gcs.tui.state import Mark, Stage, tells_both_axes
from gcs.tui.words import progress_line

FIRST = SoFar({"p": 76.6, "q": 72.2}, {"L_b": 124.3, "M_a": 557.5}, {"L_b": 1.9, "M_a": 8.0})
SECOND = SoFar({"p": 77.0, "q": 72.4}, {"L_b": 124.2, "M_a": 560.8}, {"L_b": 1.3, "M_a": 5.6})
WITHIN_S = 30.0


class Fits:
    """Answers in turn, each when it is let go."""

    def __init__(self, *answers: SoFar | None) -> None:
        self.answers = list(answers)
        self.go = threading.Semaphore(0)
        self.asked: list[Path] = []
        self.begun = threading.Semaphore(0)

    def __call__(self, flight: Path) -> SoFar | None:
        self.asked.append(flight)
        self.begun.release()
        assert self.go.acquire(timeout=WITHIN_S)
        return self.answers.pop(0)


class Said:
    """What was said, and how to wait for it."""

    def __init__(self) -> None:
        self.words: list[str] = []
        self.more = threading.Semaphore(0)

    def __call__(self, words: str) -> None:
        self.words.append(words)
        self.more.release()

    def next(self) -> str:
        assert self.more.acquire(timeout=WITHIN_S)
        return self.words[-1]


def test_what_moved_is_told_from_the_second_fit_on():
    assert FIRST.words(None) == "so far TPP p 77 q 72 %, L_b 124.3 ± 1.9, M_a 558 ± 8"
    assert SECOND.words(FIRST) == "so far TPP p 77 q 72 %, L_b 124.2 ± 1.3, M_a 561 ± 6, moved by 0.6 %"


def test_runs_that_end_while_a_fit_is_made_are_fitted_once_and_the_newest():
    fits, said = Fits(FIRST, SECOND), Said()
    one = FitsSoFar(said, fits)
    one.after(Path("flight-0001"))
    assert fits.begun.acquire(timeout=WITHIN_S)
    for _ in range(3):
        one.after(Path("flight-0001"))  # does not wait
    fits.go.release()
    assert said.next() == FIRST.words(None)
    fits.go.release()
    assert said.next() == SECOND.words(FIRST)
    assert len(fits.asked) == 2


def test_a_fit_that_fails_says_nothing_and_the_next_flight_begins_anew():
    fits, said = Fits(FIRST, None, SECOND), Said()
    one = FitsSoFar(said, fits)
    for _ in range(2):
        fits.go.release()
        one.after(Path("flight-0001"))
        assert fits.begun.acquire(timeout=WITHIN_S)
    assert said.next() == FIRST.words(None)
    one.forget()
    assert said.next() == ""
    fits.go.release()
    one.after(Path("flight-0002"))
    assert said.next() == SECOND.words(None)


@pytest.mark.parametrize("written", ["", "[]", "{}", '{"parameters": {"L_b": 3}}', "not JSON"])
def test_whatever_the_command_writes_the_flight_goes_on(tmp_path, monkeypatch, written):
    script = tmp_path / "gcs" / "cli.py"
    script.parent.mkdir()
    (script.parent / "__init__.py").touch()
    script.write_text(f"print({written!r})\n")
    monkeypatch.chdir(tmp_path)  # `python -m` looks here first
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    assert so_far._Command()(tmp_path) is None


@pytest.mark.thorough
def test_the_command_fits_a_folder(tmp_path):
    chirp = (0, 10, 0.1, 15.0), (0, 11, 0.15, 15.0)
    found = so_far._Command()(fly_folder(tmp_path / "flight-0001", None, chirp).path)
    assert found is not None
    assert found.values["M_a"] == pytest.approx(741, rel=0.3)
    assert set(found.nrmse_percent) == {"p", "q"}


def test_a_fit_is_made_once_both_axes_were_kept():
    runs = [replace(run, mark=Mark.WAITING) for run in IDLE.runs]
    labels = [run.label.rsplit(" ", 1)[0] for run in runs]
    chirps = {axis: labels.index(f"{axis} chirp") for axis in ("roll", "pitch")}
    assert not tells_both_axes(runs)
    runs[chirps["roll"]] = replace(runs[chirps["roll"]], mark=Mark.KEEP)
    assert not tells_both_axes(runs)
    runs[chirps["pitch"]] = replace(runs[chirps["pitch"]], mark=Mark.AGAIN)
    assert not tells_both_axes(runs)
    runs[chirps["pitch"]] = replace(runs[chirps["pitch"]], mark=Mark.KEEP)
    assert tells_both_axes(runs)


def test_it_stands_beside_the_next_run_and_not_over_one_that_flies():
    held = replace(IDLE, stage=Stage.HELD, current=3, so_far=SECOND.words(FIRST))
    line = progress_line(held, 120, "braille")
    assert "○ next: " in line
    assert line.endswith("moved by 0.6 %")
    assert len(progress_line(held, 80, "braille")) <= 80
    assert "so far" not in progress_line(replace(FLYING, so_far=held.so_far), 120, "braille")
