"""What a residual looks like that no effect of the catalogue explains: a slow mode, or a simple term."""

from __future__ import annotations

from gcs.analysis.diagnosis import of_responses
from gcs.analysis.ladder import short_names
from sysid.diagnose.verdict import Diagnosis


def beyond_sentences(last: Diagnosis) -> tuple[str, ...]:
    """Of what is unexplained: a slow mode, and the simple term that does more than the nearest effect, or the first
    beside that."""
    if last.verdict != "unexplained":
        return ()
    sentences = []
    if last.mode is not None:
        frequency_hz = last.mode.frequency_hz
        sentences.append(f"a slow mode at {frequency_hz:.2g} Hz would do much: a load that swings, fuel that sloshes")
    beside = () if last.terms is None else last.terms.terms
    term = last.term or next(iter(beside), None)
    if term is not None and not of_responses(last):
        others = f" ({len(term.as_well)} others do as well)" if term.as_well else ""
        does = (
            "would do much"
            if last.term is None
            else f"alone does {_how_much(last)} {' + '.join(short_names(last.chain))}"
        )
        sentences.append(f"a simple term {does}: {term.entry.equation}{others}")
    return tuple(sentences)


def _how_much(last: Diagnosis) -> str:
    """Of what is nearest: a limit only resembles what a power of the commands does nearly as well."""
    more = last.term is None or last.winner is None or last.term.chi_squared > last.winner.chi_squared
    return "more than" if more else "as much as"
