"""A probe before the card: a small step on each axis, judged before thirty seconds at full amplitude are flown.

From a few quiet seconds of hover and one small run on each axis: do the rates answer at all, with the right sign, on
the right axis, in time, in the right unit, and does the log hold what it must. What cannot be seen above the noise is
said to be so: it is neither right nor wrong.

Ignored: play and friction, which make a small step's answer smaller than the card's (see `prediction.SAFETY`), the sign
of an elevator, for which there is no convention, and yaw.

`judge` is not handed on here: scipy.signal, which it needs, takes a second to import, and most flights have no probe.
"""

from gcs.flight.probe.card import QUIET_S, probe_card
from gcs.flight.probe.prediction import largest_amplitude, too_large_words
from gcs.flight.probe.values import ProbeResult, ProbeStep, Samples
from gcs.flight.probe.words import finding_words, result_document, result_words

__all__ = [
    "QUIET_S",
    "ProbeResult",
    "ProbeStep",
    "Samples",
    "finding_words",
    "largest_amplitude",
    "probe_card",
    "result_document",
    "result_words",
    "too_large_words",
]
