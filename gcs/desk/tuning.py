"""What the desk works out of gains: at once on one model while sliders move, in full once they rest, over flights.

Scipy and control come along.
"""

from __future__ import annotations

import contextlib
import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from gcs import documents
from gcs.analysis.band import chosen_band
from gcs.analysis.clearance import Clearance, clearance, cleared_again, gains_in
from gcs.analysis.clearance import designed as designed_in
from gcs.analysis.diagnosis import FitDiagnosis
from gcs.analysis.identified import identified
from gcs.analysis.lqr import AskedDesign, Observer, at_costs
from gcs.analysis.lqr import designed as designed_as_asked
from gcs.analysis.shadow import ShadowFlight, shadow_flight
from gcs.analysis.standing import Standing, beside, digest, standing_of
from gcs.analysis.text.documents import diagnosis_document
from gcs.analysis.text.gains import gains_text
from gcs.analysis.vehicles import different_vehicles
from gcs.desk import ladder, shell
from gcs.desk.state import Designed, OnFit, Present, Trial, Weights
from gcs.errors import TippathError
from gcs.flight.gains import LARGEST, GainsDocument, GainsError, gains_of, load_gains
from gcs.flight.identified import Identified
from gcs.logs.formats.dataflash_table import DataFlashTables
from gcs.logs.opening import open_log
from gcs.vehicle.autopilots import ACTIVE_CRC
from sysid.control.judgement import judge
from sysid.control.loop import following
from sysid.control.observers import KALMAN, RateNoise, rate_noise, with_gain
from sysid.control.regulator import OBSERVER_POLES, Gains
from sysid.data.record import Record
from sysid.errors import SysidError
from sysid.fit.result import Fit
from sysid.fit.saved_model import model_json

MOST_FILES = 200
"""Of gains that are looked through for those that flew."""
OBSERVER_ROUNDED = 0.01
"""How far placed poles come out from where they were asked for, of the paper's; a Kalman filter's lie further apart."""


def asked_of(weights: Weights) -> AskedDesign:
    """What the sliders ask for, as a command asks for it."""
    observer: Observer = _poles(weights) or KALMAN
    return AskedDesign(
        input_cost=weights.input_cost,
        flapping_cost=weights.flapping_cost,
        observer=observer,
        dynamic=weights.dynamic,
    )


def _poles(weights: Weights) -> tuple[float, ...]:
    """1/s; none of the Kalman filter, which finds its own."""
    return tuple(round(weights.observer * pole, 3) for pole in OBSERVER_POLES) if weights.observer else ()


def standing(fit: Fit, asked: FitDiagnosis | None, folder: Path) -> Standing:
    """What is known of what a fit lacks: by this session's diagnosis, else by one that a folder holds."""
    files = shell.user_files(fit)
    if asked is not None and digest(asked.fit) == digest(fit):
        return standing_of(diagnosis_document(asked, folder=folder), folder, files)
    return beside(folder, fit, files)


def on_fit(gains: Gains, fit: Fit, known: Standing) -> OnFit:
    """Gains in the loop with a fit, and with what completes it."""
    completed = [one for one in known.models if one[0] == "missing"][:1]
    judgement = judge(gains, [("fit", fit.model), *completed])
    held = judgement.models[0].loop.stable
    return OnFit(gains=gains, judgement=judgement, following=following(gains, fit.model) if held else None)


def noise_of(weights: Weights, fit: Fit, records: Sequence[Record]) -> RateNoise | None:
    """What a Kalman filter is for; None for another observer. Raises DesignError."""
    return None if weights.observer else rate_noise(fit.model, records)


def trial(fit: Fit, weights: Weights, known: Standing, records: Sequence[Record]) -> Trial:
    """What the sliders would make of a fit."""
    try:
        noise, asked = noise_of(weights, fit, records), asked_of(weights)
        gains = at_costs(fit, asked, [model for _, model in known.models], None, noise, weights.input_cost)
        return Trial(fit=fit, weights=weights, standing=known, found=on_fit(gains, fit, known))
    except (SysidError, TippathError, np.linalg.LinAlgError) as error:
        return Trial(fit=fit, weights=weights, standing=known, found=None, problem=str(error))


def judged(gains: Gains, fit: Fit, known: Standing) -> Clearance:
    """On every model that is left open, and over the fit's bounds."""
    return clearance(gains, fit, known)


def designed(fit: Fit, weights: Weights, known: Standing, records: Sequence[Record], before: Trial | None) -> Designed:
    """Gains, what they are worth, and the answer they promise; kept nowhere yet. `before`: of this fit and these
    weights; where it was judged by what is known now, that counts.

    Raises DesignError for gains that do not hold the fit.
    """
    if (
        before is not None
        and before.found is not None
        and before.clearance is not None
        and before.standing.to_json() == known.to_json()
    ):
        gains, cleared = before.found.gains, before.clearance
    else:
        models, noise = [model for _, model in known.models], noise_of(weights, fit, records)
        gains = designed_as_asked(fit, asked_of(weights), models, None, noise)
        cleared = clearance(gains, fit, known)
    return Designed(
        text=gains_text(gains),
        path=None,
        crc=gains_of(gains.to_json()).crc,
        command="",
        rung=ladder.full_name(fit),
        gains=gains,
        clearance=cleared,
        identified=identified(fit),
        following=following(gains, fit.model),
        weights=weights,
    )


def designed_before(folder: Path, fits: Sequence[Fit]) -> tuple[Designed, Fit] | None:
    """The newest gains in a folder that were designed on one of these fits, judged anew, and that fit."""
    try:
        newest = sorted(folder.glob("*gains*.json"), key=lambda one: one.stat().st_mtime_ns, reverse=True)[:MOST_FILES]
    except OSError:
        return None
    for path in newest:
        with contextlib.suppress(TippathError, SysidError, np.linalg.LinAlgError, ValueError, OSError):
            gains, model, _ = designed_in(path)
            fit = next((one for one in fits if model_json(one.model, folder) == model_json(model, folder)), None)
            if fit is None or not np.isfinite(gains.input_cost):
                continue
            looped = with_gain(gains, gains.observer_gain, fit.model)
            if looped.loop.stable:
                return _again(path, looped, fit), fit
    return None


def _again(path: Path, gains: Gains, fit: Fit) -> Designed:
    held = load_gains(path)
    faster = np.sort(gains.observer_poles.real) / np.sort(OBSERVER_POLES)
    weights = Weights(
        input_cost=gains.input_cost,
        flapping_cost=gains.flapping_cost,
        observer=round(float(faster[0]), 2) if np.ptp(faster) < OBSERVER_ROUNDED else 0.0,
        dynamic=gains.dynamic is not None,
    )
    return Designed(
        text=gains_text(gains),
        path=path,
        crc=held.crc,
        command="",
        rung=ladder.full_name(fit),
        gains=gains,
        clearance=cleared_again(path, shell.user_files(fit)),
        identified=held.identified or Identified(),
        following=following(gains, fit.model),
        weights=weights,
    )


def shadow(made: Designed, records: Sequence[Record]) -> ShadowFlight:
    """Designed gains over flown runs. Raises TippathError for runs of different vehicles, and as `shadow_flight`."""
    if (doubt := different_vehicles(records)) is not None:
        raise TippathError(doubt.replace("fit them apart", "3, then A leaves the others out"))
    swept = [one for one in records if one.maneuver != "quiet"] or records
    judgement = made.clearance.judgement
    asked = made.gains, judgement.models[0].model, judgement.limits
    return shadow_flight(asked, made.crc, records, chosen_band(swept).hz)


def flown_crc(path: Path) -> int | None:
    """The checksum of the bank that was active when a log ended; None where it tells of none."""
    with contextlib.suppress(TippathError, OSError):
        boots = [log for log in open_log(path, None).boots if isinstance(log, DataFlashTables)]
        crc = boots[-1].parameters(float("inf")).get(ACTIVE_CRC) if boots else None
        return None if not crc else int(crc)
    return None


def present(folder: Path, crc: int, first: Path | None = None) -> Present | None:
    """The gains of a checksum among those that are kept in a flight's folder and its neighbours."""
    for path in ([] if first is None else [first]) + list(kept_gains(folder)):
        with contextlib.suppress(TippathError, OSError, ValueError):
            document = json.loads(documents.read_text(path, "set of gains", LARGEST))
            if gains_of(document, str(path)).crc == crc:
                return Present(path=path, crc=crc, document=document, found=_on_its_own(path))
    return None


def _on_its_own(path: Path) -> OnFit | None:
    """Gains on the model that they were first judged on; None where the file has none that can be had."""
    try:
        gains, model, limits = designed_in(path)
        judgement = judge(gains, [("fit", model)], limits)
        held = judgement.models[0].loop.stable
        return OnFit(gains=gains, judgement=judgement, following=following(gains, model) if held else None)
    except (TippathError, SysidError, np.linalg.LinAlgError):
        return None


def kept_gains(folder: Path) -> list[Path]:
    """Files of gains in a flight's folder, and then in its neighbours."""
    try:
        own = sorted(folder.glob("*gains*.json"))
        return [*own, *(one for one in sorted(folder.resolve().parent.glob("*/*gains*.json")))][:MOST_FILES]
    except OSError:
        return []


def present_on(held: Present, fit: Fit, known: Standing) -> Present:
    """The same in the loop with a fit. Raises GainsError for a set that is none for it."""
    try:
        gains = gains_in(documents.convert(held.document, GainsDocument, "the gains"))
        return replace(held, found=on_fit(gains, fit, known), fit=fit)
    except (documents.DocumentError, SysidError, np.linalg.LinAlgError, ValueError) as error:
        raise GainsError(f"{held.path}: {error}") from error


def options(weights: Weights) -> list[Any]:
    """What a command is told of the sliders; nothing of those that stand where the paper has them."""
    usual = Weights()
    told: list[Any] = []
    if weights.input_cost != usual.input_cost:
        told += ["--input-cost", repr(weights.input_cost)]
    if weights.flapping_cost != usual.flapping_cost:
        told += ["--flapping-cost", repr(weights.flapping_cost)]
    if not weights.observer:
        told += ["--observer", KALMAN]
    elif weights.observer != usual.observer:
        told += ["--observer", ",".join(f"{-pole:g}" for pole in _poles(weights))]
    return [*told, *(["--prefilter", "dynamic"] if weights.dynamic else [])]
