"""The app while it thinks: frames a second and key to screen while a diagnosis runs, and changes of screen, in a pty.

The diagnosis is of 64,000 samples and goes on for as long as is measured; the app draws its strips beside it, as
in flight. `make bench` prints the figures, beside the same app that has nothing to think about; nothing asserts a time.

As a program: `bench_alive.py WHAT SECONDS OUT`, drawn on its own terminal.
"""

from __future__ import annotations

import json
import os
import sys
import threading
from pathlib import Path
from typing import Any

from benchmarks.bench_screen import FRAMES_PER_S, Fake, Feed, measured, run, said

SCREENS = b"3456789245627849"
"""Keys: every screen, in no order."""


def bench_screens_while_a_diagnosis_runs(tmp_path: Path) -> None:
    """Strips at 30 frames/s, and changes of screen, alone and beside a diagnosis."""
    print()
    found: dict[str, dict[str, Any]] = {}
    for what in ("alone", "diagnosing"):
        found[what] = run(what, tmp_path / f"{what}.json", seconds=12.0, keys=b"r", program=__file__)
        print(said(f"{what}, R pressed", found[what]))
        screens = run(what, tmp_path / f"{what}-screens.json", seconds=12.0, keys=SCREENS, program=__file__)
        print(said(f"{what}, screens changed", screens))
    frames = [found[what]["frames"] / found[what]["seconds"] for what in ("diagnosing", "alone")]
    asked = found["diagnosing"]["asked"]
    print(f"  beside a diagnosis {frames[0] / frames[1]:.2f} of the frames; heard of it {asked} times")


def think(found: dict[str, Any], thinking: threading.Event) -> None:
    """Diagnose the same flight again and again, as the desk does it: in a thread, heard of at every step."""
    from flying import CHIRP, PITCH, ROLL, flown

    from gcs.analysis.diagnosis import diagnose_fit
    from gcs.analysis.fits import identify_flight
    from gcs.logs import ingest
    from sysid.diagnose.progress import Progress, Ranking

    log = Path(found["folder"]) / "flight.BIN"
    log.write_bytes(flown("hover", tuple((CHIRP, axis, 0.1, 30.0) for axis in (ROLL, ROLL, PITCH, PITCH))))
    records = [one.record for one in ingest([log]).runs if one.record is not None]
    fit = identify_flight(records, records[1:2]).tpp
    ranking = Ranking()

    def hear(news: Progress) -> None:
        nonlocal ranking
        ranking = ranking.after(news)
        found["asked"] += 1

    thinking.set()
    while True:
        diagnose_fit(fit, records, say=hear)


def main(what: str, seconds: float, out: Path) -> None:
    from gcs.tui import app as module

    feed = Feed()
    found: dict[str, Any] = {"frames": 0, "asked": 0, "folder": str(out.parent)}
    thinking = threading.Event()
    if what == "diagnosing":
        threading.Thread(target=think, args=(found, thinking), daemon=True).start()
        thinking.wait()
    threading.Thread(target=feed.live, daemon=True).start()
    module.LOOKS_PER_S = FRAMES_PER_S
    engine: Any = Fake(feed)

    class Measured(module.TippathApp):
        CSS_PATH = str(Path(module.__file__).with_name("tippath.tcss"))

        async def on_mount(self) -> None:  # Textual calls the app's own besides
            measured(self, seconds, found)

        async def action_screen(self, name: str) -> None:
            engine.count += 1
            await super().action_screen(name)

    Measured(engine, bell=False).run()
    feed.stop.set()
    out.write_text(json.dumps(found))
    os._exit(0)


if __name__ == "__main__":
    main(sys.argv[1], float(sys.argv[2]), Path(sys.argv[3]))
