"""Where servos with play or a dead band stood when a run began, found from the run itself.

Such a servo may rest anywhere within its play beside its command, and while commands are small beside it, where it
began decides what it does for many seconds. That is a state of the run like its other end states, no property of the
vehicle: runs that only judge a model estimate it too.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from sysid.data.dataset import Dataset
from sysid.data.preprocess import Spectrum
from sysid.data.stacks import stack
from sysid.fit.output_error import OutputError, output_error
from sysid.model.acting import divided, jumping
from sysid.model.relaxation import RelaxationError
from sysid.model.structure import Model

PLACES = (-1.0, -0.5, 0.5, 1.0)
"""Of how far it may be from the command; 0 is where every run begins otherwise."""
STEPS = tuple(x / 10 for x in range(-10, 11) if x)
"""With a dead band a small difference decides when the next step comes, and so all that follow: no search goes downhill
there."""


def validation_error(model: Model, on: Dataset) -> OutputError:
    """What a model leaves of runs that it was not fitted to."""
    return output_error(model, stack(begun(model, on.spectra)) if _reaches(model) else on.stacks)


def begun(model: Model, runs: Sequence[Spectrum]) -> list[Spectrum]:
    """Segments whose first command samples are where the servos must have stood to follow the run best."""
    names = _reaches(model)
    if not names:
        return list(runs)
    # a short run may show no step
    steps = any(set(names) & {*jumping(model.structure, model.values, stack([one])[0])} for one in runs)
    reach = max(model[name] for name in names)
    return [_begun(model, one, [reach * place for place in (STEPS if steps else PLACES)]) for one in runs]


def _reaches(model: Model) -> list[str]:
    front, _ = divided(model.structure)
    return [one.rests_within for one in front if one.rests_within is not None]


def _begun(model: Model, run: Spectrum, places: Sequence[float]) -> Spectrum:
    """One command after the other; those that hardly reach into the response stay where they are."""
    best, least = run, _left(model, run)
    for name in model.structure.commands:
        here = best
        for place in places:
            commands = here.segment.channels[name].copy()
            commands[0] += place
            trial = replace(here, segment=replace(here.segment, channels={**here.segment.channels, name: commands}))
            left = _left(model, trial)
            if left < least:
                best, least = trial, left
    return best


def _left(model: Model, run: Spectrum) -> float:
    """Residual over measured power, summed over the outputs."""
    try:
        error = output_error(model, stack([run]))
    except (RelaxationError, np.linalg.LinAlgError):
        return np.inf
    return float(np.sum(error.residual_power / np.maximum(error.measured_power, 1e-300)))
