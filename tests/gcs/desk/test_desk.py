"""The desk, headless: from a flight to gains and a report, each step as its command does it; nothing lost, nothing
half written. The vehicle hides a servo's lag of 22 ms."""

from __future__ import annotations

import contextlib
import io
import json
import shlex
import shutil
import threading
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from flown_folder import fly_folder
from flying import CHIRP, ELEVATOR, LAG, LAG_CARD, PITCH, QUIET, ROLL, TWO_CHIRPS
from matplotlib.figure import Figure

import gcs.desk.keeping
from gcs.analysis.answer import answer_of, kept_answer
from gcs.analysis.clearance import clearance
from gcs.analysis.text.blocks import text_of
from gcs.desk import Base, Cancelled, Choice, Desk, tuning
from gcs.desk.state import Weights
from gcs.errors import TippathError, UsageError
from gcs.flight.folder import FlightFolder
from gcs.logs import resolve_runs
from gcs.tui.next_step import chosen_anew
from sysid.diagnose.progress import Asking, Heard, Known, Listener, Stage
from sysid.fit.result import Fit

pytestmark = pytest.mark.usefixtures("answers_kept")
WHEN = datetime(2026, 5, 4, 12, 30, tzinfo=UTC)

DRAG = '''"""Drag of a long tail."""

from sysid.model.effect import Effect, Stage
from sysid.model.parameter import Parameter

EFFECT = Effect(
    id="tail_drag", title="drag of the tail", group="user", equation="q_dot += M_tail q", source="a plate",
    signature="pitch motions decay faster",
    parameters=(Parameter("M_tail", "1/s", "pitch acceleration per rate", null=0.0, typical=-2.0),),
    stage=Stage.DYNAMICS, equations=lambda s: {"q_dot": s.M_tail * s.q},
)
'''


def typed(*words: str) -> str:
    """What a command that succeeds prints."""
    from gcs.cli import main

    out = io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(io.StringIO()):
        assert main([*words]) == 0, words
    return out.getvalue()


def repeat(commands: Sequence[str]) -> None:
    """Type them."""
    for command in commands:
        words, _, target = command.partition(" > ")
        printed = typed(*shlex.split(words)[1:])
        if target:
            Path(*shlex.split(target)).write_text(printed)


def ask(desk: Desk) -> None:
    """From runs to gains."""
    desk.fit()
    desk.compare()
    desk.diagnose()
    desk.add("servo_lag")
    desk.compare()
    desk.diagnose()
    desk.design()


@pytest.fixture(scope="module")
def raw(answers_kept: None, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A flight folder that nobody has opened; its second run is to be flown again."""
    return fly_folder(tmp_path_factory.mktemp("raw") / "flight-0001", LAG, LAG_CARD, again=2).path


@pytest.fixture(scope="module")
def worked(
    raw: Path, answers_kept: None, few_effects_in_module: Path, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[tuple[Desk, Path]]:
    """The whole way to the gains, in a folder of its own; the commands name paths from there."""
    home = tmp_path_factory.mktemp("worked")
    shutil.copytree(raw, home / "flight-0001")
    with contextlib.chdir(home):
        desk = Desk(now=lambda: WHEN)
        desk.open("flight-0001")
        desk.use("flight.BIN#2", Choice.FIT)
        ask(desk)
        yield desk, home


@pytest.fixture(scope="module")
def two_chirps(answers_kept: None, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two chirps, no validation; nobody touches it."""
    return fly_folder(tmp_path_factory.mktemp("short") / "flight-0002", None, TWO_CHIRPS).path


@pytest.fixture
def short(two_chirps: Path, tmp_path: Path) -> Path:
    """Two chirps, no validation, in a folder of the test's own."""
    return shutil.copytree(two_chirps, tmp_path / two_chirps.name)


# ------------------------------------------------------------------------------------------------ runs


def test_a_roll_log_and_a_pitch_log_are_opened_and_fitted_together(tmp_path: Path) -> None:
    names = [str(fly_folder(tmp_path / f"flight-{at}", None, (TWO_CHIRPS[at],)).path) for at in (0, 1)]
    desk = Desk(now=lambda: WHEN)
    desk.open(*names)
    rows = desk.state().runs
    assert [(row.id, row.axis, row.choice) for row in rows] == [
        ("flight-0/flight.BIN#1", "roll", Choice.FIT),
        ("flight-1/flight.BIN#1", "pitch", Choice.FIT),
    ]
    assert [row.verdict for row in rows] == ["keep", "keep"]
    assert desk.state().opened == "flight-0 + flight-1"
    with pytest.raises(TippathError, match="alike"):
        desk.use_alike()
    desk.fit()
    assert not chosen_anew(desk.state())
    fit = desk.state().ladder[0].fit
    assert [Path(one.path).parent.name for one in fit.records] == ["flight-0", "flight-1"]
    assert (tmp_path / "flight-0" / "tpp.json").is_file()
    assert desk.state().commands[0] == f"tippath ingest {names[0]} {names[1]}"
    again = Desk(now=lambda: WHEN)
    again.open(*names)
    (rung,) = again.state().ladder
    assert [one.sha256 for one in rung.fit.records] == [one.sha256 for one in fit.records]
    assert not chosen_anew(again.state())


def test_runs_are_used_as_their_kind_says(raw: Path) -> None:
    desk = Desk()
    desk.open(str(raw))
    state = desk.state()
    assert [(run.maneuver, run.axis, run.choice) for run in state.runs] == [
        ("chirp", "roll", Choice.FIT),
        ("chirp", "roll", Choice.OUT),
        ("chirp", "pitch", Choice.FIT),
        ("chirp", "pitch", Choice.FIT),
        ("chirp", "roll", Choice.VALIDATE),
        ("doublet", "roll", Choice.VALIDATE),
        ("doublet", "pitch", Choice.VALIDATE),
    ]
    assert [run.verdict for run in state.runs[:2]] == ["keep", "fly again: gust"]
    assert state.runs[1].usable
    assert "gust" in state.runs[1].health
    assert state.runs[0].health.startswith("500 Hz, no gaps, 0.5-10 Hz")
    assert state.vehicle == "simulated 4.5.7, system 1"
    assert state.base == Base("tpp")
    assert (state.home, state.busy, state.progress) == (raw, "", None)
    desk.use("flight.BIN#2", Choice.FIT)
    desk.use(str(state.runs[0].word), Choice.OUT)
    assert [run.id for run in desk.state().chosen(Choice.FIT)] == ["flight.BIN#2", "flight.BIN#3", "flight.BIN#4"]
    with pytest.raises(UsageError, match="no such run"):
        desk.use("flight.BIN#9", Choice.FIT)
    with pytest.raises(TippathError, match="not quiet hover"):
        desk.use("flight.BIN#1", Choice.NOISE)


def test_a_part_of_a_run_is_taken_as_a_command_takes_it_and_found_again(
    worked: tuple[Desk, Path], tmp_path: Path
) -> None:
    shutil.copytree(worked[1] / "flight-0001", tmp_path / "flight-0001", ignore=lambda *_: ["report.html"])
    desk = Desk(now=lambda: WHEN)
    desk.open(str(tmp_path / "flight-0001"))
    whole = desk.state().runs[0]
    desk.cut(whole.word, 1.04, None)
    desk.cut(desk.state().runs[0].word, None, 7.5)
    part = desk.state().runs[0]
    assert (part.word, part.start_s, part.choice) == (f"{whole.word}@1:7.5", whole.start_s, whole.choice)
    assert part.record is not None
    (read,) = resolve_runs([part.word])
    assert np.array_equal(part.record.t, read.t)
    desk.fit()
    assert f"{part.word} " in desk.state().commands[-1]
    again = Desk(now=lambda: WHEN)
    again.open(str(tmp_path / "flight-0001"))
    assert [run.id for run in again.state().chosen(Choice.FIT)] == [run.id for run in desk.state().chosen(Choice.FIT)]
    assert again.state().fitted is not None
    with pytest.raises(TippathError, match="stays whole"):
        desk.halve(part.word)
    with pytest.raises(TippathError, match="nothing is left"):
        desk.cut(part.word, 7.4, None)
    desk.take_whole(part.word)
    assert desk.state().runs[0] == whole
    with pytest.raises(TippathError, match="whole already"):
        desk.take_whole(whole.word)


def test_runs_are_split_by_a_key(short: Path, raw: Path) -> None:
    desk = Desk(now=lambda: WHEN)
    desk.open(str(short))
    with pytest.raises(TippathError, match="H halves"):
        desk.alternate()
    with pytest.raises(TippathError, match="alike"):
        desk.use_alike()
    desk.fit_alone(desk.state().runs[0].word)
    assert desk.state().runs[0].alone[0].startswith("roll alone, of first order: NRMSE p ")
    desk.open(str(raw))
    desk.alternate()
    assert [run.choice for run in desk.state().runs[2:4]] == [Choice.FIT, Choice.VALIDATE]
    desk.alternate()
    assert [run.choice for run in desk.state().runs[2:4]] == [Choice.VALIDATE, Choice.FIT]


@pytest.mark.usefixtures("only_effects")
@pytest.mark.parametrize("only_effects", [("flapping", "servo_lag")], indirect=True)
def test_sliders_are_followed_at_once_judged_at_rest_and_kept_by_a_key(
    short: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tuning, "clearance", partial(clearance, samples=20))
    desk = Desk(now=lambda: WHEN)
    desk.open(str(short))
    desk.fit()
    desk.follow()
    paper = desk.state().trial
    assert paper is not None
    assert paper.found is not None
    desk.turn(Weights(input_cost=12.0, flapping_cost=0.01, observer=0.8, dynamic=True))
    desk.follow()
    trial = desk.state().trial
    assert trial is not None
    assert trial.found is not None
    assert trial.clearance is None
    assert trial.found.gains.margins.phase_deg > paper.found.gains.margins.phase_deg
    assert not list(short.glob("gains*"))
    desk.judge_trial()
    judged = desk.state().trial
    assert judged is not None
    assert judged.clearance is not None
    with pytest.raises(TippathError, match="D designs"):
        desk.shadow()
    desk.design()
    made = desk.state().designed
    assert made is not None
    assert made.clearance is judged.clearance
    assert made.command.endswith(
        "--input-cost 12.0 --flapping-cost 0.01 --observer 40,40,40.8,40.8 --prefilter dynamic "
        f"-o {short / 'gains.json'}"
    )
    desk.diagnose()
    desk.design()
    made = desk.state().designed
    assert made is not None
    assert made.clearance is not judged.clearance, "it was judged before anything was known of what the fit lacks"
    assert made.clearance.standing.state != "not asked"
    desk.shadow()
    made = desk.state().designed
    assert made is not None
    assert made.shadow is not None
    assert desk.state().commands[-1].startswith(f"tippath shadow {short / 'gains-2.json'} {short / 'flight.BIN'}#1")
    desk.seek_present(made.crc)
    held = desk.state().present
    assert held is not None
    assert (held.path, held.found is not None) == (short / "gains-2.json", True)
    desk.seek_present(0x123456)
    assert desk.state().present is None
    with pytest.raises(TippathError, match="fly the card"):
        desk.prove()


def test_weights_that_hold_nothing_are_told_and_designed_by_nobody(short: Path) -> None:
    desk = Desk(now=lambda: WHEN)
    desk.open(str(short))
    desk.fit()
    desk.turn(Weights(flapping_cost=float("nan")))
    desk.follow()
    trial = desk.state().trial
    assert trial is not None
    assert trial.found is None
    assert "flapping cost" in trial.problem
    with pytest.raises(TippathError, match="flapping cost"):
        desk.design()


def test_a_base_is_checked_when_it_is_chosen(raw: Path) -> None:
    desk = Desk()
    desk.open(str(raw))
    desk.choose_base("cd", ("elevator",))
    assert desk.state().base.words == "cd + elevator"
    for model, effects in (("cylinder", ()), ("cd", ("angular_damping",)), ("tpp", ("wings",))):
        with pytest.raises(UsageError):
            desk.choose_base(model, effects)
    assert desk.state().base.words == "cd + elevator"


def test_nothing_is_asked_before_there_is_something(raw: Path, tmp_path: Path) -> None:
    desk = Desk()
    for wish in (desk.fit, desk.compare, desk.diagnose, desk.design, desk.report, lambda: desk.note("x")):
        with pytest.raises(TippathError, match="no flight yet"):
            wish()
    with pytest.raises(TippathError, match="no such folder"):
        desk.open(str(tmp_path / "nowhere"))
    desk.open(str(raw))
    for ask_it in (desk.compare, desk.diagnose, desk.design, desk.report, desk.next_card, desk.undo):
        with pytest.raises(TippathError, match="no fit yet"):
            ask_it()
    for run in desk.state().runs:
        desk.use(run.id, Choice.OUT)
    with pytest.raises(TippathError, match="no run is chosen"):
        desk.fit()
    assert desk.state().busy == ""


# ------------------------------------------------------------------------------------------------ the way to the gains


def test_the_hidden_lag_is_found_and_the_ladder_says_so(worked: tuple[Desk, Path]) -> None:
    state = worked[0].state()
    assert [(rung.name, rung.effect, rung.verdict) for rung in state.ladder] == [
        ("TPP", None, "missing"),
        ("+ servo_lag", "servo_lag", "complete"),
    ]
    first, last = state.ladder
    assert last is state.current
    assert min(last.nrmse_percent[axis] - first.nrmse_percent[axis] for axis in "pq") > 3
    assert {one.key for one in last.signs} == {"validation", "agreement", "plausible"}
    assert last.placebo is not None
    assert last.placebo[0] != "servo_lag"
    assert last.noise_floor_percent is not None
    assert last.noise_floor_percent["q"] == pytest.approx(last.nrmse_percent["q"], abs=1.0)
    assert first.answer is not None
    assert "missing: servo_lag" in text_of(first.answer.brief)
    assert "on runs that were not fitted" in text_of(last.addition_text).replace("\n  ", " ")
    assert state.comparison is last.comparison is not None
    assert state.comparison.traces
    assert state.answer is last.answer
    assert state.asked is None
    assert state.fitted is not None
    for part in ("paper: TPP / CD", "eigenfrequency check", "  validation p"):
        assert part in state.fitted.tables


def test_the_gains_tell_what_they_promise(worked: tuple[Desk, Path]) -> None:
    designed = worked[0].state().designed
    assert designed is not None
    assert designed.rung == "TPP + servo_lag"
    assert designed.gains.margins.gain_db > 3
    assert designed.following is not None
    for answer in (designed.following.roll, designed.following.pitch):
        assert answer.own.shape == designed.following.t.shape == answer.delta_x.shape
        settled = (designed.following.t > 0.4) & (designed.following.t < 0.499)
        np.testing.assert_allclose(answer.own[settled], 0.3, rtol=0.1)
        assert answer.rise_s is not None
        assert 0 < answer.rise_s < 0.4
        assert np.abs(answer.own[-100:]).max() < 0.02


def test_gains_of_an_earlier_session_come_back_with_what_they_are_worth(worked: tuple[Desk, Path]) -> None:
    desk, home = worked
    other = Desk()
    other.open(str(home / "flight-0001"))
    before, now = desk.state().designed, other.state().designed
    assert before is not None
    assert now is not None
    assert now.path == home / "flight-0001" / "gains.json"
    assert (now.text, now.crc, now.rung, now.weights) == (before.text, before.crc, before.rung, before.weights)
    assert now.clearance.judgement.to_json() == before.clearance.judgement.to_json()
    assert now.clearance.standing.to_json() == before.clearance.standing.to_json()
    assert now.identified == before.identified
    assert before.following is not None
    assert now.following is not None
    np.testing.assert_allclose(now.following.roll.own, before.following.roll.own, atol=1e-9)
    other.undo()
    assert other.state().designed is now, "they stay, with the name of the rung that they were designed on"


@pytest.mark.thorough
def test_every_command_does_the_same_again(
    worked: tuple[Desk, Path], raw: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    desk, home = worked
    shutil.copytree(raw, tmp_path / "flight-0001")
    monkeypatch.chdir(tmp_path)
    commands = desk.state().commands
    assert [command.split()[1] for command in commands] == [
        *("ingest", "fit", "fit", "compare", "diagnose", "add", "compare", "diagnose", "design")
    ]
    repeat(commands)
    made = {path.name for path in (home / "flight-0001").glob("*.json")} - {"flight.json"}
    assert made == {
        *("tpp.json", "cd.json", "tpp-compare.json", "tpp-diagnosis.json", "gains.json"),
        *("tpp-servo_lag.json", "tpp-servo_lag-compare.json", "tpp-servo_lag-diagnosis.json"),
    }
    for name in made:
        ours = json.loads((home / "flight-0001" / name).read_text())
        theirs = json.loads((tmp_path / "flight-0001" / name).read_text())
        assert ours == theirs, name


@pytest.mark.thorough
def test_an_effect_of_the_user_s_own_is_named_in_every_command(
    short: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "my tail.py").write_text(DRAG)
    shutil.copytree(short, tmp_path / "again" / short.name)
    shutil.copy(tmp_path / "my tail.py", tmp_path / "again")
    monkeypatch.chdir(tmp_path)
    desk = Desk()
    desk.open(short.name)
    desk.fit()
    desk.add("my tail.py")
    desk.compare()
    desk.design()
    state = desk.state()
    assert [rung.name for rung in state.ladder] == ["TPP", "+ my tail.py"]
    assert state.current is not None
    assert state.current.path == Path("flight-0002/tpp-my tail.json")
    assert state.commands[-3:] == (
        "tippath add flight-0002/tpp.json 'my tail.py' -o 'flight-0002/tpp-my tail.json'",
        "tippath compare 'flight-0002/tpp-my tail.json' --with 'my tail.py' --json > "
        "'flight-0002/tpp-my tail-compare.json'",
        "tippath design 'flight-0002/tpp-my tail.json' --with 'my tail.py' -o flight-0002/gains.json",
    )
    monkeypatch.chdir(tmp_path / "again")
    repeat(state.commands)
    for name in ("tpp-my tail.json", "tpp-my tail-compare.json", "gains.json"):
        assert json.loads((short / name).read_text()) == json.loads(Path(short.name, name).read_text())


@pytest.mark.thorough
def test_forward_flight_begins_with_its_effects_and_quiet_hover_tells_the_noise(tmp_path: Path) -> None:
    card = ((CHIRP, ROLL, 0.1, 8.0), (CHIRP, PITCH, 0.15, 8.0), (CHIRP, ELEVATOR, 0.3, 8.0), (QUIET, ROLL, 0.0, 8.0))
    desk = Desk()
    desk.open(str(fly_folder(tmp_path / "flight-0003", None, card, plant="forward").path))
    state = desk.state()
    assert state.base.words == "tpp + angular_damping + elevator"
    assert [run.choice for run in state.runs] == [Choice.FIT] * 3 + [Choice.NOISE]
    with pytest.raises(TippathError, match="quiet hover"):
        desk.use("flight.BIN#4", Choice.FIT)
    desk.fit()
    desk.compare()
    state = desk.state()
    assert state.fitted is not None
    assert "paper" not in state.fitted.tables.partition("eigenfrequency")[0], "the paper's table is of hover"
    assert max(len(line) for line in state.fitted.tables.splitlines()) <= 80
    assert [one.split(" --model ")[1].split(" -o")[0] for one in state.fitted.commands] == [
        "cd --with elevator",
        "tpp --with angular_damping,elevator",
    ]
    assert [rung.name for rung in state.ladder] == ["TPP + angular_damping + elevator"]
    assert state.comparison is not None
    assert state.comparison.quiet_ratio is not None
    other = Desk()
    other.open(str(tmp_path / "flight-0003"))
    assert other.state().base == state.base
    assert [rung.name for rung in other.state().ladder] == [rung.name for rung in state.ladder]
    desk.choose_base("cd", ("elevator",))
    desk.fit()
    assert [rung.name for rung in desk.state().ladder] == ["CD + elevator"]
    desk.design()
    designed = desk.state().designed
    assert designed is not None
    assert designed.rung == "TPP + elevator"


def test_an_old_flight_is_opened_with_its_ladder_wherever_it_was_moved(
    worked: tuple[Desk, Path], tmp_path: Path
) -> None:
    desk, home = worked
    other = Desk()
    shutil.copytree(home / "flight-0001", tmp_path / "moved")
    other.open(str(tmp_path / "moved"))
    before, after = desk.state(), other.state()
    assert [(rung.name, rung.effect) for rung in after.ladder] == [(rung.name, rung.effect) for rung in before.ladder]
    assert [rung.nrmse_percent for rung in after.ladder] == [rung.nrmse_percent for rung in before.ladder]
    assert after.fitted is not None
    assert before.fitted is not None
    assert after.fitted.tables == before.fitted.tables
    assert [run.choice for run in after.runs] == [run.choice for run in before.runs]
    assert after.unread == ()
    assert [rung.answer for rung in after.ladder] == [rung.answer for rung in before.ladder]
    assert [rung.placebo for rung in after.ladder] == [rung.placebo for rung in before.ladder]
    assert [rung.signs for rung in after.ladder] == [rung.signs for rung in before.ladder]
    texts = [[text_of(rung.addition_text).partition("next:")[0] for rung in one.ladder] for one in (before, after)]
    assert texts[0] == texts[1]
    for rung, same in zip(after.ladder, before.ladder, strict=True):
        assert rung.comparison is not None
        assert same.comparison is not None
        assert dict(rung.comparison.nrmse_percent) == dict(same.comparison.nrmse_percent)
    assert other.state().current.path.name == "tpp-servo_lag.json"  # type: ignore[union-attr]


@pytest.mark.parametrize(
    "harm",
    [
        lambda kept: kept.update(fit_sha256="0" * 64),
        lambda kept: kept["asked"].update(version="0.0.1"),
        lambda kept: kept["asked"].update(as_usual=False),
        lambda kept: kept["asked"].update(fixed={"L_b": 1.0}),
        lambda kept: kept["shown"].pop("brief"),
        lambda kept: kept.update(shown="an answer"),
        lambda kept: kept.pop("asked"),
    ],
)
def test_an_answer_is_believed_only_where_it_fits(
    worked: tuple[Desk, Path], tmp_path: Path, harm: Callable[[dict[str, Any]], None]
) -> None:
    rung = worked[0].state().ladder[0]
    kept = json.loads((worked[1] / "flight-0001" / "tpp-diagnosis.json").read_text())
    (tmp_path / "tpp-diagnosis.json").write_text(json.dumps(kept))
    assert kept_answer(tmp_path, rung.fit) == rung.answer
    harm(kept)
    (tmp_path / "tpp-diagnosis.json").write_text(json.dumps(kept))
    assert kept_answer(tmp_path, rung.fit) is None


def test_what_was_just_diagnosed_is_not_asked_again_when_it_is_added(
    worked: tuple[Desk, Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    from gcs.analysis import addition

    def never(*_: object, **__: object) -> None:
        raise AssertionError("the catalogue was asked again")

    desk, _ = worked
    bottom, grown = desk.state().ladder
    assert bottom.diagnosis is not None
    assert grown.addition is not None
    flown = desk._flown(bottom.fit)
    known = desk._calculations.effect(bottom.fit, "servo_lag")
    monkeypatch.setattr(addition, "diagnose", never)
    again = addition.add_effect(bottom.fit, known, *flown[:2], asked=bottom.diagnosis.last)
    assert again.placebo_rung == grown.placebo
    assert again.placebo is not None
    (wrong,) = again.placebo.effects
    beside = addition.refitted(bottom.fit, [wrong], *flown[:2], grown=bottom.fit)
    assert again.placebo.nrmse_percent == pytest.approx(beside.nrmse_percent, abs=0.2), "in the weights of the fit"
    with pytest.raises(AssertionError, match="asked again"):
        addition.add_effect(bottom.fit, known, *flown[:2])


def test_the_audit_tells_it_all(worked: tuple[Desk, Path]) -> None:
    desk, home = worked
    found, damaged = FlightFolder(home / "flight-0001").audited()
    assert damaged == 0
    assert [one.command for one in found] == [*desk.state().commands[1:]]
    assert {(one.by, one.time) for one in found} == {("app", "2026-05-04T12:30:00.000+00:00")}


def test_one_rung_back_and_the_file_stays(worked: tuple[Desk, Path]) -> None:
    _, home = worked
    other = Desk()
    other.open(str(home / "flight-0001"))
    other.undo()
    assert [rung.name for rung in other.state().ladder] == ["TPP"]
    assert (home / "flight-0001" / "tpp-servo_lag.json").exists()
    with pytest.raises(TippathError, match="bottom"):
        other.undo()
    with pytest.raises(UsageError, match="no effect"):
        other.add("wings")


def test_the_maneuver_that_would_tell_is_kept_as_a_card(worked: tuple[Desk, Path], tmp_path: Path) -> None:
    from gcs.cards.maneuver import load_card
    from sysid.diagnose.next_maneuver import NextManeuver
    from sysid.diagnose.proposals import FitRuns, LogChannels, MeasuredNotGuessed

    _, home = worked
    shutil.copytree(home / "flight-0001", tmp_path / "flight-0001")
    desk = Desk()
    desk.open(str(tmp_path / "flight-0001"))
    desk.undo()
    asked = worked[0].state().ladder[0].diagnosis
    rung = desk.state().current
    assert asked is not None
    assert rung is not None
    desk._replace(rung.fit, answer=None)
    with pytest.raises(TippathError, match="not asked yet"):
        desk.next_card()
    desk._replace(rung.fit, answer=answer_of(asked))
    with pytest.raises(TippathError, match="no maneuver on a card"):
        desk.next_card()
    flown = NextManeuver(FitRuns(("flight.BIN#5",), "doublet", "roll"), ("a", "b"), MeasuredNotGuessed("a"), 5.0, None)
    desk._replace(rung.fit, answer=answer_of(replace(asked, next=flown)))
    with pytest.raises(TippathError, match="nothing is to be flown"):
        desk.next_card()
    table = {"kind": "chirp", "axis": "roll", "amplitude": 0.2, "duration_s": 20.0}
    card = {"name": "next", "maneuver": [table]}
    more = NextManeuver(LogChannels(("beta",)), ("a", "b"), MeasuredNotGuessed("a"), 5.0, card)
    desk._replace(rung.fit, answer=answer_of(replace(asked, next=more)))
    path = desk.next_card()
    assert path == tmp_path / "flight-0001" / "next.toml" == desk.state().card
    assert load_card(str(path)).maneuvers[0].amplitude == 0.2
    assert desk.state().commands[-1].endswith(f"tpp.json --card {path}")


@pytest.mark.thorough
def test_a_report_shows_all_of_it_and_its_command_makes_the_same(
    worked: tuple[Desk, Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    import gcs.analysis.pages.page
    import gcs.analysis.pages.pdf

    def counted(figure: Figure, **_: bool) -> str:
        return f"<svg>{len(figure.axes)} panels</svg>"

    monkeypatch.setattr(gcs.analysis.pages.page, "svg", counted)
    monkeypatch.setattr(gcs.analysis.pages.pdf, "pdf", lambda document, _: f"%PDF {document.title}".encode())
    desk, home = worked
    monkeypatch.chdir(home)
    desk.rename("first <script>flight</script> $x^{")
    desk.report_for_paper()
    state = desk.state()
    assert state.report is not None
    assert state.printed == state.report.with_suffix(".pdf")
    assert state.printed.read_text() == "%PDF first <script>flight</script> $x^{"
    text = state.report.read_text()
    for part in (
        *(
            "<h1>first &lt;script&gt;flight&lt;/script&gt; $x^{</h1>",
            "run 2: fly again: gust",
            "The ladder to tpp-servo_lag.json",
            "Where tpp-servo_lag",
        ),
        *(
            "What tpp.json lacks",
            "missing: servo_lag",
            "What tpp-servo_lag.json lacks",
            "complete: what is left is noise",
            "Gains, gains.json",
            "<svg>3 panels</svg>",
            "servo_lag</td>",
            "SHA-256",
            "What was done",
        ),
        "✓ its size is physically plausible",
    ):
        assert part in text, part
    assert state.commands[-1] == (
        "tippath report flight-0001/tpp.json flight-0001/tpp-servo_lag.json flight-0001/cd.json "
        "--gains flight-0001/gains.json --pdf -o flight-0001/report.html"
    )
    assert (state.progress, state.said) == (None, "wrote flight-0001/report.html and report.pdf")
    words = state.commands[-1].replace("report.html", "again.html").split()[1:]
    typed(*words)
    assert Path("flight-0001/again.html").read_text() == text


def test_the_same_figure_is_the_same_page() -> None:
    from gcs.analysis.pages.page import svg

    def drawn() -> str:
        figure = Figure(figsize=(2, 2))
        figure.subplots().plot([1, 2], [3, 4])
        return svg(figure)

    assert drawn() == drawn()


# ------------------------------------------------------------------------------------------------ name, notes, keeping


def test_name_and_notes_are_kept(short: Path) -> None:
    desk = Desk(now=lambda: WHEN)
    desk.open(str(short))
    desk.rename("  tail\x1b[2J boom ")
    desk.note("gusts from the west")
    other = Desk()
    other.open(str(short))
    assert other.state().name == desk.state().name == "tail [2J boom"
    assert other.state().notes == desk.state().notes
    assert other.state().notes[0].time == "2026-05-04T12:30:00.000+00:00"
    with pytest.raises(TippathError, match="empty"):
        desk.note(" ")
    assert FlightFolder(short).runs(), "what the sweep wrote stays"


def test_a_second_fit_is_kept_beside_the_first(short: Path) -> None:
    desk = Desk()
    desk.open(str(short))
    desk.fit()
    first = desk.state().fitted
    desk.fit()
    again = desk.state().fitted
    assert first is not None
    assert again is not None
    assert again.tpp_path == first.tpp_path, "the same result needs no second file"
    (short / "tpp.json").write_text("{}")
    desk.fit()
    last = desk.state()
    assert last.fitted is not None
    assert last.fitted.tpp_path == short / "tpp-2.json"
    assert last.commands[-1].endswith("-o " + str(short / "tpp-2.json"))
    assert (short / "tpp.json").read_text() == "{}"


def test_a_folder_that_takes_nothing_loses_nothing(
    short: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A card that is read-only: everything stays on the screen, and is kept as soon as another folder is named."""

    def refuse(text: str, path: Path) -> Path:
        if path.parent == short:
            raise TippathError(f"{path} cannot be written (Read-only file system)")
        return keep(text, path)

    keep = gcs.desk.keeping.keep_text
    desk = Desk()
    desk.open(str(short))
    monkeypatch.setattr(gcs.desk.keeping, "keep_text", refuse)
    desk.fit()
    desk.design()
    state = desk.state()
    assert state.fitted is not None
    assert state.designed is not None
    assert state.designed.path is None
    assert state.current is not None
    assert state.current.path is None
    assert state.unkept == ("CD", "TPP", "gains")
    assert "Read-only file system" in state.said
    assert len(state.commands) == 1, "a command would name a file that is not there"
    with pytest.raises(TippathError, match="not kept yet: CD, TPP, gains"):
        desk.report()
    with pytest.raises(TippathError, match="not kept yet"):
        desk.open(str(short))
    desk.keep_in(tmp_path / "results")
    state = desk.state()
    assert state.unkept == ()
    assert [path.name for path in sorted((tmp_path / "results").glob("*.json"))] == [
        "cd.json",
        "gains.json",
        "tpp.json",
    ]
    assert state.designed is not None
    assert state.designed.path == tmp_path / "results" / "gains.json"
    assert [command.split()[1] for command in state.commands] == ["ingest", "fit", "fit", "design"]
    assert Fit.load(tmp_path / "results" / "tpp.json").records[0].path.endswith("flight.BIN")
    other = Desk()
    other.open(str(short))
    assert other.state().ladder == ()


def test_files_that_are_no_fits_of_this_flight_are_left_alone(short: Path, worked: tuple[Desk, Path]) -> None:
    _, home = worked
    desk = Desk()
    desk.open(str(short))
    desk.fit()
    stranger = json.loads((home / "flight-0001" / "tpp.json").read_text())
    (short / "stranger.json").write_text(json.dumps(stranger))
    changed = json.loads((short / "tpp.json").read_text())
    for one in changed["records"]:
        one["sha256"] = "0" * 64
    (short / "changed.json").write_text(json.dumps(changed))
    mine = json.loads((short / "tpp.json").read_text())
    mine["structure"]["effects"] = ["../mine.py"]
    mine["structure"]["user_effects"] = {"../mine.py": "0" * 64}
    (short / "mine.json").write_text(json.dumps(mine))
    (short / "broken.json").write_text('{"format": "tippath.fit/1", "structure": 3}')
    (short / "half.json").write_text('{"format": "tippath.fit/1"')
    (short / "list.json").write_text("[1, 2]")
    other = Desk()
    other.open(str(short))
    state = other.state()
    assert [rung.path for rung in state.ladder] == [short / "tpp.json"]
    said = "\n".join(state.unread)
    assert "stranger" in said or len(state.unread) >= 3
    for word in ("changed.json was not opened: it was made from other", "is code", "broken.json was not opened"):
        assert word in said, said


# ------------------------------------------------------------------------------------------------ busy, called off


def test_what_is_called_off_changes_nothing(short: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    desk = Desk()
    desk.open(str(short))
    desk.fit()
    before = desk.state()

    def asks(*_: object, say: Listener) -> None:
        say(Asking(stage=Stage.SCORES, effects=("servo_lag",), number=2, of=3))
        say(Heard(effects=("servo_lag",), known=Known.SCORED, promise=9.0))
        assert desk.state().busy == "asking servo_lag (2 of 3)"
        desk.cancel()
        assert desk.state().busy.startswith("calling off: ")
        say(Asking(stage=Stage.SCORES, effects=("gyro_lag",), number=3, of=3))

    monkeypatch.setattr("gcs.desk.calculations.diagnose_fit", asks)
    files = sorted(short.iterdir())
    with pytest.raises(Cancelled, match="called off: asking"):
        desk.diagnose()
    after = desk.state()
    assert (after.ladder, after.commands, after.busy) == (before.ladder, before.commands, "")
    assert "the ranking so far stays, and is no verdict" in after.said
    assert after.answer is None
    assert after.ranking is not None
    assert after.ranking.over
    assert [one.effects for one in after.ranking.ranking.standings] == [("servo_lag",)]
    assert sorted(short.iterdir()) == files
    desk.cancel()  # nothing is under way: no harm to what comes next
    desk.compare()
    assert desk.state().comparison is not None


def test_one_thing_at_a_time_and_the_state_is_there_meanwhile(short: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import gcs.desk.calculations

    begun, go_on = threading.Event(), threading.Event()
    identify = gcs.desk.calculations.identify_flight

    def slow(*args: object, **kwargs: object) -> object:
        begun.set()
        assert go_on.wait(60)
        return identify(*args, **kwargs)  # type: ignore[arg-type]

    monkeypatch.setattr(gcs.desk.calculations, "identify_flight", slow)
    desk = Desk()
    desk.open(str(short))
    worker = threading.Thread(target=desk.fit)
    worker.start()
    assert begun.wait(60)
    assert desk.state().busy == "fitting: TPP and CD"
    for wish in (desk.fit, desk.design, lambda: desk.open(str(short)), desk.undo):
        with pytest.raises(TippathError, match="wait: fitting"):
            wish()
    desk.note("meanwhile")
    desk.use("flight.BIN#1", Choice.VALIDATE)
    waiting = threading.Thread(target=lambda: desk.open(str(short), wait=True))
    waiting.start()
    go_on.set()
    worker.join(60)
    waiting.join(60)
    state = desk.state()
    assert [rung.name for rung in state.ladder] == ["TPP"], "opened again, with what was kept"
    assert [note.text for note in state.notes] == ["meanwhile"]
    assert state.report is None
    assert state.home is not None
    (state.home / "report.html").touch()
    desk.open(str(short), wait=True)
    assert desk.state().report == state.home / "report.html", "the page that lies there"


def test_what_the_data_refuse_is_told_and_changes_nothing(short: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sysid.fit.axes.LARGEST_RELATIVE_ERROR", 0.001)
    desk = Desk()
    desk.open(str(short))
    with pytest.raises(TippathError, match="roll axis not identifiable"):
        desk.fit()
    assert desk.state().fitted is None
    assert not list(short.glob("tpp*.json"))
