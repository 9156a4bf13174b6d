"""`tippath sweep`, `abort`, `sim` and `demo`: usage, the typed word, interrupts, and what reaches the screen."""

from __future__ import annotations

import contextlib
import io
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fake_flight import FakeSession, FakeVehicle
from planted import TABLE_4
from slow_flight import SlowFlight

from gcs.analysis.following import following
from gcs.cards.envelope import Limits
from gcs.cards.maneuver import Maneuver, TestCard, parse_card
from gcs.cli import main
from gcs.cli.interrupts import interrupts
from gcs.cli.progress import ProgressLines
from gcs.cli.sim import PILOT_LINES, banner, next_directory
from gcs.cli.sweep import is_loopback, require_terminal, typed_confirmation
from gcs.demo.demo import DemoError, require_same_bytes
from gcs.demo.pilot import SimulatedVehicle
from gcs.errors import LinkError, UsageError
from gcs.flight.folder import create
from gcs.flight.run import Note
from gcs.flight.session import Session
from gcs.flight.sweep import fly_card
from gcs.logs import ingest
from sysid.control.regulator import design
from sysid.model.compose import compose
from sysid.model.structure import Model

FAST = 92_160.0
"""Bytes a second: 921,600 baud."""


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--amplitude", "0.1"], "of which axis?"),
        (["--card", "hover", "--log", "card", "--probe"], "leave one of them out"),
        (["--card", "hover", "--axis", "roll"], "leave out --axis"),
        (["--card", "hover", "--amplitude", "0.2"], "leave out --amplitude"),
        (["--card", "nowhere.toml"], "no such card"),
        (["--axis", "roll", "--amplitude", "4"], "amplitude is a number from 0 to 1"),
        (["--axis", "roll", "--duration", "2"], "no two periods"),
    ],
)
def test_a_sweep_that_makes_no_sense_is_wrong_usage(
    words: list[str], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["sweep", "--connect", "udpin:127.0.0.1:0", *words]) == 2
    out, err = capsys.readouterr()
    assert message in err
    assert out == ""


@pytest.mark.parametrize(
    ("link", "here"),
    [
        ("udpin:127.0.0.1:14550", True),
        ("tcp:localhost:5760", True),
        ("udpin:[::1]:14550", True),
        ("udpin:0.0.0.0:14550", False),
        ("udpout:192.168.4.1:14550", False),
        ("udpin:vehicle.local:14550", False),
        ("/dev/ttyUSB0,921600", False),
    ],
)
def test_only_a_link_that_ends_here_can_be_a_simulation(link: str, here: bool) -> None:
    assert is_loopback(link) is here
    with pytest.raises(LinkError):
        is_loopback("nonsense")


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def test_hardware_wants_the_typed_word(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(UsageError, match="--yes does not fly hardware"):
        require_terminal(True)
    monkeypatch.setattr(sys, "stdin", io.StringIO("fly\n"))
    with pytest.raises(UsageError, match="on a terminal"):
        require_terminal(False)
    for text, answer in (("fly\n", True), ("yes\n", False), ("\n", False), ("", False)):
        monkeypatch.setattr(sys, "stdin", Terminal(text))
        require_terminal(False)
        assert typed_confirmation() is answer
    assert "This vehicle is real" in capsys.readouterr().err


@pytest.fixture
def ctrl_c_is_heard() -> Iterator[None]:
    """As in a terminal, and not as a shell starts a suite in its background."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.usefixtures("ctrl_c_is_heard")
def test_ctrl_c_is_a_wish_first_and_an_exception_only_the_third_time(capsys: pytest.CaptureFixture[str]) -> None:
    before = signal.getsignal(signal.SIGINT)
    with interrupts() as wishes:
        assert wishes() is None
        os.kill(os.getpid(), signal.SIGINT)
        assert wishes() == "Ctrl-C"
        os.kill(os.getpid(), signal.SIGINT)
        with pytest.raises(KeyboardInterrupt):
            os.kill(os.getpid(), signal.SIGINT)
    assert signal.getsignal(signal.SIGINT) is before
    assert "ending the excitation" in capsys.readouterr().err


@pytest.fixture
def hang_ups_are_heard() -> Iterator[None]:
    """As in a terminal, and not as `nohup` starts a suite."""
    before = signal.signal(signal.SIGHUP, signal.SIG_DFL)
    yield
    signal.signal(signal.SIGHUP, before)


@pytest.mark.usefixtures("hang_ups_are_heard")
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
def test_a_hang_up_is_a_wish_too(number: signal.Signals) -> None:
    before = signal.getsignal(number)
    with interrupts() as wishes:
        os.kill(os.getpid(), number)
        assert wishes() == number.name
    assert signal.getsignal(number) is before


def test_suspending_is_not_taken_while_something_flies() -> None:
    with interrupts() as wishes:
        os.kill(os.getpid(), signal.SIGTSTP)
        assert wishes() is None
    assert signal.getsignal(signal.SIGTSTP) is not signal.SIG_IGN


def test_the_lines_of_a_card_say_what_is_flown_and_what_it_was_worth(tmp_path: Path) -> None:
    vehicle, stream = FakeVehicle(), io.StringIO()
    session, lines = FakeSession(vehicle), ProgressLines(Limits(), stream)

    def confirm(briefing: Any) -> bool:
        lines.briefing(briefing)
        return True

    fly_card(
        session,
        TestCard(
            name="two", maneuvers=(Maneuver(kind="chirp", axis="roll", amplitude=0.1, duration_s=10.0, repeat=2),)
        ),
        folder=create(tmp_path / "f"),
        clock=session,
        disk_free=lambda _: 10**12,
        confirm=confirm,
        on_progress=lines,
    )
    text = stream.getvalue()
    assert "card two: 2 runs" in text
    assert "if the link drops: the sweep does NOT stop" in text
    assert "ready   roll chirp 1/2   0.5-10 Hz  10 s  A 0.10   Table 1" in text
    assert "✓ roll chirp 2/2   keep   coherence" in text
    assert "\x1b" not in text, "no terminal, no escapes"


def test_what_a_vehicle_says_cannot_reach_the_terminal_as_an_escape() -> None:
    stream = io.StringIO()
    ProgressLines(Limits(), stream)(Note("bad \x1b[2J\x07 words"))
    assert stream.getvalue() == " bad ?[2J? words\n"


def test_a_lost_link_is_told_with_the_wait_the_way_out_and_who_takes_over(tmp_path: Path) -> None:
    vehicle, stream = FakeVehicle(), io.StringIO()
    session, lines = FakeSession(vehicle, station=255), ProgressLines(Limits(), stream)
    vehicle.in_sweep(3.0, lambda: setattr(session, "deaf_from", vehicle.now))

    def confirm(briefing: Any) -> bool:
        lines.briefing(briefing)
        return True

    fly_card(
        session,
        TestCard(name="one", maneuvers=(Maneuver(kind="chirp", axis="roll", amplitude=0.1, duration_s=10.0),)),
        folder=create(tmp_path / "f"),
        clock=session,
        disk_free=lambda _: 10**12,
        confirm=confirm,
        on_progress=lines,
    )
    text = stream.getvalue()
    assert text.count("LINK LOST: no abort reaches the vehicle. PILOT: take over") == 1
    assert "the vehicle's own answer to a lost link: returns home after 5 s" in text
    assert "waiting up to 60 s for the vehicle" in text
    assert "Ctrl-C ends the wait" in text


@pytest.mark.usefixtures("ctrl_c_is_heard", "hang_ups_are_heard")
def test_only_ctrl_c_counts_as_pressed() -> None:
    with interrupts() as wishes:
        os.kill(os.getpid(), signal.SIGHUP)
        assert (wishes.count, wishes.pressed) == (1, 0)
        os.kill(os.getpid(), signal.SIGINT)
        assert (wishes.count, wishes.pressed) == (2, 1)


def test_the_sweeps_help_holds_a_card_that_can_be_flown(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["sweep", "--help"])
    text = capsys.readouterr().out
    example = text[text.index('  name = "my card"') : text.index("A vehicle profile (")]
    card = parse_card(example, "help")
    assert [m.kind for m in card.maneuvers] == ["chirp", "doublet"]
    assert card.limits == Limits()
    keys = {field.name for field in fields(Maneuver)}
    assert [key for key in keys if key not in example] == [], "every key is in the help"
    assert card.maneuvers[0].is_table_1


def test_the_pilots_lines_are_all_named(capsys: pytest.CaptureFixture[str]) -> None:
    from sitl.autopilot.modes import Mode

    switch = {f"switch {position}" for position in ("low", "middle", "high")}
    assert set(PILOT_LINES) == {"takeoff", "land", "lqr on", "lqr off", "reboot", "quit"} | switch | {
        f"mode {m.name.lower()}" for m in Mode
    }
    with pytest.raises(SystemExit):
        main(["sim", "--help"])
    help_text = " ".join(capsys.readouterr().out.split())
    ready = {"link": "a", "ground_link": "udpin:127.0.0.1:14550", "plant": "forward", "directory": "d"}
    words = banner(json.dumps(ready))
    for line in PILOT_LINES:
        assert line in help_text
        assert line in words
    assert "--card forward, or --axis roll|pitch|elevator" in words
    assert "elevator" not in banner(json.dumps(ready | {"plant": "hover"}))
    stock = banner(json.dumps(ready | {"plant": "quad", "like": "ardupilot-quad"}))
    assert "plant quad · like ardupilot-quad" in stock
    assert "--card" not in stock


def test_vehicle_folders_are_numbered(tmp_path: Path) -> None:
    assert next_directory(tmp_path).name == "vehicle-0001"
    (tmp_path / "vehicle-0001").mkdir()
    assert next_directory(tmp_path).name == "vehicle-0002"


def test_a_vehicle_that_is_not_there_is_said_and_leaves_no_folder(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    found = Session.open
    monkeypatch.setattr(Session, "open", lambda link, **more: found(link, connect_timeout_s=0.2, **more))
    folder = tmp_path / "flight"
    link = ["--connect", "udpout:127.0.0.1:9"]
    for words in (["abort", *link, "--json"], ["sweep", *link, "--card", "quick", "-o", str(folder)]):
        assert main(words) == 1
        out, err = capsys.readouterr()
        assert "no vehicle at" in err
        assert ('"reason": "link"' in out) == ("--json" in words)
    assert not folder.exists()


# -------------------------------------------------------------------------------------------- how a rate is followed


def doublets(n: int = 4500, pulse: int = 250) -> np.ndarray:
    which = (np.arange(n) // pulse) % 6
    return np.select([which == 0, which == 1], [0.3, -0.3], 0.0)


def test_a_rate_that_lags_and_reaches_nine_tenths_is_measured_so() -> None:
    command = doublets()
    t = np.arange(command.size) * 0.002
    measured = 0.9 * np.concatenate([np.zeros(20), command[:-20]])
    found = following("roll", t, command, measured, command)
    assert found.lag_s == pytest.approx(0.04)
    assert found.correlation == pytest.approx(1.0, abs=1e-6)
    assert found.steady_share == pytest.approx(0.9, abs=1e-6)
    assert found.follows


@pytest.mark.parametrize("factor", [0.0, -1.0, 0.3, 2.0])
def test_a_rate_that_does_something_else_does_not_follow(factor: float) -> None:
    command = doublets()
    noise = np.random.default_rng(1).normal(0, 0.03, command.size)
    found = following("pitch", np.arange(command.size) * 0.002, command, factor * command + noise, command)
    assert not found.follows
    assert "does not follow" in found.words


# -------------------------------------------------------------------------------------------- the real processes


@pytest.mark.realtime
def test_sim_says_how_to_connect_passes_its_pilots_lines_and_ends(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "gcs.cli", "sim", "--plant", "hover-ideal", "--listen", "udpout:127.0.0.1:0"]
    with subprocess.Popen(
        [*command, "-o", str(tmp_path / "v"), "--on-ground", "--json"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    ) as sim:
        assert sim.stdout is not None
        assert sim.stdin is not None
        ready = json.loads(sim.stdout.readline())
        assert ready["ground_link"].startswith("udpin:127.0.0.1:")
        sim.stdin.write(b"takeoff\nquit\n")
        sim.stdin.flush()
        out, err = sim.communicate(timeout=10)
        assert sim.returncode == 0
        assert out == b"", "one document"
        assert err.decode().splitlines() == [" pilot: ok", " pilot: ok"]


@pytest.mark.realtime
@pytest.mark.thorough
def test_sim_ends_by_a_signal_and_leaves_no_vehicle_behind(tmp_path: Path) -> None:
    """One ended by Ctrl-C, one by the system; they start side by side."""
    command = [sys.executable, "-m", "gcs.cli", "sim", "--listen", "udpout:127.0.0.1:0", "-o"]
    with contextlib.ExitStack() as stack:
        sims = {
            number: stack.enter_context(
                subprocess.Popen(
                    [*command, str(tmp_path / number.name)],
                    stdin=subprocess.DEVNULL,
                    stdout=subprocess.PIPE,
                    stderr=subprocess.PIPE,
                )
            )
            for number in (signal.SIGINT, signal.SIGTERM)
        }
        for number, sim in sims.items():
            assert sim.stdout is not None
            assert b"vehicle on udpout:127.0.0.1:" in sim.stdout.readline(), number
        started = time.monotonic()
        for number, sim in sims.items():
            sim.send_signal(number)
        for number, sim in sims.items():
            assert sim.stdout is not None
            assert sim.stderr is not None
            out, err = sim.stdout.read(), sim.stderr.read()
            assert sim.wait(5) in (0, -number)
            assert time.monotonic() - started < 8
            assert b"Traceback" not in err, number
            assert b"tippath fly --connect" in out, number


def sweep_of(link: str, folder: Path, *words: str) -> subprocess.Popen[bytes]:
    """`tippath sweep` as a process of its own."""
    command = [sys.executable, "-m", "gcs.cli", "sweep", "--connect", link, *words, "-o", str(folder), "--json"]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE)


@pytest.mark.realtime
def test_a_real_sweep_is_ended_by_ctrl_c(tmp_path: Path) -> None:
    """Ctrl-C brings the vehicle back into its mode, and what was recorded is the vehicle's own log."""
    with SimulatedVehicle("hover-ideal", tmp_path / "vehicle", seed=3) as vehicle:
        with sweep_of(vehicle.ground_link, tmp_path / "flight", "--axis", "roll") as sweep:
            assert sweep.stderr is not None
            for raw in sweep.stderr:
                if raw.startswith(b" ready"):
                    break
            time.sleep(1.5)
            sweep.send_signal(signal.SIGINT)
            out, err = sweep.communicate(timeout=15)
        assert sweep.returncode == 130, err
        about = json.loads(out)
        assert (about["format"], about["complete"], about["ending"]) == ("tippath.sweep/1", False, "aborted")
        assert about["missing_blocks"] == 0
        with Session.open(vehicle.ground_link) as session:
            assert session.snapshot().mode_name == "Stabilize"
    log = (tmp_path / "flight" / "flight.BIN").read_bytes()
    assert any(path.read_bytes() == log for path in (tmp_path / "vehicle").glob("*.BIN"))


@pytest.mark.thorough
def test_the_elevator_is_swept_by_one_command(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    elevator = ("--axis", "elevator", "--amplitude", "0.3", "--duration", "8", "--no-probe")
    with contextlib.closing(
        SlowFlight(monkeypatch, "forward", None, tmp_path / "sd", bytes_s=FAST, on_ground=False)
    ) as flown:
        assert flown.tippath("sweep", *elevator, "-o", tmp_path / "flight", "--json") == 0
    (run,) = json.loads(capsys.readouterr().out)["runs"]
    assert (run["maneuver"]["axis"], run["parameters"]["SID_AXIS"], run["flew"]) == ("elevator", 20, "Table 1")
    assert run["verdict"]["keep"], run["verdict"]["reasons"]
    (swept,) = ingest([tmp_path / "flight"]).runs
    assert (swept.axis, swept.usable) == ("elevator", True)
    assert {"airspeed", "omega", "delta_e", "excitation_e"} <= set(swept.sources)


def test_the_log_must_be_a_file_of_the_vehicle_byte_for_byte(tmp_path: Path) -> None:
    log, own = tmp_path / "flight.BIN", tmp_path / "vehicle"
    own.mkdir()
    log.write_bytes(b"abc" * 1000)
    (own / "vehicle-1.BIN").write_bytes(b"abc" * 999 + b"abd")
    with pytest.raises(DemoError, match="equals none of the vehicle's own 1 logs"):
        require_same_bytes(log, own)
    (own / "vehicle-2.BIN").write_bytes(log.read_bytes())
    assert require_same_bytes(log, own).name == "vehicle-2.BIN"


def test_rate_doublets_need_the_lqr_and_tell_how_they_were_followed(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A gentle set is pushed on the ground; with the switch off the card is refused, with it on it is measured."""
    card = tmp_path / "rates.toml"
    card.write_text(
        'rest_s = 0\n[[maneuver]]\nkind = "doublet"\ntarget = "rate"\naxis = "roll"\namplitude = 0.3\nduration_s = 4\n'
        "pulse_s = 0.5\n"
    )
    tpp = compose("tpp")
    model = Model(tpp, np.array([TABLE_4[name] for name in tpp.names]))
    (tmp_path / "gains.json").write_text(json.dumps(design(model).to_json()))
    with contextlib.closing(SlowFlight(monkeypatch, "hover-ideal", None, tmp_path / "sd", bytes_s=FAST)) as flown:
        assert flown.tippath("push", tmp_path / "gains.json") == 0
        flown.pilot("takeoff")
        flown.sleep(8.0)
        assert flown.tippath("sweep", "--card", card, "-o", tmp_path / "refused", "--json") == 1
        assert "the LQR is not selected (LQR_SW is 0)" in capsys.readouterr().err
        assert not (tmp_path / "refused").exists()
        flown.pilot("lqr on")
        assert flown.tippath("sweep", "--card", card, "-o", tmp_path / "flown", "--json") == 0
        (found,) = json.loads(capsys.readouterr().out)["following"]
        assert (found["axis"], found["follows"]) == ("roll", True)
