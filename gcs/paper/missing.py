"""What the paper could not say: which effect its structure lacks on the same flight, and what it does to the error."""

from __future__ import annotations

from collections.abc import Callable

from gcs.demo.discovery import Discovery, discover
from gcs.paper.hover import HoverFlight
from gcs.paper.rows import noise_floor
from gcs.paper.values import PaperTable, Row
from sysid.fit.identify import identify
from sysid.model.paper import TPP


def missing_part(flight: HoverFlight, tell: Callable[[str], None]) -> tuple[PaperTable, str]:
    """The diagnosis of the flight's TPP as a table of errors, and its answer as text."""
    bare = identify(TPP, flight.chirps, flight.doublets, flight.band_hz)
    found = discover(bare, flight.chirps.records, flight.doublets.records, tell)
    return _table(found, noise_floor(bare, flight.chirps)), found.text


def _table(found: Discovery, floor: dict[str, float]) -> PaperTable:
    last = found.diagnosis.last
    before = found.diagnosis.fit
    grown = None if found.addition is None else found.addition.after
    rows = []
    for word, of_before, of_after in (
        ("chirps", before.nrmse_percent, None if grown is None else grown.nrmse_percent),
        (
            "doublets",
            before.validation_nrmse_percent or {},
            None if grown is None else grown.validation_nrmse_percent,
        ),
    ):
        for output in ("p", "q"):
            beside = {
                "TPP": of_before.get(output),
                "with it": None if of_after is None else of_after.get(output),
                "noise alone": floor.get(output) if word == "chirps" else None,
            }
            rows.append(Row(name=f"{word} {output}", beside=beside, digits=1))
    answer = last.verdict if not last.chain else f"{last.verdict}: {' + '.join(last.chain)}"
    return PaperTable(
        label="Section 7, what is missing",
        caption=f"NRMSE in percent without and with what the diagnosis names ({answer}, confidence "
        f"{last.confidence:.2f}).",
        rows=tuple(rows),
        columns=("TPP", "with it", "noise alone"),
        shows_percent=False,
        shows_values=False,
        why=(
            "Fitted as everywhere else in this program, weighed by the spectrum of what is left; so TPP's NRMSE is not "
            "quite Table 3's, which are fitted by the paper's criterion.",
            "What flew is known here: a servo of 16 Hz and damping 0.75, which is 15 ms late at low frequencies, 6 ms "
            "of delay, play, and inflow that answers late. In this band the first two are nearly one lag, which one "
            "effect can stand for.",
        ),
    )
