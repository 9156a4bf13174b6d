"""The live strips in a real terminal (a pty, 120x40): frames, share of a core, key to screen, growth in an hour.

Three strips of 2,000 points are drawn at 30 frames/s while 1,000 messages/s are decoded and kept, by our widget and by
two peers in the same way; then the app itself. The terminal's side is the parent, which writes keys and waits until
what they change has come out. `make bench` prints the figures; nothing here asserts a time.

As a program: `bench_screen.py WHAT SECONDS OUT`, drawn on its own terminal.
"""

from __future__ import annotations

import fcntl
import gc
import importlib.util
import json
import math
import os
import pty
import select
import struct
import subprocess
import sys
import termios
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

COLUMNS, ROWS = 120, 40
SECONDS = 10.0
FRAMES_PER_S = 30.0
MESSAGES_PER_S = 1000
SPAN_S = 2.0
"""2,000 points."""
STRIPS = (("p", "p"), ("q", "q"), ("δx", "delta_x"))
KEY_EVERY_S = 0.06
KEYS_AFTER_S = 5.0
HOUR_S = 3600.0
_RATE = struct.Struct("<2sBQffff")


# ------------------------------------------------------------------------------------------------ the terminal's side


def run(what: str, out: Path, seconds: float = SECONDS, keys: bytes = b"", program: str = __file__) -> dict[str, Any]:
    """Run this file, or another that is used so, as a program in a pty; what it measured, and key to screen in ms.

    keys: typed in turn, the n-th answered by `key n.` on the screen.
    """
    parent, child = pty.openpty()
    fcntl.ioctl(child, termios.TIOCSWINSZ, struct.pack("HHHH", ROWS, COLUMNS, 0, 0))
    root = Path(__file__).parents[2]
    environment = os.environ | {
        "TERM": "xterm-256color",
        "COLORTERM": "truecolor",
        "PYTHONPATH": f"{root}:{root}/tests",
    }
    environment.pop("NO_COLOR", None)
    process = subprocess.Popen(
        [sys.executable, program, what, str(seconds), str(out)],
        stdin=child,
        stdout=child,
        stderr=child,
        env=environment,
        start_new_session=True,
        close_fds=True,
    )
    os.close(child)
    waits_ms: list[float] = []
    rng = np.random.default_rng(1)
    sent: tuple[float, bytes] | None = None
    typed = 0
    seen = b""
    shown = 0
    started, next_key = time.monotonic(), math.inf
    while process.poll() is None:
        ready, _, _ = select.select([parent], [], [], 0.002)
        if ready:
            try:
                data = os.read(parent, 1 << 16)
            except OSError:
                break
            if not shown:  # the first frame; screens are made in the first seconds
                started = time.monotonic()
                next_key = started + KEYS_AFTER_S
            shown += len(data)
            seen = (seen + data)[-200_000:]
            if sent is not None and sent[1] in seen:
                waits_ms.append(1000 * (time.monotonic() - sent[0]))
                sent = None
                next_key = time.monotonic() + KEY_EVERY_S * (0.5 + rng.random())
        now = time.monotonic()
        if sent is not None and now - sent[0] > 2.0:
            waits_ms.append(2000.0)
            sent = None
        if keys and sent is None and now > next_key and now - started < KEYS_AFTER_S + seconds:
            seen = b""
            sent = time.monotonic(), f"key {typed}.".encode()
            os.write(parent, keys[typed % len(keys)].to_bytes(1, "big"))
            typed += 1
    process.wait(timeout=60)
    os.close(parent)
    assert out.exists(), seen[-2000:].decode(errors="replace")
    found: dict[str, Any] = json.loads(out.read_text())
    found["kB/s"] = shown / 1000 / seconds
    if waits_ms:
        found |= {
            "keys": len(waits_ms),
            "p50 ms": float(np.median(waits_ms)),
            "p99 ms": float(np.quantile(waits_ms, 0.99)),
        }
    return found


def said(name: str, found: dict[str, Any], alone: float = 0.0) -> str:
    """One line of the table; alone: the messages' own share of a core."""
    frames, share = found["frames"] / found["seconds"], found["cpu"] / found["seconds"]
    each = 1000 * (share - alone) / max(frames, 0.1)
    keys = ""
    if "p99 ms" in found:
        keys = f"   key to screen {found['p50 ms']:.0f} ms, 99 % within {found['p99 ms']:.0f} ms ({found['keys']} keys)"
    return (
        f"  {name:32} {frames:5.1f} frames/s   {100 * share:4.0f} % of a core   {each:6.1f} ms a frame"
        f"   {found['kB/s']:4.0f} kB/s{keys}"
    )


def bench_strips_against_peers(tmp_path: Path) -> None:
    """Three strips of 2,000 points."""
    alone = run("feed", tmp_path / "feed.json")
    own = alone["cpu"] / alone["seconds"]
    print(
        f"\n{ROWS} rows of {COLUMNS}, {len(STRIPS)} strips of {int(SPAN_S * MESSAGES_PER_S)} points, wanted 30 frames/s"
    )
    print(f"  {MESSAGES_PER_S} messages/s decoded and kept, a line of text drawn: {100 * own:.0f} % of a core")
    figures = {}
    for what, module in (("ours", "textual"), ("textual-plot", "textual_plot"), ("textual-plotext", "textual_plotext")):
        if importlib.util.find_spec(module) is None:
            print(f"  {what}: not installed (pip install -e '.[bench]' has it)")
            continue
        found = figures[what] = run(what, tmp_path / f"{what}.json", keys=b"x")
        print(said(what, found, own))
    for what, found in figures.items():
        if what != "ours":
            frames = figures["ours"]["frames"] / found["frames"]
            work = (figures["ours"]["cpu"] / figures["ours"]["frames"]) / (found["cpu"] / found["frames"])
            print(f"  ours beside {what}: {frames:.1f} times the frames, {work:.2f} of the processor time a frame")


def bench_app_under_load(tmp_path: Path) -> None:
    """The app on its Fly screen, four strips of 20 s at 1,000 samples/s."""
    print()
    for what in ("app", "app at 30"):
        found = run(what, tmp_path / f"{what}.json", keys=b"r")
        print(said(f"{what}, R pressed", found))
    found = run("app at 30", tmp_path / "screens.json", keys=b"3452")
    print(said("app at 30, screens changed", found))


def bench_an_hour_of_recording(tmp_path: Path) -> None:
    """Memory, an hour's samples through the ring and the app as fast as they go."""
    found = run("hour", tmp_path / "hour.json", seconds=600.0)
    print(
        f"\n{HOUR_S / 60:.0f} minutes at {MESSAGES_PER_S}/s in {found['seconds']:.0f} s:"
        f" {found['early MB']:.1f} MB after 5 minutes, {found['late MB']:.1f} MB at the end,"
        f" {found['frames']} frames drawn"
    )


# ------------------------------------------------------------------------------------------------ the app's side


class Feed:
    """Messages as they come from a link, decoded, and the log's records in them kept for the strips."""

    def __init__(self) -> None:
        from pymavlink.dialects.v20 import ardupilotmega as dialect

        from gcs.flight.live import LiveLog

        self.log = LiveLog(keep_s=60.0, rate_hz=MESSAGES_PER_S)
        sender = dialect.MAVLink(None, srcSystem=1, srcComponent=1)
        self.receiver = dialect.MAVLink(None)
        self.frame = sender.attitude_encode(1, 0.1, 0.2, 0.3, 0.01, 0.02, 0.03).pack(sender)
        self.number = 0
        self.kept = 0
        self.log.feed(0, _format("RATE", 200, "Qffff", "TimeUS,R,P,ROut,POut"))
        self.stop = threading.Event()

    def record(self) -> bytes:
        t = self.kept / MESSAGES_PER_S
        self.kept += 1
        f = 0.5 + 0.3 * (t % 30.0)
        noise = 3.0 * ((self.kept * 7919) % 101 / 101 - 0.5)
        p, q = 20 * np.sin(2 * np.pi * f * t) + noise, 25 * np.cos(2 * np.pi * f * t) - noise
        return _RATE.pack(b"\xa3\x95", 200, int(1e6 * t), p, q, 0.1 * np.sin(2 * np.pi * f * t), 0.0)

    def arrive(self) -> None:
        """One message."""
        for message in self.receiver.parse_buffer(self.frame) or ():
            message.to_dict()
        self.number += 1
        self.log.feed(self.number, self.record())

    def live(self) -> None:
        """1,000 a second until stopped."""
        start = time.monotonic()
        count = 0
        while not self.stop.wait(0.004):
            due = int((time.monotonic() - start) * MESSAGES_PER_S)
            while count < due:
                self.arrive()
                count += 1

    def fast(self, count: int, told: Callable[[int], None]) -> None:
        """So many as fast as they go; not decoded, only kept."""
        for i in range(0, count, 100):
            self.number += 1
            self.log.feed(self.number, b"".join(self.record() for _ in range(100)))
            if i % 1000 == 0:
                told(i)
                time.sleep(0.0005)
            if self.stop.is_set():
                return


def _format(name: str, kind: int, codes: str, labels: str) -> bytes:
    size = 3 + struct.calcsize("<" + codes)
    return struct.pack("<2sBBB4s16s64s", b"\xa3\x95", 128, kind, size, name.encode(), codes.encode(), labels.encode())


def resident_mb() -> float:
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6


def strips_app(what: str, feed: Feed, seconds: float, found: dict[str, Any]) -> Any:
    """Three strips by one of the widgets, and a line that answers keys."""
    from textual.app import App
    from textual.widgets import Static

    draw: Callable[[], None] = lambda: None  # noqa: E731
    widgets: list[Any] = []
    if what == "ours":
        from gcs.tui.plot import Panel, TimePlot
        from gcs.tui.widgets.traces import Traces

        traces = Traces("braille", "traces")
        widgets = [traces]

        def draw() -> None:
            window = feed.log.window(SPAN_S)
            panels = tuple(Panel(name=name, x=window.t, line=getattr(window, field)) for name, field in STRIPS)
            traces.show(TimePlot(panels=panels, span_s=SPAN_S))

    elif what == "textual-plot":
        from textual_plot import HiResMode, PlotWidget

        widgets = [PlotWidget(allow_pan_and_zoom=False) for _ in STRIPS]

        def draw() -> None:
            window = feed.log.window(SPAN_S)
            for widget, (_, field) in zip(widgets, STRIPS, strict=True):
                widget.clear()
                widget.plot(window.t, getattr(window, field), hires_mode=HiResMode.BRAILLE)

    elif what == "textual-plotext":
        from textual_plotext import PlotextPlot

        widgets = [PlotextPlot() for _ in STRIPS]

        def draw() -> None:
            window = feed.log.window(SPAN_S)
            t = window.t.tolist()
            for widget, (_, field) in zip(widgets, STRIPS, strict=True):
                widget.plt.clear_data()
                widget.plt.plot(t, getattr(window, field).tolist(), marker="braille")
                widget.refresh()

    class Strips(App[None]):
        CSS = "Screen { layout: vertical; } #answer { height: 1; } Screen > * { height: 1fr; }"

        def compose(self) -> Any:
            yield Static("", id="answer")
            yield from widgets

        def on_mount(self) -> None:
            self.count = 0
            self.drawn = False
            # what stays is not looked through again: a full collection takes 100 ms, for every one of the peers
            gc.collect()
            gc.freeze()
            self.set_interval(1 / FRAMES_PER_S, self.tick)
            measured(self, seconds, found)

        def tick(self) -> None:
            if feed.log.window(SPAN_S).t.size:
                draw()
                self.drawn = True

        def on_key(self, event: Any) -> None:
            if event.key == "x":
                self.query_one("#answer", Static).update(f"key {self.count}.")
                self.count += 1

    return Strips()


def measured(app: Any, seconds: float, found: dict[str, Any]) -> None:
    """Count what is written to the terminal from the second second on, and leave at the end."""
    frames = 0
    display = app.post_display_hook

    def hook() -> None:
        nonlocal frames
        # where the strips say so, what only answers a key is no frame
        frames += getattr(app, "drawn", True)
        if hasattr(app, "drawn"):
            app.drawn = False
        display()

    app.post_display_hook = hook
    state: dict[str, float] = {}

    def begin() -> None:
        state.update(frames=frames, cpu=time.process_time(), at=time.monotonic())

    def end() -> None:
        found.update(
            frames=frames - state["frames"],
            cpu=time.process_time() - state["cpu"],
            seconds=time.monotonic() - state["at"],
        )
        app.exit()

    app.set_timer(KEYS_AFTER_S - 1.0, begin)
    app.set_timer(KEYS_AFTER_S + seconds, end)


class Fake:
    """An engine that shows the feed, and answers R in words."""

    def __init__(self, feed: Feed) -> None:
        from gcs.tui.state import Mark, Progress, RunView, Stage, State
        from gcs.vehicle.snapshot import VehicleSnapshot

        self.feed = feed
        self.count = 0
        vehicle = VehicleSnapshot(
            system=1,
            component=1,
            link_age_s=0.1,
            lost=False,
            mode=25,
            mode_name="SystemID",
            armed=True,
            heartbeats=3,
            rpm=1648.0,
        )
        runs = tuple(
            RunView(number=i, label=f"roll chirp {i}/8", numbers="0.5-10 Hz  30 s  A 0.10", kind=Mark.NEXT)
            for i in range(1, 9)
        )
        self.make = lambda said: State(
            link="udpin:127.0.0.1:14550",
            plant=None,
            vehicle=vehicle,
            stage=Stage.IDLE,
            card="hover",
            runs=runs,
            progress=Progress(self.feed.kept / MESSAGES_PER_S, 30.0, 4.6, "Table 1"),
            samples=self.feed.kept,
            said=said,
        )

    def state(self) -> Any:
        return self.make(f"key {self.count - 1}.")

    def window(self, last_s: float) -> Any:
        return self.feed.log.window(last_s)

    def ready(self) -> None:
        self.count += 1

    def __getattr__(self, name: str) -> Callable[..., None]:
        return lambda *_: None


def whole_app(what: str, feed: Feed, seconds: float, found: dict[str, Any]) -> Any:
    """The app itself on a fake engine."""
    from gcs.tui import app as module

    if what != "app":
        module.LOOKS_PER_S = FRAMES_PER_S
    engine = Fake(feed)

    class Measured(module.TippathApp):
        CSS_PATH = str(Path(module.__file__).with_name("tippath.tcss"))

        async def on_mount(self) -> None:  # Textual calls the app's own besides
            if what == "hour":
                threading.Thread(target=hour, args=(self,), daemon=True).start()
            measured(self, seconds, found)

        async def action_screen(self, name: str) -> None:
            engine.count += 1
            await super().action_screen(name)

    def hour(app: Any) -> None:
        count = int(HOUR_S * MESSAGES_PER_S)
        start = time.monotonic()

        def told(done: int) -> None:
            if done <= count // 12:
                found["early MB"] = resident_mb()
            found["late MB"] = resident_mb()

        feed.fast(count, told)
        found["seconds"] = time.monotonic() - start
        app.call_from_thread(app.exit)

    return Measured(engine, bell=False)


def main(what: str, seconds: float, out: Path) -> None:
    feed = Feed()
    found: dict[str, Any] = {"frames": 0}
    if what != "hour":
        threading.Thread(target=feed.live, daemon=True).start()
    make = whole_app if what in ("app", "app at 30", "hour") else strips_app
    app = make(what, feed, seconds, found)
    frames = app.post_display_hook
    if what == "hour":

        def hook() -> None:
            found["frames"] += 1
            frames()

        app.post_display_hook = hook
    app.run()
    feed.stop.set()
    out.write_text(json.dumps(found))
    os._exit(0)


if __name__ == "__main__":
    main(sys.argv[1], float(sys.argv[2]), Path(sys.argv[3]))
