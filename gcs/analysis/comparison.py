"""A model compared with flights, or asked what it lacks: which runs are read.

A fit is compared with its own runs unless others are named. The quiet hover that was flown beside them is read too:
it never enters a fit, and it is what noise looks like.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from gcs.analysis.axes import of_axes
from gcs.analysis.fits import on_airframe, runs_of, told_loop_rate
from gcs.errors import TippathError
from gcs.logs import AnyWindow, FromStart, Run, fitted_beside, ingest, resolve_runs
from sysid.data.airframe import Airframe
from sysid.data.record import Record
from sysid.fit.result import Fit


def flown(
    fit: Fit,
    runs: Sequence[str] = (),
    profile: Path | None = None,
    window: AnyWindow | None = None,
) -> tuple[list[Record], list[Record]]:
    """The records to compare with, and those of quiet hover beside them.

    runs: RUN words; none are the fit's own runs, with the quiet hover of the same logs. The fit's profile reads them
    where no other is given; its window counts for its own runs only. Raises TippathError with the reasons.
    """
    if runs:
        return split(of_axes(_named(runs, fit, profile, window), fit.model.structure.base_))
    if profile is not None:
        fit = replace(fit, profile=str(profile))
    cut = window if isinstance(window, FromStart) else None
    if window is not None and not isinstance(window, FromStart):
        fit = replace(fit, window_s=window)
    records = runs_of(fit, fit.records, cut)
    return records, [*split(records)[1], *_quiet_beside(fit, records)]


def split(records: Sequence[Record]) -> tuple[list[Record], list[Record]]:
    """What was flown, and quiet hover."""
    quiet = [record for record in records if record.maneuver == "quiet"]
    return [record for record in records if record.maneuver != "quiet"], quiet


def _named(words: Sequence[str], fit: Fit, profile: Path | None, window: AnyWindow | None) -> list[Record]:
    """RUN words as the fit's profile reads them where no other is given, and as the loop held commands by the fit where
    no log tells."""
    own = None if fit.profile is None else Path(fit.profile)
    found = resolve_runs(words, profile or own, window, f_high_hz=fit.band_hz[1], loop_rate_hz=told_loop_rate(fit))
    return [record.held(fit.found_loop_s) for record in found]


def _quiet_beside(fit: Fit, records: Sequence[Record]) -> list[Record]:
    """Usable runs of quiet hover in the logs of these records, with rates from the same kind of message."""
    profile = None if fit.profile is None else Path(fit.profile)
    logs = [Path(path) for path in dict.fromkeys(record.path for record in records) if not path.endswith(".npz")]
    if not logs:
        return []
    read = ingest(logs, profile, fit.window_s, f_high_hz=fit.band_hz[1], loop_rate_hz=told_loop_rate(fit))
    return quiet_among(read.runs, fit, records)


def quiet_among(runs: Sequence[Run], fit: Fit, records: Sequence[Record]) -> list[Record]:
    """Usable quiet hover among runs, from the logs of these records and with rates from the same kind of message."""
    sources = {record.rate_source for record in records}
    known = {(record.path, record.id) for record in records}
    logs = {record.path for record in records}
    return [
        run.record
        for run in runs
        if run.usable
        and run.record is not None
        and run.path in logs
        and run.maneuver == "quiet"
        and run.record.rate_source in sources
        and (run.record.path, run.record.id) not in known
        and set(fit.model.structure.inputs) <= set(run.record.channels)
    ]


def flown_with_validation(
    fit: Fit,
    runs: Sequence[str],
    validate: Sequence[str],
    profile: Path | None,
    window: AnyWindow | None,
    airframe: Airframe | None = None,
) -> tuple[list[Record], list[Record], list[Record]]:
    """Runs to fit, runs that only judge, and quiet hover; the fit's own where none are named. They are of the airframe
    that is named, else of the fit's where it has one.

    Raises TippathError where a log is gone, changed or holds nothing usable, and where every run validates.
    """
    records, quiet = flown(fit, runs, profile, window)
    if validate:
        judging = _named(validate, fit, profile, window)
    elif runs:
        judging = []
    else:
        judging = runs_of(fit, fit.validation)
    judging = [record for record in of_axes(judging, fit.model.structure.base_) if record.maneuver != "quiet"]
    fitted = fitted_beside(records, judging)
    if not fitted:
        raise TippathError(
            "no run is left to fit: every one validates; leave at least a roll and a pitch chirp to the fit"
            if judging
            else "no run to fit: quiet hover shows the noise only"
        )
    airframe = airframe or fit.airframe
    return on_airframe(fitted, airframe), on_airframe(judging, airframe), quiet
