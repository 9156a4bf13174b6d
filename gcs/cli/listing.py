"""What logs hold, for people and as the `tippath.runs/1` document; and the runs written as records."""

from __future__ import annotations

import itertools
import math
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from gcs.errors import TippathError, UsageError
from gcs.logs import Ingest, Run, Source
from gcs.logs.formats.csv import CsvFile
from gcs.logs.formats.csv_join import labels
from gcs.logs.formats.dataflash_table import EVENTS
from gcs.logs.opening import Opened, open_log
from gcs.logs.profile.profiles import ChannelSource
from gcs.logs.profile.proposal import FIRST_LINE, Values, propose
from gcs.logs.profile.sources import found_in
from gcs.logs.runs.health import Health, up_to_words
from gcs.logs.words import printable
from sysid.data.record import CHANNELS, REQUIRED, FloatArray

FORMAT = "tippath.runs/1"


def document(found: Ingest, written: Mapping[str, str] | None = None, *, explain: bool = False) -> dict[str, Any]:
    """The `tippath.runs/1` document; `written` maps run ids to the records' paths, `explain` adds the channels."""
    return {
        "format": FORMAT,
        "runs": [_run_entry(run, (written or {}).get(_key(run))) for run in found.runs],
        "damage": {
            path: {
                "total_bytes": damage.total_bytes,
                "skipped_bytes": damage.skipped_bytes,
                "resyncs": damage.resyncs,
                "unknown": {str(id): count for id, count in sorted(damage.unknown.items())},
                "tail_cut": damage.tail_cut,
            }
            for path, damage in found.damage.items()
        },
        "sources": [
            {
                "path": source.path,
                "sha256": source.sha256,
                "kind": source.kind,
                "profile": None if source.profile is None else source.profile.name,
                "notes": [*source.notes, *source.hints],
                "joined": None if source.joined is None else source.joined.to_json(),
                "apart": dict(source.apart),
                **(_channels(found, source) if explain else {}),
            }
            for source in found.sources
        ],
        "refused": dict(found.refused),
        "left_out": dict(found.left_out),
    }


def _channels(found: Ingest, source: Source) -> dict[str, Any]:
    have, absent = _found_and_absent(found, source)
    sources = {} if source.profile is None else source.profile.channels
    return {
        "channels": {
            name: {
                "unit": CHANNELS[name],
                "source": text,
                "scale": sources[name].scale if name in sources else 1.0,
                "offset": sources[name].offset if name in sources else 0.0,
            }
            for name, text in have.items()
        },
        "absent": absent,
        "fields": [printable(name) for name in source.fields],
    }


def _found_and_absent(found: Ingest, source: Source) -> tuple[dict[str, str], dict[str, str]]:
    """Channel -> where its values come from; channel -> why it has none."""
    its_runs = [run for run in found.runs if run.path == source.path]
    have = dict(next((run.sources for run in its_runs if run.sources), {}))
    reasons = dict(next((run.absent for run in its_runs if run.absent), {}))
    if not have and source.profile is not None:  # no run could be cut, but some of it is there
        have, reasons = found_in(source.profile, source.fields)
    return have, {
        name: reasons.get(name, "no source")
        for name in CHANNELS
        if name != "t" and name not in have and source.kind != "record"
    }


def _key(run: Run) -> str:
    return f"{run.path}\0{run.id}"


def _run_entry(run: Run, record: str | None) -> dict[str, Any]:
    return {
        "id": run.id,
        "path": run.path,
        "maneuver": run.maneuver,
        "axis": run.axis,
        "start_s": _number(run.start_s),
        "duration_s": _number(run.duration_s),
        "rate_hz": None if run.rate_hz is None else _number(run.rate_hz),
        "gaps": [[_number(start), _number(stop)] for start, stop in run.gaps],
        "usable": run.usable,
        "usable_to_hz": run.usable_to_hz,
        "reasons": list(run.reasons),
        "notes": list(run.notes),
        "rate_source": run.rate_source,
        "swept_band_hz": None if run.swept_band_hz is None else list(run.swept_band_hz),
        "excitation": None
        if run.health is None
        else {
            axis: {"command_rms": _number(command), "rate_rms_rad_s": _number(rate)}
            for axis, (command, rate) in run.health.excitation.items()
        },
        "health": None if run.health is None else _health_entry(run.health),
        "channels": dict(run.sources),
        "record": record,
    }


def _health_entry(health: Health) -> dict[str, Any]:
    together = health.input_correlation
    return {
        "jitter": _number(health.jitter),
        "clipped": dict(health.clipped),
        "saturated_share": {name: _number(share) for name, share in health.saturated_share.items()},
        "command_band_hz": {
            axis: [_number(low), _number(high)] for axis, (low, high) in health.command_band_hz.items()
        },
        "coherence": {
            axis: {
                "band_hz": [_number(one.low_hz), _number(one.high_hz)] if one.share else None,
                "share": _number(one.share),
            }
            for axis, one in health.coherent.items()
        },
        "input_correlation": None if together is None else _number(together),
        "quiet": [
            {"where": one.where, "start_s": _number(one.start_s), "duration_s": _number(one.duration_s)}
            for one in health.quiet
        ],
        "latency": [
            {
                "field": one.field,
                "against": one.against,
                "late_ms": _number(1000 * one.late_s),
                "correlation": _number(one.correlation),
            }
            for one in health.latency
        ],
    }


def _number(value: float) -> float | None:
    return round(value, 6) if math.isfinite(value) else None


def write_records(found: Ingest, folder: Path, force: bool) -> dict[str, str]:
    """Write the usable runs as NAME-1.npz, ... Returns run -> path. Raises UsageError where a file is in the way."""
    usable = [run for run in found.usable if run.record is not None]
    names = _names(usable)
    targets = {_key(run): folder / name for run, name in zip(usable, names, strict=True)}
    in_the_way = [path for path in targets.values() if path.exists()]
    if in_the_way and not force:
        raise UsageError(f"{in_the_way[0]} exists; choose another -o DIR, or --force to overwrite")
    if folder.exists() and not folder.is_dir():
        raise UsageError(f"{folder} is a file; -o takes a folder")
    try:
        if usable:
            folder.mkdir(parents=True, exist_ok=True)
        for run in usable:
            assert run.record is not None
            run.record.save(targets[_key(run)])
    except OSError as error:
        raise TippathError(f"{folder}: records cannot be written ({error.strerror or error})") from error
    return {key: str(path) for key, path in targets.items()}


def _names(runs: list[Run]) -> list[str]:
    """flight-1.npz for flight.BIN#1; with the folder's name in front where two logs share a name."""
    plain = [_stem(run) for run in runs]
    twice = {name for name, count in Counter(plain).items() if count > 1}
    names = [
        f"{Path(run.path).resolve().parent.name}-{name}" if name in twice else name
        for run, name in zip(runs, plain, strict=True)
    ]
    seen: Counter[str] = Counter()
    for i, name in enumerate(names):  # still equal: numbered
        seen[name] += 1
        if seen[name] > 1:
            names[i] = f"{name}-{seen[name]}"
    return [f"{name}.npz" for name in names]


def _stem(run: Run) -> str:
    name, mark, number = run.id.rpartition("#")
    number = number.replace("@", "-from-").replace(":", "-to-")
    return f"{Path(name).stem}-{number}" if mark else Path(run.id).stem


def table(found: Ingest) -> list[str]:
    """Lines for people: a row for each run, its notes and reasons below it."""
    ids = shown_ids(found.runs)
    width = max([len(id) for id in ids] + [3])
    lines = [f" {'run':<{width}}  {'maneuver':<8}  {'axis':<8}  {'start s':>8}  {'length s':>8}  {'Hz':>6}  gaps"]
    for id, run in zip(ids, found.runs, strict=True):
        rate = "-" if run.rate_hz is None else f"{run.rate_hz:.1f}"
        answer = "usable" if run.usable else "not usable, because"
        if run.usable_to_hz is not None:
            answer = f"{up_to_words(run.usable_to_hz)}; not above, because"
        lines.append(
            f" {id:<{width}}  {run.maneuver:<8}  {run.axis or '-':<8}  {run.start_s:8.2f}  {run.duration_s:8.2f}  "
            f"{rate:>6}  {len(run.gaps):4d}  {answer}"
        )
        if run.health is not None and run.maneuver != "quiet" and (words := run.health.words(run.axis)):
            lines.append(f"    {printable(words)}")
        lines += [f"    - {printable(reason)}" for reason in run.reasons]
        lines += [f"    note: {printable(note)}" for note in run.notes]
    for source in found.sources:
        lines += [f" {printable(source.path)}: {printable(note)}" for note in (*source.notes, *source.hints)]
    return [*lines, *(f" {words}" for words in found.left_out.values())]


def shown_ids(runs: Sequence[Run]) -> list[str]:
    """The runs' ids; where two logs share a name, with as much of their folders in front as tells them apart."""
    paths = {run.id: {other.path for other in runs if other.id == run.id} for run in runs}
    shown = []
    for run in runs:
        others = [Path(path).parts for path in paths[run.id] - {run.path}]
        parts = Path(run.path).parts
        depth = 1
        while depth < len(parts) and any(other[-depth:] == parts[-depth:] for other in others):
            depth += 1
        shown.append(printable("/".join([*parts[-depth:-1], run.id])))
    return shown


def explanation(found: Ingest, joined: Sequence[Path] = ()) -> list[str]:
    """Which channel came from where, which are missing and why, and a profile to start from; of refused logs that were
    to be `joined`, one for all."""
    lines = []
    for source in found.sources:
        name = source.profile.name if source.profile is not None else None
        lines.append(f"\n {printable(source.path)}: {source.kind}" + (f", profile {name}" if name else ""))
        have, absent = _found_and_absent(found, source)
        if source.kind == "record":
            continue
        lines.append("  channels found (p right side down, q nose up, r nose right; positive delta_x gives positive p)")
        lines += [
            f"    {channel:<13} {CHANNELS[channel]:<7} = {_scaled(text, source, channel)}"
            for channel, text in have.items()
        ] or ["    none"]
        lines.append("  not found")
        for channel, reason in absent.items():
            need = " (needed)" if channel in REQUIRED else ""
            lines.append(f"    {channel:<13} {CHANNELS[channel]:<7} {reason}{need}")
        lines += _latency(run for run in found.runs if run.path == source.path)
        lines += _to_write(source, have)
    for path, reason in found.refused.items():
        lines += _of_refused_join(joined, reason) if joined else _of_refused(Path(path), reason)
    return lines


def proposed_profile(lines: Sequence[str]) -> str:
    """The one profile that an explanation proposes, as a file. Raises UsageError where it proposes none, or several."""
    starts = [number for number, line in enumerate(lines) if line == FIRST_LINE]
    if len(starts) != 1:
        raise UsageError(f"a profile is written for one log; {len(starts)} are proposed here: name one log")
    body = itertools.takewhile(lambda line: not line.startswith("\n"), lines[starts[0] + 1 :])
    return "\n".join(["# proposed by --explain: correct what is guessed", *body]).rstrip() + "\n"


def _latency(runs: Iterable[Run]) -> list[str]:
    """Of every run that has one, which fields show the same quantity earlier or later than those that were taken."""
    shown = [
        f"    {printable(run.id)}: {printable(one.words)}"
        for run in runs
        if run.health is not None
        for one in run.health.latency
    ]
    return ["  the same quantity is also in other fields, at another time", *shown] if shown else []


def _of_refused(path: Path, reason: str) -> list[str]:
    """What to write for a log that is refused as it is, where at least its fields can be read."""
    try:
        if path.suffix.lower() in (".csv", ".txt"):
            file = CsvFile.read(path)
            kind, fields = "csv", tuple(name for name in file.header if name)
            column: Callable[[str], FloatArray] = partial(_csv_column, file)
        else:
            opened = open_log(path, None)
            kind, fields = opened.kind, tuple(dict.fromkeys(name for log in opened.boots for name in log.fields()))
            column = partial(_log_column, opened)
    except TippathError:
        return []

    def values(name: str) -> FloatArray | None:
        try:
            return column(name)
        except (TippathError, KeyError, StopIteration):
            return None

    return [
        f"\n {printable(str(path))}: not read: {printable(reason)}",
        *_to_write(Source(path=str(path), sha256="", kind=kind, fields=fields), {}, values),
    ]


def _of_refused_join(paths: Sequence[Path], reason: str) -> list[str]:
    """The same for CSVs that are joined: the first column, where all have it, is the time, and others are named as a
    profile names them."""
    try:
        files = {label: CsvFile.read(path) for label, path in zip(labels(paths), paths, strict=True)}
    except TippathError:
        return []
    counts = Counter(name for file in files.values() for name in file.header if name)
    places: dict[str, tuple[CsvFile, str]] = {}
    for label, file in files.items():
        for name in filter(None, file.header):
            plain = counts[name] == 1 or (counts[name] == len(files) and name == file.header[0])
            places.setdefault(name if plain else f"{label}.{name}", (file, name))

    def values(name: str) -> FloatArray | None:
        try:
            return _csv_column(*places[name])
        except (TippathError, KeyError):
            return None

    source = Source(path=str(paths[0]), sha256="", kind="csv", fields=tuple(places))
    names = ", ".join(printable(str(path)) for path in paths)
    return [f"\n {names}: not joined: {printable(reason)}", *_to_write(source, {}, values)]


def _csv_column(file: CsvFile, name: str) -> FloatArray:
    return file.columns([name])[name]


def _log_column(opened: Opened, name: str) -> FloatArray:
    return next(log for log in opened.boots if log.has(name)).series(name).values


def _scaled(text: str, source: Source, channel: str) -> str:
    """`+0.0174533 * SIDD.Gx`: the sign is there also where it is a plus."""
    mapping = None if source.profile is None else source.profile.channels.get(channel)
    scale, offset = (1.0, 0.0) if mapping is None else (mapping.scale, mapping.offset)
    shown = printable(text)
    shown = f"({shown})" if any(c in shown for c in " +-*/") else shown
    return f"{scale:+.6g} * {shown}" + (f" {offset:+.6g}" if offset else "")


def _spans(source: Source, values: Values | None) -> list[str]:
    """The lowest and highest value of each column of a matrix: it has no name of its own to be known by."""
    if values is None or source.kind not in ("mat", "parquet"):
        return []
    spans = [
        f"{printable(name)} {np.nanmin(found):.3g}..{np.nanmax(found):.3g}"
        for name in source.fields[:40]
        if name.endswith("]") and (found := values(name)) is not None and found.size
    ]
    return [f"  their lowest and highest values: {', '.join(spans)}"] if spans else []


def _to_write(source: Source, have: Mapping[str, str], values: Values | None = None) -> list[str]:
    """A profile to start from, and the fields there are to choose from."""
    fields = [printable(name) for name in source.fields]
    shown = ", ".join(fields[:40]) + (f" and {len(fields) - 40} more" if len(fields) > 40 else "")
    mappings = {} if source.profile is None else source.profile.channels
    found = {
        channel: replace(mappings.get(channel, ChannelSource(channel, (text,))), sources=(text,))
        for channel, text in have.items()
    }
    candidates = [name for name in fields if name.split(".")[0] not in EVENTS]
    time = (None, None) if source.profile is None else (source.profile.time_source, source.profile.time_scale)
    return [
        f"  fields of this log: {shown}",
        *_spans(source, values),
        "  to take a channel from elsewhere, a profile to start from:",
        "",
        *propose(candidates, source.kind, found, time, values).splitlines(),
    ]
