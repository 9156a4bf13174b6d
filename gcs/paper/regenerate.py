"""The whole: which chapters there are, what each needs, and the order; what is there already is not done again.

DIR/flights/      the flights (`gcs.paper.flights`)
DIR/chapters/     one file a chapter, with what it was worked out from
DIR/paper.json    all numbers (`tippath.paper/1`)
DIR/paper.html    the page
"""

from __future__ import annotations

import hashlib
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import msgspec

from gcs import documents
from gcs.errors import TippathError
from gcs.files import write_whole
from gcs.paper import flights
from gcs.paper.flights import Flown, Hangar, Planned
from gcs.paper.values import Chapter, FlightTold, PaperDocument

if TYPE_CHECKING:  # a second to load
    from gcs.paper.forward import ForwardFlight
    from gcs.paper.hover import HoverFlight
    from sysid.control.regulator import Gains
    from sysid.fit.result import Fit

VERSION = "4"
"""Of what the chapters work out: chapters of another are worked out anew."""
LARGEST_CHAPTER = 1 << 25
Say = Callable[[str], None]


@dataclass(frozen=True, kw_only=True)
class Part:
    """A chapter that is to be made."""

    key: str
    heading: str
    needs: tuple[Planned, ...]
    make: Callable[[Workshop], Chapter]
    takes_s: float
    """About how long working it out takes on one core."""


@dataclass(frozen=True, eq=False)
class Workshop:
    """The flights as they are read, once each."""

    flown: Mapping[str, Flown]

    @cached_property
    def _hover(self) -> dict[str, HoverFlight]:
        return {}

    def hover(self, planned: Planned) -> HoverFlight:
        """A hover flight, with its fits when they are asked for."""
        from gcs.paper.hover import HoverFlight

        if planned.name not in self._hover:
            self._hover[planned.name] = HoverFlight.read(self.flown[planned.name].folder.log)
        return self._hover[planned.name]

    @cached_property
    def forward(self) -> ForwardFlight:
        from gcs.paper.forward import ForwardFlight

        return ForwardFlight.read(self.flown[flights.FORWARD.name].folder.log)

    @cached_property
    def gains(self) -> tuple[Fit, Gains]:
        """The paper's LQR on the TPP of the first hover flight."""
        from gcs.demo.demo import identify_runs
        from sysid.control.regulator import design

        identification, _ = identify_runs(self.flown[flights.HOVER_1.name].folder)
        return identification.tpp, design(identification.tpp.model)

    def inputs(self, part: Part) -> str:
        """What the part is worked out from."""
        logs = " ".join(self.flown[one.name].sha256 for one in part.needs)
        return hashlib.sha256(f"{VERSION} {part.key} {logs}".encode()).hexdigest()


# ------------------------------------------------------------------------------------------------ the chapters


def _hover(shop: Workshop) -> Chapter:
    from gcs.cards.maneuver import load_card
    from gcs.paper import hover

    own, bare = shop.hover(flights.HOVER_1), shop.hover(flights.TABLE_4)
    card = load_card(str(shop.flown[flights.HOVER_1.name].folder.card))
    tables = (
        hover.chirp_table(card),
        hover.modes_table(own, bare),
        hover.nrmse_table(own, bare),
        hover.parameter_table(own, bare),
    )
    return _chapter(tables=tables, figures=tuple(hover.hover_figures(own)))


def _two_sets(shop: Workshop) -> Chapter:
    from gcs.paper import hover

    return _chapter(tables=(hover.two_sets_table(shop.hover(flights.HOVER_1), shop.hover(flights.HOVER_2)),))


def _forward(shop: Workshop) -> Chapter:
    from gcs.paper import forward

    tables = (forward.parameter_table(shop.forward), forward.nrmse_table(shop.forward), forward.lag_table(shop.forward))
    return _chapter(tables=tables, figures=tuple(forward.forward_figures(shop.forward)))


def _rotor(shop: Workshop) -> Chapter:
    from gcs.demo.seal import open_answer
    from gcs.paper import rotor

    sealed = open_answer(shop.flown[flights.SLOW.name].folder.path / "vehicle")
    slow, fast = shop.hover(flights.SLOW), shop.hover(flights.FAST)
    return _chapter(tables=rotor.rotor_tables(slow, fast, dict(sealed.document["sizes"])))


def _missing(shop: Workshop) -> Chapter:
    from gcs.paper import missing

    table, text = missing.missing_part(shop.hover(flights.HOVER_1), lambda words: None)
    return _chapter(tables=(table,), listing=text)


def _coupling(shop: Workshop) -> Chapter:
    from gcs.paper import coupling

    own = shop.hover(flights.HOVER_1)
    return _chapter(
        tables=(coupling.coupling_table(own.tpp.model, own.cd.model),), figures=(coupling.coupling_figure(),)
    )


def _control(shop: Workshop) -> Chapter:
    from gcs.paper import control

    _, gains = shop.gains
    runs = control.read_rates(shop.flown[flights.LQR.name].folder.log)
    return _chapter(tables=(control.following_table(runs, gains),), figures=(control.following_figure(runs),))


def _chapter(**holds: object) -> Chapter:
    """Its heading and what it stands on are filled in where it is kept."""
    return msgspec.convert({"heading": "", "inputs": "", **holds}, Chapter)


PARTS = (
    Part(
        key="hover",
        heading="Hover: chirps, modes, fits (sections 4.1 and 4.2)",
        needs=(flights.HOVER_1, flights.TABLE_4),
        make=_hover,
        takes_s=20.0,
    ),
    Part(
        key="two-sets",
        heading="Two sets of chirps (section 4.2)",
        needs=(flights.HOVER_1, flights.HOVER_2),
        make=_two_sets,
        takes_s=10.0,
    ),
    Part(
        key="rotor-speed",
        heading="Rotor speed (section 4.3)",
        needs=(flights.SLOW, flights.FAST),
        make=_rotor,
        takes_s=10.0,
    ),
    Part(
        key="control",
        heading="Rate control in hover (section 5)",
        needs=(flights.HOVER_1, flights.LQR),
        make=_control,
        takes_s=5.0,
    ),
    Part(key="forward", heading="Forward flight (section 6)", needs=(flights.FORWARD,), make=_forward, takes_s=30.0),
    Part(
        key="coupling",
        heading="The controller before the paper (eq. 1)",
        needs=(flights.HOVER_1,),
        make=_coupling,
        takes_s=5.0,
    ),
    Part(
        key="missing",
        heading="What the paper could not say: what TPP lacks on the same flight",
        needs=(flights.HOVER_1,),
        make=_missing,
        takes_s=20.0,
    ),
)


# ------------------------------------------------------------------------------------------------ doing it


@dataclass(kw_only=True)
class _Ahead:
    """Says what is done, and about how long the rest takes."""

    tell: Say
    left_s: float
    began: float

    def next(self, words: str, takes_s: float) -> None:
        minutes, seconds = divmod(int(time.monotonic() - self.began), 60)
        self.tell(f"{minutes}:{seconds:02d}  {words}; about {max(1, round(self.left_s / 60))} min left")
        self.left_s -= takes_s


def regenerate(directory: Path, hangar: Hangar, tell: Say, parts: Sequence[Part] = PARTS) -> PaperDocument:
    """Fly what was not flown, work out what was not worked out, and write paper.json and paper.html.

    Raises TippathError where a flight fails or a file cannot be written, KeyboardInterrupt where somebody wanted the
    end: what is done by then is kept.
    """
    planned = list({one.name: one for part in parts for one in part.needs}.values())
    flown = {one.name: there for one in planned if (there := hangar.found(one)) is not None}
    to_fly = [one for one in planned if one.name not in flown]
    ahead = _Ahead(
        tell=tell,
        left_s=sum(one.takes_s(hangar.quick) for one in to_fly) + sum(part.takes_s for part in parts),
        began=time.monotonic(),
    )
    if flown:
        tell(f"{len(flown)} of {len(planned)} flights are there already")
    for one in to_fly:
        _go_on(hangar)
        ahead.next(f"flying {one.name}: {one.what}", one.takes_s(hangar.quick))
        flown[one.name] = hangar.fly_gains(one, *Workshop(flown).gains) if one is flights.LQR else hangar.fly(one)
    shop = Workshop(flown)
    chapters = []
    for part in parts:
        _go_on(hangar)
        chapters.append(_made(directory, part, shop, ahead))
    document = PaperDocument(
        format="tippath.paper/1",
        quick=hangar.quick,
        flights=tuple(_told(one, flown[one.name]) for one in planned),
        chapters=tuple(chapters),
    )
    save(directory, document)
    return document


def _go_on(hangar: Hangar) -> None:
    if hangar.aborted() is not None:
        raise KeyboardInterrupt


def _made(directory: Path, part: Part, shop: Workshop, ahead: _Ahead) -> Chapter:
    path, inputs = directory / "chapters" / f"{part.key}.json", shop.inputs(part)
    with suppress(TippathError):
        kept = documents.read_json(path, Chapter, largest=LARGEST_CHAPTER)
        if kept.inputs == inputs:
            ahead.left_s -= part.takes_s
            return kept
    ahead.next(f"working out: {part.heading}", part.takes_s)
    made = msgspec.structs.replace(part.make(shop), heading=part.heading, inputs=inputs)
    _put(path, made)
    return made


def _told(planned: Planned, flown: Flown) -> FlightTold:
    return FlightTold(name=planned.name, what=planned.what, folder=flown.folder.path.name, sha256=flown.sha256)


def save(directory: Path, document: PaperDocument) -> None:
    """paper.json and paper.html. Raises TippathError where they cannot be written."""
    from gcs.paper.page import paper_page

    _put(directory / "paper.json", document)
    write_whole(paper_page(document).encode(), directory / "paper.html")


def _put(path: Path, document: msgspec.Struct) -> None:
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise TippathError(
            f"{path.parent} cannot be made ({error.strerror or error}); choose another with -o DIR"
        ) from error
    write_whole(msgspec.json.encode(document) + b"\n", path)
