"""Files that were changed by chance or on purpose, of every kind that is no log: read, or refused in a sentence.

Logs are damaged beside the tests of their readers, in `tests/gcs/logs`.
"""

from __future__ import annotations

import json
import random
import tomllib
import zipfile
from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib import resources
from pathlib import Path
from typing import Any

import msgspec
import pytest
from damaged_documents import FILES, bytes_changed, changed
from flown_folder import fly_folder
from flying import TWO_CHIRPS
from injuries import COUNTS, bounded

from gcs.analysis.fits import load_vehicle
from gcs.cards.maneuver import load_card
from gcs.cli import main
from gcs.errors import TippathError
from gcs.flight.folder import FlightFolder
from gcs.flight.gains import load_gains
from gcs.link.key_file import KeptStamps, drawn, read_key, write_key
from gcs.logs import cache, ingest
from gcs.logs.profile.profiles import load as load_log_profile
from gcs.logs.runs.verdicts import with_verdicts
from gcs.vehicle.profile import load_profile as load_vehicle_profile
from sitl.hidden import plant_one
from sitl.hidden.seal import seal_answer
from sysid.errors import SysidError
from sysid.fit.result import Fit


@dataclass(frozen=True)
class Flight:
    """A small flight and what was made of it."""

    folder: Path
    fit: Path
    gains: Path
    diagnosis: Path


@pytest.fixture(scope="module")
def flight(tmp_path_factory: pytest.TempPathFactory) -> Flight:
    home = tmp_path_factory.mktemp("hostile")
    folder = fly_folder(home / "flight", None, TWO_CHIRPS).path
    made = Flight(folder, home / "fit.json", home / "gains.json", home / "diagnosis.json")
    assert main(["fit", str(folder), "--model", "tpp", "-o", str(made.fit)]) == 0
    assert main(["design", str(made.fit), "-o", str(made.gains)]) == 0
    made.diagnosis.write_text(
        json.dumps(
            {
                "format": "tippath.diagnosis/1",
                "verdict": "missing",
                "effect": "servo_lag",
                "indistinguishable": ["gyro_lag"],
                "equivalent": {"servo_lag": ["motor_lag"]},
                "candidates": [{"effect": "servo_lag", "parameters": {"tau_s": 0.02}}],
            }
        )
    )
    return made


@dataclass(frozen=True)
class Kind:
    """A kind of file: where it lies, what reads it."""

    path: Path
    ask: Callable[[], object]


def by_command(*words: object) -> Callable[[], object]:
    def ask() -> object:
        assert main([str(word) for word in words]) in (0, 1, 2)
        return None

    return ask


def kinds(flight: Flight, folder: Path) -> dict[str, Kind]:
    """Sound files of every kind in this folder, each with what reads it."""

    def put(name: str, content: bytes) -> Path:
        path = folder / name
        path.parent.mkdir(exist_ok=True)
        path.write_bytes(content)
        return path

    log = put("flight/flight.BIN", (flight.folder / "flight.BIN").read_bytes())
    runs = ingest([log]).runs
    about = put("flight/flight.json", (flight.folder / "flight.json").read_bytes())
    of_flight = FlightFolder(about.parent)
    of_flight.rename("windy")
    of_flight.note(datetime(2026, 1, 1, tzinfo=UTC), "gusts")
    of_flight.audit(datetime(2026, 1, 1, tzinfo=UTC), "fitted", "tippath fit")

    def ask_flight() -> object:
        return of_flight.name, of_flight.notes(), with_verdicts(runs, log), of_flight.runs()

    fit = put("fit.json", flight.fit.read_bytes())
    record = folder / "run.npz"
    assert runs[0].record is not None
    runs[0].record.window(runs[0].record.t[0], runs[0].record.t[0] + 1).save(record)
    answer = seal_answer(plant_one("servo_lag", 1), 5, put("sealed/d.json", flight.diagnosis.read_bytes()).parent)[0]
    kept = folder / "kept.runs"
    cache.save(kept, cache.Content(ingest([log]).sources[0], runs[:1]))
    assert cache.load(kept) is not None
    key = folder / "one.key"
    write_key(drawn(), key)
    KeptStamps(key).keep(1 << 40)
    bundled = resources.files("gcs")
    card = put("card.toml", (bundled / "cards" / "hover.toml").read_bytes())
    log_profile = put("log.toml", (bundled / "logs" / "profile" / "bundled" / "px4.toml").read_bytes())
    vehicle = put("vehicle.toml", (bundled / "vehicle" / "profiles" / "arducopter.toml").read_bytes())
    measured = put("measured.toml", b"k_beta = 0.5\nmass = 1.2\narm = 0.1\nI_xx = 0.01\n")
    gains = put("gains.json", flight.gains.read_bytes())
    return {
        "fit": Kind(
            fit, lambda: print(json.dumps(Fit.load(fit).to_json(fit.parent)))
        ),  # `design` takes half a second of each
        "gains": Kind(gains, lambda: load_gains(gains)),
        "card": Kind(card, lambda: load_card(str(card))),
        "log profile": Kind(log_profile, lambda: load_log_profile(log_profile)),
        "vehicle profile": Kind(vehicle, lambda: load_vehicle_profile(str(vehicle))),
        "vehicle file": Kind(measured, lambda: load_vehicle(measured)),
        "flight.json": Kind(about, ask_flight),
        "audit.jsonl": Kind(of_flight.audit_file, of_flight.audited),
        "record": Kind(record, by_command("ingest", record)),
        "cache": Kind(kept, lambda: cache.load(kept)),
        "key": Kind(key, lambda: read_key(key)),
        "key state": Kind(key.with_name("one.key.state"), lambda: KeptStamps(key).at_least()),
        "sealed answer": Kind(answer, by_command("reveal", answer.parent)),
        "diagnosis": Kind(answer.parent / "d.json", by_command("reveal", answer.parent)),
    }


KINDS = (
    *("fit", "gains", "card", "log profile", "vehicle profile", "vehicle file", "flight.json", "audit.jsonl", "record"),
    *("cache", "key", "key state", "sealed answer", "diagnosis"),
)


def mutated(raw: bytes, chance: random.Random) -> bytes:
    """Bytes changed anywhere, or one value, key or entry of a document."""
    if chance.random() < 0.6:
        for parse in (json.loads, lambda text: tomllib.loads(text.decode())):
            try:
                document = parse(raw)
            except (ValueError, UnicodeDecodeError):
                continue
            return json.dumps(changed(document, chance)).encode() if parse is json.loads else toml_of(raw, chance)
    return bytes_changed(raw, chance)


def toml_of(raw: bytes, chance: random.Random) -> bytes:
    """TOML with the value of one line changed to another that TOML can say."""
    lines = raw.decode().split("\n")
    at = chance.choice([k for k, line in enumerate(lines) if "=" in line])
    values = ("true", "-1", "1e308", "nan", "-inf", '""', '"\\u001b[2J"', "[]", "{}", "[[1]]", "9" * 40, "[1, 'a']")
    lines[at] = f"{lines[at].split('=')[0]}= {chance.choice(values)}"
    return "\n".join(lines).encode()


def harmless_lines(text: str) -> bool:
    return all(line.isprintable() for line in text.replace("\t", " ").split("\n"))


@pytest.mark.parametrize("count", COUNTS)
@pytest.mark.parametrize("kind", KINDS)
def test_a_damaged_file_is_read_or_refused(
    kind: str, count: int, flight: Flight, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    asked = kinds(flight, tmp_path)[kind]
    sound, chance = asked.path.read_bytes(), random.Random(7)
    with bounded():
        asked.ask()
    files = [*FILES.values(), *(mutated(sound, chance) for _ in range(count - len(FILES)))]
    for content in files:
        asked.path.write_bytes(content)
        with bounded():
            try:
                asked.ask()
            except (TippathError, SysidError) as error:
                assert harmless_lines(str(error))  # noqa: PT017
                assert len(str(error)) < 2000  # noqa: PT017
        out, err = capsys.readouterr()
        assert harmless_lines(out + err)
        assert "Traceback" not in out + err


@pytest.mark.parametrize("damage", ["a later zip", "an open bracket"])
def test_an_archive_that_only_looks_like_a_record_is_refused(damage: str, flight: Flight, tmp_path: Path) -> None:
    """Both once ended in a traceback: of zipfile, and of numpy's reader of headers."""
    asked = kinds(flight, tmp_path)["record"]
    with zipfile.ZipFile(asked.path) as archive:
        entries = {name: archive.read(name) for name in archive.namelist()}
    with zipfile.ZipFile(asked.path, "w") as archive:
        for name, content in entries.items():
            archive.writestr(name, content.replace(b",)", b",(", 1) if damage == "an open bracket" else content)
    if damage == "a later zip":
        raw = asked.path.read_bytes()
        asked.path.write_bytes(raw.replace(b"PK\x01\x02\x14\x03\x14", b"PK\x01\x02\x14\x03\x6d"))
        assert asked.path.read_bytes() != raw
    assert main(["ingest", str(asked.path)]) == 1


def test_every_kind_is_asked(flight: Flight, tmp_path: Path) -> None:
    assert tuple(kinds(flight, tmp_path)) == KINDS


@pytest.mark.parametrize(
    "damage",
    [
        {"signs": [1]},
        {"signs": [{"name": "a", "text": "b", "seen": "yes"}]},
        {"signs": [{"name": "a", "seen": True}]},
        {"signs": "none"},
        {"noise_floor_percent": 5.0},
        {"noise_floor_percent": {"p": "much", "q": 1.0}},
        {"noise_floor_percent": {"z": 1.0}},
    ],
    ids=str,
)
def test_what_an_addition_left_in_a_fit_is_checked_before_a_report_shows_it(
    damage: dict[str, Any], flight: Flight, tmp_path: Path, tippath: Callable[..., tuple[int, str, str]]
) -> None:
    path = tmp_path / "fit.json"
    path.write_text(json.dumps(json.loads(flight.fit.read_text()) | damage))
    status, out, err = tippath("report", path, "-o", tmp_path / "r.html", "--no-diagnosis")
    assert (status, out, len(err.splitlines())) == (1, "", 1)
    assert next(iter(damage)) in err


JSON_WORDS: dict[str, tuple[Any, ...]] = {
    "compare": (),
    "design": (),
    "diagnose": (),
    "add": ("servo_lag",),
    "push": ("--connect", "udpin:127.0.0.1:1"),
    "report": ("-o", "REPORT"),
    "ingest": (),
    "response": (),
}


@pytest.mark.parametrize("command", JSON_WORDS)
@pytest.mark.parametrize("content", ["deep JSON", "deep objects", "nothing", "endless", "long number"])
def test_every_command_that_reads_json(
    command: str, content: str, tmp_path: Path, tippath: Callable[..., tuple[int, str, str]]
) -> None:
    path = tmp_path / "x.json"
    path.write_bytes(FILES[content])
    words = [tmp_path / "r.html" if word == "REPORT" else word for word in JSON_WORDS[command]]
    status, out, err = tippath(command, path, *words)
    assert (status, out) == (1, "")
    assert len(err.splitlines()) == 1
    assert msgspec.json.encode(err)  # text that is whole
