"""The first flight carried out as its page says, in real time, in an empty folder: `first_flight.py TIPPATH`.

TIPPATH is the command of an installation, of `.venv` or of a wheel's; `make docs-check` and `make wheel-check` name it.
"""

from __future__ import annotations

import re
import shlex
import subprocess
import sys
import tempfile
import time
from pathlib import Path

PAGE = Path(__file__).resolve().parents[2] / "docs" / "first-flight.md"
BLOCK = re.compile(r"^```sh ?([^\n]*)\n(.*?)^```$", re.DOTALL | re.MULTILINE)
BESIDES = ("effects --how-to", "effects servo_lag", "sweep --help", "--version")
"""What a wheel must hold beyond the page: the how-to, the catalogue, the cards."""
BREATH_S = 3.0
"""Until the vehicle in the background hovers; a sweep waits for it in any case."""


def commands() -> list[tuple[bool, list[str]]]:
    """In the page's order: whether it stays in the background, and its words."""
    return [
        ("background" in order, shlex.split(line)[1:])
        for order, text in BLOCK.findall(PAGE.read_text(encoding="utf-8"))
        for line in text.splitlines()
    ]


def main(tippath: str) -> int:
    behind: list[subprocess.Popen[str]] = []
    with tempfile.TemporaryDirectory() as folder:
        try:
            for background, words in [*commands(), *((False, line.split()) for line in BESIDES)]:
                began = time.monotonic()
                if background:
                    vehicle = subprocess.Popen([tippath, *words], cwd=folder, stdin=subprocess.PIPE, text=True)
                    behind.append(vehicle)
                    time.sleep(BREATH_S)
                    continue
                done = subprocess.run(
                    [tippath, *words], cwd=folder, capture_output=True, text=True, check=False, stdin=subprocess.DEVNULL
                )
                print(f"{time.monotonic() - began:6.1f} s  tippath {shlex.join(words)}", flush=True)
                if done.returncode != 0:
                    print(done.stdout, done.stderr)
                    return 1
        finally:
            for vehicle in behind:
                vehicle.terminate()
                vehicle.wait()
        page = Path(folder) / "report.html"
        print(f"report.html: {page.stat().st_size} bytes")
    return 0


if __name__ == "__main__":
    sys.exit(main(str(Path(sys.argv[1]).resolve())))
