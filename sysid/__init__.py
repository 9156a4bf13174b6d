"""The mathematics: what was measured, what is predicted, which numbers fit, what is missing, which gains hold.

These names are what a notebook needs, and what stays; everything else is its folder's own. `import sysid` is quick: a
name is loaded when it is first used. Logs are read by `gcs.logs.resolve_runs(["flight.BIN"])`, which gives records.

A tour. Numbers of Table 4 of the paper, and runs that such a vehicle would fly:

>>> import numpy as np
>>> import sysid
>>> TPP = dict(L_b=147.5, M_a=713.4, tau_f=0.091, A_b=-1.338, B_a=1.448,
...            A_lat=-0.282, A_lon=0.296, B_lat=0.524, B_lon=-0.050)
>>> CD = dict(L_p=-2.056, L_q=-7.900, M_p=10.536, M_q=-4.777,
...           L_lat=-5.361, L_lon=9.917, M_lat=-67.573, M_lon=11.136)
>>> truth = sysid.make_model("tpp", TPP)
>>> t = np.arange(0, 14, 0.005)
>>> chirp = 0.1 * np.sin(2 * np.pi * (0.3 * t + 0.35 * t**2)) * (t < 12)
>>> step = 0.1 * np.sign(np.sin(2 * np.pi * 0.7 * t)) * (t < 4)
>>> chirps = [sysid.simulate("roll", truth, t, {"delta_x": chirp}),
...           sysid.simulate("pitch", truth, t, {"delta_y": chirp})]
>>> doublets = [sysid.simulate("steps", truth, t, {"delta_x": step, "delta_y": np.roll(step, 800)})]

Fit, and look:

>>> fit = sysid.fit_model(chirps, "tpp", validation=doublets)
>>> round(fit.model["L_b"], 1), [round(mode.frequency_hz, 2) for mode in fit.model.modes]
(147.5, [1.63, 5.03])
>>> comparison = sysid.compare_fit(fit, chirps)
>>> gains = sysid.design_gains(fit.model)

`sysid.diagnose_fit(fit, chirps, doublets)` asks which effect is missing, `sysid.add_effect` adds it.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from sysid.compare.on_runs import CompareError as CompareError
    from sysid.compare.values import Comparison as Comparison
    from sysid.control.loop import Following as Following
    from sysid.control.regulator import DesignError as DesignError
    from sysid.control.regulator import Gains as Gains
    from sysid.control.stability import ClosedLoop as ClosedLoop
    from sysid.data.record import CHANNELS as CHANNELS
    from sysid.data.record import Record as Record
    from sysid.data.record import RecordError as RecordError
    from sysid.diagnose.verdict import Diagnosis as Diagnosis
    from sysid.errors import FitError as FitError
    from sysid.errors import SysidError as SysidError
    from sysid.fit.result import Fit as Fit
    from sysid.fit.saved_model import ResultError as ResultError
    from sysid.model.compose import compose as compose
    from sysid.model.effect import Effect as Effect
    from sysid.model.effect import EffectError as EffectError
    from sysid.model.effect import Stage as Stage
    from sysid.model.effect import magnitude as magnitude
    from sysid.model.paper import reduce_to_cd as reduce_to_cd
    from sysid.model.parameter import Parameter as Parameter
    from sysid.model.structure import Mode as Mode
    from sysid.model.structure import Model as Model
    from sysid.model.structure import Structure as Structure
    from sysid.notebook import NotebookError as NotebookError
    from sysid.notebook import Prediction as Prediction
    from sysid.notebook import add_effect as add_effect
    from sysid.notebook import compare_fit as compare_fit
    from sysid.notebook import design_gains as design_gains
    from sysid.notebook import diagnose_fit as diagnose_fit
    from sysid.notebook import find_effect as find_effect
    from sysid.notebook import fit_model as fit_model
    from sysid.notebook import judge_gains as judge_gains
    from sysid.notebook import judge_model as judge_model
    from sysid.notebook import list_effects as list_effects
    from sysid.notebook import make_model as make_model
    from sysid.notebook import make_record as make_record
    from sysid.notebook import measure_responses as measure_responses
    from sysid.notebook import predict as predict
    from sysid.notebook import predict_answer as predict_answer
    from sysid.notebook import read_fit as read_fit
    from sysid.notebook import read_record as read_record
    from sysid.notebook import simulate as simulate
    from sysid.response.values import Responses as Responses

_NOTEBOOK = (
    "NotebookError", "Prediction", "add_effect", "compare_fit", "design_gains", "diagnose_fit", "find_effect",
    "fit_model", "judge_gains", "judge_model", "list_effects", "make_model", "make_record", "measure_responses",
    "predict", "predict_answer", "read_fit", "read_record", "simulate",
)  # fmt: skip
_HOMES = {
    "CHANNELS": "sysid.data.record",
    "ClosedLoop": "sysid.control.stability",
    "CompareError": "sysid.compare.on_runs",
    "Comparison": "sysid.compare.values",
    "DesignError": "sysid.control.regulator",
    "Diagnosis": "sysid.diagnose.verdict",
    "Effect": "sysid.model.effect",
    "EffectError": "sysid.model.effect",
    "Fit": "sysid.fit.result",
    "FitError": "sysid.errors",
    "Following": "sysid.control.loop",
    "Gains": "sysid.control.regulator",
    "Mode": "sysid.model.structure",
    "Model": "sysid.model.structure",
    "Parameter": "sysid.model.parameter",
    "Record": "sysid.data.record",
    "RecordError": "sysid.data.record",
    "Responses": "sysid.response.values",
    "ResultError": "sysid.fit.saved_model",
    "Stage": "sysid.model.effect",
    "Structure": "sysid.model.structure",
    "SysidError": "sysid.errors",
    "compose": "sysid.model.compose",
    "magnitude": "sysid.model.effect",
    "reduce_to_cd": "sysid.model.paper",
    **dict.fromkeys(_NOTEBOOK, "sysid.notebook"),
}

__all__ = sorted(_HOMES)


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'sysid' has no public name {name!r}")
    value = getattr(import_module(_HOMES[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return [*__all__, "__doc__"]
