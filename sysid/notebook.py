"""What a notebook does, one call a step: arrays to records, records to a fit, a fit to a verdict and to gains.

Each function hands on to the room that does the work, with what a fit knows already (its structure, its band, what was
held) filled in. Names here have a verb and a thing, because `fit`, `compare`, `diagnose` and `effects` are rooms: the
attribute `sysid.fit` is the folder as soon as anything imports it, and could not be relied on to be a function.

Examples go on from the tour in `help(sysid)`: `chirps`, `doublets` and `fit` are made there.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike
from scipy.signal import dlsim

from sysid.compare.compare import compare
from sysid.compare.values import Comparison
from sysid.control.loop import Following, following
from sysid.control.regulator import INPUT_COST, Gains, design
from sysid.control.stability import ClosedLoop, closed_loop
from sysid.data.preprocess import DEFAULT_BAND_HZ, spectra
from sysid.data.record import CYCLIC, RATES, REQUIRED, FloatArray, Record
from sysid.diagnose.diagnose import diagnose
from sysid.diagnose.verdict import Diagnosis
from sysid.errors import SysidError
from sysid.fit.identify import identify, judge
from sysid.fit.result import Fit
from sysid.fit.simulate import overlay
from sysid.model.base import Base, BaseError, find_base
from sysid.model.bases import DEFAULT
from sysid.model.compose import compose
from sysid.model.effect import Effect, catalogue, find
from sysid.model.structure import Model, discretise
from sysid.response.measure import measure
from sysid.response.values import Responses


class NotebookError(SysidError):
    """A call that cannot be answered; the message says why and what to do."""


@dataclass(frozen=True, eq=False)
class Prediction:
    """A model beside one gap-free part of a run, both with the bins of the fit's band only."""

    t: FloatArray
    """(n,), s, the record's own time."""
    measured: FloatArray
    """(n, outputs), rad/s."""
    modelled: FloatArray
    """(n, outputs), rad/s."""


def make_record(name: str, channels: Mapping[str, ArrayLike], *, maneuver: str = "unknown") -> Record:
    """A run from arrays of one length: `t`, `p`, `q`, `delta_x`, `delta_y`, and any other of `sysid.CHANNELS`.

    Units are those of `sysid.CHANNELS` (s, rad/s, commands in -1..1); p right side down, q nose up. `maneuver` is
    `chirp`, `doublet` or `quiet`. Raises RecordError where a channel is missing, unknown, or has gaps in its numbers.

    >>> t = [0.00, 0.01, 0.02]
    >>> run = sysid.make_record("mine", {"t": t, "p": [0, 0, 1], "q": t, "delta_x": t, "delta_y": t})
    >>> round(run.duration_s, 2)
    0.02
    """
    return Record(name, {key: np.asarray(values, float) for key, values in channels.items()}, maneuver=maneuver)


def read_record(path: str | Path) -> Record:
    """A record that `tippath ingest -o` wrote. Raises RecordError; logs are read by `gcs.logs.resolve_runs`."""
    return Record.load(Path(path))


def read_fit(path: str | Path, effects: Sequence[str] = ()) -> Fit:
    """A fit that `tippath fit -o` wrote. `effects` are the paths of a user's own effects in it: their code runs.

    Raises ResultError, and EffectError for an effect that is not there any more.
    """
    return Fit.load(Path(path), effects)


def list_effects() -> tuple[str, ...]:
    """The ids of the catalogue, in the order of `tippath effects`; `sysid.find_effect` gives one.

    >>> "servo_lag" in sysid.list_effects()
    True
    """
    return tuple(catalogue())


def find_effect(word: str) -> Effect:
    """The effect of that id, or of a user's file by its path (its code runs). Raises EffectError.

    >>> sysid.find_effect("servo_lag").equation
    "tau_s v' = delta - v on every command channel, one tau_s"
    """
    return find(word)


def make_model(
    base: str,
    values: Mapping[str, float],
    effects: Sequence[str | Effect] = (),
    outputs: Sequence[str] | None = None,
) -> Model:
    """A model with given numbers, units of its parameters: `cd`, `tpp` or a base of your own by its path, with effects.

    `outputs` as in `fit_model`. Raises NotebookError for another word, EffectError for an effect that cannot act on it,
    and KeyError for a parameter without a value.

    >>> lagging = sysid.make_model("cd", {**CD, "tau_s": 0.03}, ["servo_lag"])
    >>> lagging["tau_s"]
    0.03
    """
    structure = compose(_known(base), effects, outputs=outputs)
    return Model(structure, structure.vector(values))


def simulate(
    name: str, model: Model, t: ArrayLike, commands: Mapping[str, ArrayLike], *, maneuver: str = "chirp"
) -> Record:
    """A run of the model alone, from rest: each command sample holds until the next; no gusts, no noise.

    `t` (n,) is uniform, s; `commands` has (n,) for each of the model's inputs, and 0 for those it does not name; what a
    model of one axis does not have stands still. Raises NotebookError for a model that is not linear or whose effects
    no matrix holds (delay, play, limits).
    """
    structure = model.structure
    if not structure.linear or structure.outside_matrices:
        raise NotebookError("only a linear model without delay, play and limits runs alone; predict needs a flown run")
    time = np.asarray(t, float)
    given = {key: np.asarray(values, float) for key, values in commands.items()}
    U = np.stack([given.get(key, np.zeros_like(time)) for key in structure.inputs])
    A, B, C, D = model.matrices
    dt = float(time[1] - time[0])
    _, answer, _ = dlsim((*discretise(A, B, dt), C, D, dt), U.T)
    rates = dict(zip(structure.outputs, answer.T, strict=True))
    flown = dict(zip(structure.inputs, U, strict=True))
    still = dict.fromkeys(REQUIRED, np.zeros_like(time))
    return make_record(name, {**still, "t": time, **rates, **flown}, maneuver=maneuver)


def fit_model(
    records: Sequence[Record],
    base: str = DEFAULT,
    effects: Sequence[str | Effect] = (),
    *,
    validation: Sequence[Record] = (),
    band_hz: tuple[float, float] = DEFAULT_BAND_HZ,
    fixed: Mapping[str, float] | None = None,
    outputs: Sequence[str] | None = None,
) -> Fit:
    """Fit `cd`, `tpp` or the path of a base of one's own, with effects, to all records; `validation` only judges.

    `outputs` are the states that are measured, where more than p and q are: `("p", "q", "a", "b")` of a `tpp` whose
    flapping is logged. A record then has a channel of that name.
    Effects are ids, paths of a user's files, or `sysid.Effect`; `fixed` parameters are held at their values. Raises
    FitError where an axis is not identifiable, EffectError where an effect cannot act on these runs.

    >>> lagging = sysid.fit_model(chirps, "cd", ["servo_lag"])
    >>> lagging.model.structure.effects
    ('servo_lag',)
    """
    return identify(compose(_known(base), outputs=outputs), records, validation, band_hz, effects=effects, fixed=fixed)


def add_effect(fit: Fit, effect: str | Effect, records: Sequence[Record], *, validation: Sequence[Record] = ()) -> Fit:
    """The fit's structure with one effect more, begun at the fit, on the same records. Raises as `fit_model`.

    >>> better = sysid.add_effect(fit, "angular_damping", chirps)
    >>> [rung.effects for rung in better.lineage]
    [(), ('angular_damping',)]
    """
    structure = fit.model.structure
    known = dict(zip(structure.effects, structure.composed, strict=True))
    order = fit.lineage[-1].effects if fit.lineage else structure.effects
    effects = [*(known.get(name, name) for name in order), effect]
    return identify(structure.bare, records, validation, fit.band_hz, effects=effects, fixed=_held(fit), grown=fit)


def judge_model(
    model: Model, records: Sequence[Record], band_hz: tuple[float, float] = DEFAULT_BAND_HZ
) -> dict[str, float]:
    """NRMSE fit by output, percent, 100 is perfect, of a model on any runs. Raises FitError.

    >>> judged = sysid.judge_model(fit.model, doublets)
    >>> min(judged.values()) > 99
    True
    """
    return judge(model, records, band_hz)


def predict(model: Model, record: Record, band_hz: tuple[float, float] = DEFAULT_BAND_HZ) -> tuple[Prediction, ...]:
    """The model beside a flown run, trim and end states estimated; a part for each stretch without a gap.

    >>> (part,) = sysid.predict(fit.model, doublets[0])
    >>> part.modelled.shape == part.measured.shape == (part.t.size, 2)
    True
    """
    parts, _ = spectra([record], model.structure.inputs, model.structure.outputs, band_hz)
    return tuple(Prediction(*overlay(model, part)) for part in parts)


def measure_responses(records: Sequence[Record], band_hz: tuple[float, float] = DEFAULT_BAND_HZ) -> Responses:
    """Frequency responses of p and q to delta_x and delta_y from all runs together, with their coherences.

    >>> measured = sysid.measure_responses(chirps)
    >>> measured.H.shape == (2, 2, measured.frequency_hz.size)
    True
    """
    return measure(spectra(records, CYCLIC, RATES, band_hz)[0], CYCLIC, RATES)


def compare_fit(
    fit: Fit, records: Sequence[Record], *, quiet: Sequence[Record] = (), own_runs: bool = True
) -> Comparison:
    """Where the fit's model fails on runs, in frequency, in time and by run; runs of quiet hover measure the noise.

    `own_runs` says that the fit was made from these records. Raises CompareError where nothing can be compared.

    >>> compared = sysid.compare_fit(fit, chirps)
    >>> sorted(compared.nrmse_percent)
    ['p', 'q']
    """
    return compare(fit.model, records, fit.band_hz, quiet, own_runs=own_runs)


def diagnose_fit(
    fit: Fit, records: Sequence[Record], validation: Sequence[Record] = (), *, effects: Sequence[Effect] = ()
) -> Diagnosis:
    """Which effect of the catalogue, or of `effects`, the fit lacks on its records; some seconds.

    The verdict is `complete`, `missing` or `unexplained`. Raises FitError where the runs do not identify the model.
    """
    structure, begin = fit.model.structure, fit.model
    return diagnose(structure, records, validation, fit.band_hz, effects=effects, fixed=_held(fit), begin=begin)


def design_gains(model: Model, input_cost: float = INPUT_COST) -> Gains:
    """LQR gains for a TPP model, effects and delay judged with it. Raises DesignError, NotHeldError.

    >>> gains = sysid.design_gains(sysid.make_model("tpp", TPP))
    >>> gains.loop.stable
    True
    """
    return design(model, input_cost)


def judge_gains(gains: Gains, model: Model) -> ClosedLoop:
    """Whether gains hold another model of the vehicle, delay included, and with which margins.

    >>> sysid.judge_gains(gains, sysid.make_model("tpp", {**TPP, "tau_s": 0.02}, ["servo_lag"])).stable
    True
    """
    return closed_loop(gains, model)


def predict_answer(gains: Gains, model: Model) -> Following:
    """How the vehicle answers a doublet of the commanded rate under these gains. Raises DesignError.

    >>> answer = sysid.predict_answer(gains, sysid.make_model("tpp", TPP))
    >>> answer.t.size == answer.roll.p.size
    True
    """
    return following(gains, model)


def _known(base: str) -> Base:
    try:
        return find_base(base)
    except BaseError as error:
        raise NotebookError(str(error)) from error


def _held(fit: Fit) -> dict[str, float]:
    return {name: fit.model[name] for name in fit.fixed}
