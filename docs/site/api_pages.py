"""The page of the Python API: every public name of `sysid`, grouped as a notebook uses them."""

from __future__ import annotations

import inspect

import sysid

GROUPS = {
    "Data": ("make_record", "read_record", "simulate", "Record", "RecordError", "CHANNELS"),
    "Models": (
        *("make_model", "compose", "reduce_to_cd", "Model", "Structure", "Mode", "Parameter", "Effect", "EffectError"),
        *("Stage", "magnitude", "list_effects", "find_effect"),
    ),
    "Fits": ("fit_model", "judge_model", "read_fit", "predict", "Fit", "FitError", "ResultError", "Prediction"),
    "Where a model fails, and what is missing": (
        *("compare_fit", "Comparison", "CompareError", "diagnose_fit", "Diagnosis", "add_effect"),
        *("measure_responses", "Responses"),
    ),
    "Gains": (*("design_gains", "judge_gains", "predict_answer", "Gains", "ClosedLoop", "Following", "DesignError"),),
    "Errors": ("SysidError", "NotebookError"),
}
INTRODUCTION = """\
The Python API
==============

These names stay; all others are their folder's own and may change. ``import sysid`` is quick: a name is loaded when it
is first used. Logs are read by ``gcs.logs.resolve_runs(["flight.BIN"])``, which gives records. An example of a
notebook's length: :doc:`docs/notebook`. In a terminal ``python -c "import sysid; help(sysid)"`` has a tour.
"""


def api_page() -> str:
    """reStructuredText. Raises ValueError where a public name has no group."""
    grouped = {name for names in GROUPS.values() for name in names}
    if grouped != set(sysid.__all__):
        raise ValueError(f"public names without a group, or gone: {sorted(grouped ^ set(sysid.__all__))}")
    return "\n".join([INTRODUCTION, *(section(title, names) for title, names in GROUPS.items())])


def section(title: str, names: tuple[str, ...]) -> str:
    lines = [title, "-" * len(title), ""]
    for name in names:
        value = getattr(sysid, name)
        if inspect.isclass(value):
            lines += [f".. autoclass:: sysid.{name}", "   :members:", "   :exclude-members: __init__, __new__", ""]
        elif callable(value):
            lines += [f".. autofunction:: sysid.{name}", ""]
        else:
            lines += [f".. py:data:: sysid.{name}", "", "   Channel -> its unit:", ""]
            lines += [f"   - ``{key}``: {unit}" for key, unit in value.items()] + [""]
    return "\n".join(lines)
