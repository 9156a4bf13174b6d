"""The real app on the real simulated vehicle, in real time: a whole flight test from Connect to verified gains, links
that are lost and found, and apps that end in mid-chirp. Three minutes."""

from __future__ import annotations

import asyncio
import contextlib
import fcntl
import json
import os
import pty
import re
import shlex
import shutil
import signal
import struct
import subprocess
import sys
import termios
import threading
import time
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any

import pytest
from fake_app import screen_text, settle, until
from radio import Radio, on_radio
from textual.widgets import Input

from gcs.demo.pilot import SimulatedVehicle
from gcs.flight.session import Session
from gcs.link.procedures import ReadParameter
from gcs.tui.app import TippathApp
from gcs.tui.base import Dialog
from gcs.tui.connect import ConnectScreen
from gcs.tui.reconnect import Reconnecting
from gcs.tui.state import Mark, Stage
from gcs.tui.worker import FlightWorker

SECRET = 23
"""The seed of a vehicle whose servos lag by 23.7 ms."""
FOUR_CHIRPS = """\
name = "four"
[[maneuver]]
kind = "chirp"
axis = "roll"
amplitude = 0.10
duration_s = 15
repeat = 2
[[maneuver]]
kind = "chirp"
axis = "pitch"
amplitude = 0.15
duration_s = 15
repeat = 2
"""
ONE_CHIRP = """\
name = "one"
[[maneuver]]
kind = "chirp"
axis = "roll"
amplitude = 0.05
duration_s = 20
f_start_hz = 1.0
"""


class Sitting:
    """Somebody before the app: presses keys, reads the screen, and tells how long it took."""

    def __init__(self, app: TippathApp, pilot: Any) -> None:
        self.app = app
        self.press = pilot.press
        self._began = self._last = time.monotonic()

    async def shown(self) -> str:
        await settle(self.app)
        return "\n".join(screen_text(self.app))

    async def shows(self, *words: str, within_s: float = 30.0) -> str:
        """Wait until all of these stand on the screen."""
        end = time.monotonic() + within_s
        while True:
            text = await self.shown()
            if all(word in text for word in words):
                return text
            assert time.monotonic() < end, f"{words} are not on the screen:\n{text}"
            await asyncio.sleep(0.05)

    async def typed(self, text: str) -> None:
        """Into the dialog that is open."""
        self.app.screen.query_one(Input).value = text
        await self.press("enter")

    def did(self, what: str) -> None:
        now = time.monotonic()
        print(f"  {now - self._began:6.1f} s  {what} ({now - self._last:.1f} s)")
        self._last = now


# ------------------------------------------------------------------------------------- from connect to verified gains


class Outliving:
    """A simulated vehicle that its app does not end, so that it can be asked afterwards."""

    def __init__(self, vehicle: SimulatedVehicle) -> None:
        self.vehicle = vehicle
        self.ground_link = vehicle.ground_link
        self.say = vehicle.say

    def close(self) -> None:
        """The app has gone; the vehicle stays."""


@pytest.mark.realtime
async def study_from_connect_to_verified_gains(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    home = tmp_path / "home"
    home.mkdir()
    monkeypatch.chdir(home)
    Path("four.toml").write_text(FOUR_CHIRPS)
    made: list[SimulatedVehicle] = []

    def make(plant: str, directory: Path, **how: Any) -> Outliving:
        made.append(SimulatedVehicle(plant, directory, **{**how, "seed": SECRET}))
        return Outliving(made[-1])

    engine = Reconnecting(folder=Path(), make_vehicle=make)
    desk = engine.desk
    app = TippathApp(engine, bell=False, connections=engine, first="connect")
    print("\nfrom Connect to verified gains")
    try:
        async with app.run_test(size=(120, 40)) as pilot:
            who = Sitting(app, pilot)
            await who.shows("up/down and enter choose where to connect", "simulated, hidden")
            screen = app.screen
            assert isinstance(screen, ConnectScreen)
            while screen.offered[screen.at].name != "simulated, hidden":
                await who.press("down")
            await who.press("enter")
            await who.shows("system 1, ArduPilot", "helicopter", "Stabilize")
            who.did("connected to a vehicle with a secret")

            await who.press("2", "c")
            await who.typed("four.toml")
            await who.shows("roll chirp 1/2", "pitch chirp 2/2", "next: R makes the first run ready")
            for number in range(1, 5):
                await until(lambda: engine.state().stage in (Stage.IDLE, Stage.HELD))
                await who.press("r")
                await who.shows("READY:", "nothing moves until S")
                assert engine.state().vehicle.mode_name == "Stabilize"
                await who.press("s")
                await who.shows("SystemID (tippath)", "s left")
                await until(lambda n=number: engine.state().runs[n - 1].mark in (Mark.KEEP, Mark.AGAIN), 30)
                assert engine.state().runs[number - 1].mark is Mark.KEEP, engine.state().runs[number - 1].why
                who.did(f"flew {engine.state().runs[number - 1].label}: {engine.state().runs[number - 1].why}")
                if number == 2:  # R before its time is refused, and the refusal does not stay
                    assert engine.state().stage is Stage.CHECKING
                    await who.press("r")
                    await who.shows("not yet: a run is under way")
                    await until(lambda: engine.state().stage is Stage.HELD)
                    assert "not yet" not in await who.shown()
            await until(lambda: engine.state().stage is Stage.IDLE)
            text = await who.shows("4 of 4 runs kept, 0 blocks missing")
            assert text.count("✓ keep") == 4
            assert engine.state().vehicle.mode_name == "Stabilize"

            await who.press("3")
            await who.shows("next: 4 fits 4 runs")
            await who.press("4", "f")
            await until(lambda: desk.state().comparison is not None and not desk.state().busy)
            await who.shows("natural modes", "measured", "next: 5 shows where the fit fails")
            who.did("fitted")
            await who.press("5")
            await who.shows("% of the error sits in", "next: 6 asks which effect is missing")
            await who.press("6", "d")
            await until(lambda: desk.state().answer is not None and not desk.state().busy, 60)
            text = await who.shows("missing: ", "next: A adds")
            found = desk.state().answer.effect
            assert found in ("servo_lag", "gyro_lag"), "the two cannot be told apart by these runs"
            assert f"missing: {found}" in text
            who.did(f"asked: missing {found}, confidence {desk.state().answer.confidence:.2f}")
            await who.press("a")
            await until(lambda: len(desk.state().ladder) == 2 and not desk.state().busy, 60)
            await who.press("7")
            await who.shows("+ " + found, "placebo")
            await who.press("d")
            await until(lambda: desk.state().answer is not None and not desk.state().busy, 60)
            assert desk.state().answer.verdict == "complete"
            await who.shows("next: 8 designs gains on it")
            who.did("added, asked again: complete")

            await who.press("8", "d")
            await until(lambda: desk.state().designed is not None and not desk.state().busy)
            await who.shows("gain margin", "next: L: the simulated pilot lands; then P")
            await who.press("p")
            await who.shows("the vehicle is armed: gains are moved on the ground")
            assert not isinstance(app.screen, Dialog)
            await who.press("l")
            await until(lambda: not engine.state().vehicle.armed, 60)
            await who.shows("next: P pushes them to the vehicle")
            who.did("designed, landed")
            await who.press("p")
            await who.shows("Push these gains?", f"{desk.state().designed.crc:06x}")
            await who.press("y")
            await until(lambda: engine.state().bank is not None and engine.state().bank.active, 30)
            crc = desk.state().designed.crc
            assert engine.state().bank.active == crc
            await until(lambda: not engine.state().busy)
            await who.shows(f"the vehicle's LQR: {crc:06x}", "read back, equal bit for bit")
            who.did(f"pushed {crc:06x}")

            await who.press("9", "w")
            await until(lambda: desk.state().report is not None and not desk.state().busy, 60)
            await who.shows("the page:", "wrote the report")
            who.did("wrote the report")
            flight = engine.state().flight
            commands = engine.state().commands
            listed = " ".join("\n".join(map(str, lines_of(app))).split())
            for command in commands:
                assert " ".join(command.split()) in listed, command
            await who.press("q")
            await until(lambda: app._exit)
        await asyncio.to_thread(engine.close)
        assert [command.split()[1] for command in commands] == [
            *("sweep", "ingest", "fit", "fit", "compare", "diagnose", "add", "compare", "diagnose"),
            *("design", "push", "report"),
        ]
        began = time.monotonic()
        with Session.open(made[0].ground_link) as session:
            assert int(session.call(ReadParameter("LQR_ACTIVE")).value) == crc, "another session reads the same bank"
        repeat(home, tmp_path / "copy", flight, commands)
        print(f"  the {len(commands) - 1} commands in a copy gave the same ({time.monotonic() - began:.1f} s)")
    finally:
        engine.close()
        for vehicle in made:
            vehicle.close()
    revealed = tippath(home, f"tippath reveal vehicle-0001 {flight}/tpp-diagnosis.json --json")
    (judged,) = json.loads(revealed)["diagnoses"]
    print(f"  revealed: {judged['effect']}, {judged['outcome']}")
    assert judged["outcome"] in ("right", "same", "not_told_apart")


def lines_of(app: TippathApp) -> list[object]:
    """All of the text on the screen, also what is scrolled away."""
    from gcs.tui.widgets.lines import Lines

    return [app.screen.query_one("#text", Lines).shown]


def tippath(folder: Path, command: str) -> str:
    """Type a command there, in a shell."""
    environment = {**os.environ, "PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"}
    done = subprocess.run(
        command, shell=True, cwd=folder, env=environment, capture_output=True, text=True, timeout=120, check=False
    )
    assert done.returncode == 0, f"{command}: {done.stderr}"
    return done.stdout


def repeat(home: Path, copy: Path, flight: Path, commands: tuple[str, ...]) -> None:
    """Type all commands but the flight itself in a folder with nothing but what was flown; files are the same."""
    (copy / flight).mkdir(parents=True)
    for name in ("flight.BIN", "flight.tlog", "flight.json", "card.toml"):
        shutil.copy2(home / flight / name, copy / flight / name)
    for command in commands:
        if shlex.split(command)[1] == "sweep":
            continue
        said = tippath(copy, command)
        if shlex.split(command)[1] == "push":
            assert "already" in said, said
    made = {path.name for path in (home / flight).iterdir()} - {"audit.jsonl", "flight.json"}
    assert made == {path.name for path in (copy / flight).iterdir()} - {"audit.jsonl", "flight.json"}
    for name in sorted(made):
        ours, theirs = ((one / flight / name).read_bytes() for one in (home, copy))
        if name.endswith(".json"):
            assert json.loads(ours) == json.loads(theirs), name
        else:
            assert ours == theirs, name


# ------------------------------------------------------------------------------------------- links lost and found


@contextlib.asynccontextmanager
async def flown_over_a_radio(folder: Path, *, primary: bool, runs: int = 1) -> AsyncIterator[Any]:
    """The app with a card of chirps, connected: whoever sits before it, its engine and the radio."""
    card = folder / "card.toml"
    card.write_text(ONE_CHIRP + f"repeat = {runs}\n")
    radio: list[Radio] = []

    def start() -> Radio:
        radio.append(on_radio("hover-ideal", folder / "vehicle", seed=3))
        return radio[0]

    engine = FlightWorker(None, plant="hover-ideal", start_vehicle=start, primary=primary, card=str(card))
    try:
        app = TippathApp(engine, bell=False)
        async with app.run_test(size=(80, 24)) as pilot:
            who = Sitting(app, pilot)
            await until(lambda: engine.state().stage is Stage.IDLE)
            yield who, engine, radio[0]
        await asyncio.to_thread(engine.close)
    finally:
        for one in radio:
            one.cut = False
        engine.close()


async def lose(who: Sitting, engine: FlightWorker, radio: Radio) -> float:
    """Cut the radio and wait until the screen says so; when it was cut."""
    radio.cut, cut_at = True, time.monotonic()
    await who.shows("LINK LOST", within_s=5)
    after = time.monotonic() - cut_at
    print(f"  the screen says so {after:.2f} s after the cut")
    assert after < 3.8
    assert engine.state().lost
    return cut_at


def kept_whole(engine: FlightWorker, folder: Path) -> dict[str, Any]:
    """Of the flight flown last; its log is one of the vehicle's own, to the last byte."""
    flight = engine.state().flight
    assert flight is not None
    about: dict[str, Any] = json.loads((flight / "flight.json").read_text())
    assert about["missing_blocks"] == 0
    log = (flight / "flight.BIN").read_bytes()
    own = [one for path in (folder / "vehicle").glob("*.BIN") if (one := path.read_bytes()).startswith(log)]
    assert own, "not the vehicle's own"
    assert log == own[0], f"only the first {len(log) / len(own[0]):.1%} of the vehicle's own"
    return about


@pytest.mark.realtime
async def study_link_lost_in_a_chirp_past_the_failsafe(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The vehicle returns by its own failsafe; found again, it is left to it."""
    monkeypatch.chdir(tmp_path)
    print("\nlink lost for 9 s in a chirp, by the station that holds the failsafe")
    async with flown_over_a_radio(tmp_path, primary=True, runs=2) as (who, engine, radio):
        await who.press("r")
        await who.shows("READY:", "if the link drops: returns home")
        await who.press("s")
        await until(lambda: engine.state().progress is not None and engine.state().progress.elapsed_s > 2)
        cut_at = await lose(who, engine, radio)
        await who.shows("LINK LOST IN THE RUN", "next: the PILOT ends it with the transmitter", within_s=0.5)
        await who.press("4")
        assert "next: the PILOT ends it with the transmitter" in await who.shown(), "on every screen"
        await who.press("2", "f12", "s", "r")  # what is pressed in the dark is not done later
        await asyncio.sleep(cut_at + 9 - time.monotonic())
        radio.cut, found_at = False, time.monotonic()
        await until(lambda: engine.state().stage is Stage.IDLE)
        print(f"  over {time.monotonic() - found_at:.1f} s after it was found")
        for _ in range(10):
            assert engine.state().stage is Stage.IDLE
            assert engine.state().vehicle.mode_name == "RTL"
            await asyncio.sleep(0.2)
        text = await who.shown()
        assert "RTL (autopilot)" in text.splitlines()[0]
        about = kept_whole(engine, tmp_path)
        assert [run["ending"] for run in about["runs"]] == ["link lost"]
        assert "0 of 2 runs kept, 0 blocks missing" in engine.state().said
        print("\n".join(f"  | {line.rstrip()}" for line in text.splitlines()))


@pytest.mark.realtime
async def study_link_lost_while_a_run_waits_ready(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What was ready is called off, and asked for anew."""
    monkeypatch.chdir(tmp_path)
    print("\nlink lost for 6 s while a run waits ready")
    async with flown_over_a_radio(tmp_path, primary=False) as (who, engine, radio):
        await who.press("r")
        await who.shows("READY:")
        cut_at = await lose(who, engine, radio)
        await until(lambda: engine.state().stage is not Stage.READY, 1)
        await who.press("s")
        text = await who.shown()
        assert "READY:" not in text
        print("\n".join(f"  | {line.rstrip()}" for line in text.splitlines()))
        await asyncio.sleep(cut_at + 6 - time.monotonic())
        radio.cut = False
        found_at = time.monotonic()
        await until(lambda: not engine.state().lost and engine.state().stage is Stage.IDLE)
        print(f"  over {time.monotonic() - found_at:.1f} s after it was found")
        for _ in range(10):
            assert engine.state().stage is Stage.IDLE
            assert engine.state().vehicle.mode_name == "Stabilize"
            await asyncio.sleep(0.2)
        text = await who.shows("link was lost", "parameters stay in the", "R makes the first run ready")
        print("\n".join(f"  | {line.rstrip()}" for line in text.splitlines()))
        about = kept_whole(engine, tmp_path)
        assert [run["verdict"] for run in about["runs"]] in ([], [None])

        await who.press("r")  # and now it flies
        await who.shows("READY:")
        await who.press("s")
        await who.shows("SystemID (tippath)")
        await who.press("f12")
        await until(lambda: engine.state().stage is Stage.IDLE)
        assert engine.state().vehicle.mode_name == "Stabilize"
        kept_whole(engine, tmp_path)


# ------------------------------------------------------------------------------------------- apps that end in mid-chirp


IN_ITS_TERMINAL = """\
import fcntl, os, sys, termios
fcntl.ioctl(0, termios.TIOCSCTTY, 0)  # so that its end is heard as SIGHUP
os.execv(sys.executable, [sys.executable, *sys.argv[1:]])
"""


class Terminal:
    """`tippath fly` in a terminal of its own."""

    def __init__(self, folder: Path, *words: str) -> None:
        self._near, far = pty.openpty()
        fcntl.ioctl(far, termios.TIOCSWINSZ, struct.pack("HHHH", 24, 80, 0, 0))
        self.process = subprocess.Popen(
            [sys.executable, "-c", IN_ITS_TERMINAL, "-m", "gcs.cli", "fly", *words, "--no-bell"],
            cwd=folder,
            stdin=far,
            stdout=far,
            stderr=far,
            env={**os.environ, "TERM": "xterm-256color", "COLUMNS": "80", "LINES": "24"},
            start_new_session=True,
        )
        os.close(far)
        self._said = b""
        self._thread = threading.Thread(target=self._listen, daemon=True)
        self._thread.start()

    def _listen(self) -> None:
        with contextlib.suppress(OSError):  # the terminal's end
            while data := os.read(self._near, 65536):
                self._said += data

    def waits_for(self, word: str, within_s: float = 20.0) -> None:
        """Until it was written."""
        end = time.monotonic() + within_s
        while word not in self.said:
            assert self.process.poll() is None, self.said[-2000:]
            assert time.monotonic() < end, f"{word} was not written: {self.said[-2000:]}"
            time.sleep(0.05)

    @property
    def said(self) -> str:
        """All that was written, without what steers a terminal."""
        return re.sub(
            r"\x1b(\[[0-9;?<>=]*[A-Za-z]|[PX^_\]].*?(\x07|\x1b\\\\)|.)", "", self._said.decode("utf-8", "replace")
        )

    def press(self, keys: str) -> None:
        os.write(self._near, keys.encode())

    def close(self) -> None:
        """The terminal is closed, and with it, at last, the process."""
        self.hang_up()
        if self.process.poll() is None:
            self.process.kill()
        self.process.wait(10)
        self._thread.join(5)

    def hang_up(self) -> None:
        if self._near >= 0:
            os.close(self._near)
            self._near = -1


@pytest.mark.realtime
@pytest.mark.parametrize("how", ["q, y", "ctrl-c, y", "SIGTERM", "the terminal is closed"])
def study_the_app_ends_in_mid_chirp(tmp_path: Path, how: str) -> None:
    """The vehicle is another process: it is asked afterwards, by another session."""
    (tmp_path / "one.toml").write_text(ONE_CHIRP)
    with SimulatedVehicle("hover-ideal", tmp_path / "vehicle", seed=3) as vehicle:
        terminal = Terminal(tmp_path, "--connect", vehicle.ground_link, "--card", "one.toml")
        try:
            terminal.waits_for("R makes the first run ready")
            terminal.press("r")
            terminal.waits_for("READY:")
            terminal.press("s")
            terminal.waits_for("SystemID (tippath)")
            time.sleep(3.0)
            began = time.monotonic()
            match how:
                case "q, y":
                    terminal.press("q")
                    terminal.waits_for("Quit?")
                    terminal.press("y")
                case "ctrl-c, y":
                    terminal.press("\x03")
                    terminal.waits_for("Quit?")
                    terminal.press("y")
                case "the terminal is closed":
                    terminal.hang_up()
                case _:
                    terminal.process.send_signal(signal.Signals[how])
            status = terminal.process.wait(25)
            took = time.monotonic() - began
            said = terminal.said
        finally:
            terminal.close()
        with Session.open(vehicle.ground_link) as session:
            snapshot = session.snapshot()
        print(
            f"\n{how} in mid-chirp: ended after {took:.1f} s, status {status}, the vehicle flies {snapshot.mode_name}"
        )
        assert (snapshot.mode_name, snapshot.armed) == ("Stabilize", True)
    assert "Traceback" not in said
    flight = tmp_path / "flight-0001"
    about = json.loads((flight / "flight.json").read_text())
    assert [run["ending"] for run in about["runs"]] == ["aborted"]
    assert about["missing_blocks"] == 0
    log = (flight / "flight.BIN").read_bytes()
    assert log in [path.read_bytes() for path in (tmp_path / "vehicle").glob("*.BIN")]
