"""Ground stations that nobody here wrote: MAVProxy and MAVSDK, installed beside the pinned packages, not among them.

They go into `peers` inside this Python's environment, once, without what only their windows need; `make setup` and
`make clean` take them away with it. TIPPATH_PEERS names another Python that has them.
"""

from __future__ import annotations

import contextlib
import inspect
import json
import os
import queue
import re
import subprocess
import sys
import threading
import time
import venv
from collections.abc import Callable
from pathlib import Path
from typing import Any

PINS = (
    *("MAVProxy==1.8.75", "mavsdk==4.1.0"),
    *("pymavlink==2.4.50", "pyserial==3.5", "numpy==2.4.6", "lxml==6.1.3", "fastcrc==0.5.0"),
)
INSTALL_S = 300.0


class MissingError(Exception):
    """They cannot be had here; the message says why."""


def peers_python() -> Path:
    """A Python that has both, installed now where it is not there yet. Raises MissingError."""
    named = os.environ.get("TIPPATH_PEERS")
    python = Path(named) if named else _installed(Path(sys.prefix) / "peers")
    has = subprocess.run([python, "-c", "import MAVProxy, mavsdk"], capture_output=True, text=True, check=False)
    if has.returncode:
        raise MissingError(f"{python} lacks MAVProxy or MAVSDK: {has.stderr.strip().splitlines()[-1]}")
    return python


def _installed(home: Path) -> Path:
    folder, name = ("Scripts", "python.exe") if os.name == "nt" else ("bin", "python")
    python, stamp = home / folder / name, home / "pins.txt"
    if stamp.exists() and stamp.read_text().split() == list(PINS):
        return python
    try:
        venv.create(home, clear=True, with_pip=True)
        pip: list[str | Path] = [
            python,
            "-m",
            "pip",
            "install",
            "--quiet",
            "--disable-pip-version-check",
            "--no-deps",
            *PINS,
        ]
        ran = subprocess.run(pip, capture_output=True, text=True, timeout=INSTALL_S, check=False)
    except (OSError, subprocess.SubprocessError) as error:
        raise MissingError(f"MAVProxy and MAVSDK cannot be installed in {home}: {error}") from error
    if ran.returncode:
        why = (ran.stderr.strip().splitlines() or ["pip failed"])[-1]
        raise MissingError(f"MAVProxy and MAVSDK cannot be installed in {home}: {why}")
    stamp.write_text("\n".join(PINS))
    return python


class MavProxy:
    """MAVProxy without a window: lines go in, what it prints comes out."""

    def __init__(self, python: Path, link: str, folder: Path, *settings: str) -> None:
        """It connects to LINK and keeps its files in `folder`. `settings` are said first."""
        words = ["-u", str(python.with_name("mavproxy.py")), f"--master={link}", f"--state-basedir={folder}"]
        self._process = subprocess.Popen(
            [python, *words, *(f"--cmd={setting}" for setting in settings)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            cwd=folder,
        )
        self._lines: queue.Queue[str] = queue.Queue()
        self.printed = ""
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def __enter__(self) -> MavProxy:
        return self

    def __exit__(self, *_: object) -> None:
        self._process.kill()
        self._reader.join(5.0)  # what is printed ends with the process
        with contextlib.suppress(OSError):  # a line that it did not take
            self._process.communicate()

    def _read(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            self._lines.put(line)

    def say(self, line: str) -> None:
        assert self._process.stdin is not None
        self._process.stdin.write(line + "\n")
        self._process.stdin.flush()

    def until(self, pattern: str, patience_s: float = 30.0) -> re.Match[str]:
        """The first line from here on that has it. Raises TimeoutError with what was printed instead."""
        end = time.monotonic() + patience_s
        while (left_s := end - time.monotonic()) > 0:
            try:
                line = self._lines.get(timeout=left_s)
            except queue.Empty:
                break
            self.printed += line
            if match := re.search(pattern, line):
                return match
        raise TimeoutError(f"{pattern} did not come in {patience_s:.0f} s:\n{self.printed[-2000:]}")


def with_peer(python: Path, program: Callable[..., None], *words: str, patience_s: float = 90.0) -> Any:
    """What the program prints as JSON; another Python runs it, alone. Raises subprocess.SubprocessError."""
    source = f"{inspect.getsource(program)}\n{program.__name__}(*{words!r})"
    ran = subprocess.run([python, "-c", source], capture_output=True, text=True, timeout=patience_s, check=True)
    lines = ran.stdout.splitlines()
    if not lines:
        raise subprocess.SubprocessError(ran.stderr)
    return json.loads(lines[-1])


def mavsdk_logs(link: str, number: str, target: str) -> None:
    """The logs listed, entry `number` (from 0) fetched: sizes, why it ended, seconds."""
    import json
    import os
    import threading
    import time

    from mavsdk import ComponentType, Configuration, Mavsdk  # type: ignore[import-not-found, unused-ignore]
    from mavsdk.plugins.log_files import LogFiles  # type: ignore[import-not-found, unused-ignore]

    sdk = Mavsdk(Configuration.create_with_component_type(ComponentType.GROUND_STATION))
    sdk.add_any_connection(link)
    files = LogFiles(sdk.first_autopilot(10.0))
    entries = files.get_entries()
    over, why = threading.Event(), []

    def told(result: object, *_: object) -> None:
        if getattr(result, "name", "") != "NEXT":
            why.append(getattr(result, "name", str(result)))
            over.set()

    began = time.monotonic()
    files.download_log_file_async(entries[int(number)], target, told)
    over.wait(120.0)
    seconds = time.monotonic() - began
    print(json.dumps({"sizes": [entry.size_bytes for entry in entries], "ended": why, "seconds": seconds}), flush=True)
    os._exit(0)


def mavsdk_files(link: str, path: str, folder: str) -> None:
    """A file fetched by MAVFTP, and all parameters: the folder `logs`, why it ended, seconds, values by name."""
    import json
    import os
    import threading
    import time

    from mavsdk import ComponentType, Configuration, Mavsdk  # type: ignore[import-not-found, unused-ignore]
    from mavsdk.plugins.ftp import Ftp  # type: ignore[import-not-found, unused-ignore]
    from mavsdk.plugins.param import Param  # type: ignore[import-not-found, unused-ignore]

    sdk = Mavsdk(Configuration.create_with_component_type(ComponentType.GROUND_STATION))
    sdk.add_any_connection(link)
    system = sdk.first_autopilot(10.0)
    files = Ftp(system)
    listed = [entry.name for entry in files.list_directory("logs").entries]
    over, why = threading.Event(), []

    def told(result: object, *_: object) -> None:
        if getattr(result, "name", "") != "NEXT":
            why.append(getattr(result, "name", str(result)))
            over.set()

    began = time.monotonic()
    files.download_async(path, folder, True, told)
    over.wait(120.0)
    seconds = time.monotonic() - began
    every = Param(system).get_all_params()
    values = {each.name: each.value for each in (*every.int_params, *every.float_params)}
    print(json.dumps({"listed": listed, "ended": why, "seconds": seconds, "values": values}), flush=True)
    os._exit(0)
