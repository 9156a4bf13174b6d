"""The flights that the paper's tables and figures are made from: which there are, flying them, finding them again.

Each is flown by the simulated vehicle in a process of its own and recorded over MAVLink as any flight is, in real time:
a ground station cannot follow a faster clock. A flight that came to its end is told in a file beside it, and is not
flown again; one that was cut off stays where it is, and is flown anew beside it.

    DIR/flights/hover-1.json     where it lies, and the SHA-256 of its log
    DIR/flights/hover-1/         the flight's folder, as a sweep leaves it; hover-1.2 where the first was cut off
    DIR/flights/hover-1/vehicle  the vehicle's own log, which the recorded one equals byte for byte
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from gcs import documents
from gcs.cards.maneuver import TestCard, card_text, load_card
from gcs.demo.demo import land, push_gains, require_flown, require_same_bytes, take_off
from gcs.demo.pilot import SimulatedVehicle
from gcs.demo.results import judged
from gcs.errors import TippathError
from gcs.files import write_whole
from gcs.flight.folder import FlightFolder
from gcs.flight.run import Progress
from gcs.flight.session import Session
from gcs.flight.sweep import fly_card
from gcs.logs.cache import digest_of

if TYPE_CHECKING:  # a second to load
    from sysid.control.regulator import Gains
    from sysid.fit.result import Fit

Say = Callable[[str], None]

QUICK_CHIRP_S = 12.0
"""With `--quick`: long enough for two periods of 0.5 Hz, too short for the paper's standard errors."""
AROUND_S = 12.0
"""Starting the vehicle, connecting, reading its settings, and proving its log."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Planned:
    """One flight."""

    name: str
    card: str
    plant: str
    seed: int
    what: str
    more: tuple[str, ...] = ()
    """Further options of the vehicle."""

    def test_card(self, quick: bool) -> TestCard:
        """The bundled card; with `quick` its chirps are shorter."""
        card = load_card(self.card)
        if not quick:
            return card
        shorter = [
            replace(one, duration_s=min(one.duration_s, QUICK_CHIRP_S)) if one.kind == "chirp" else one
            for one in card.maneuvers
        ]
        card = replace(card, maneuvers=tuple(shorter))
        return replace(card, text=card_text(card))

    def takes_s(self, quick: bool) -> float:
        """About how long flying it takes."""
        return self.test_card(quick).duration_s + AROUND_S


def _rotor(rpm: int) -> tuple[str, ...]:
    return ("--hidden", "rotor_speed", "--condition", "calm", "--rpm", str(rpm))


SLOW_RPM, FAST_RPM = 1500, 1650
HOVER_1 = Planned(name="hover-1", card="hover", plant="hover", seed=1, what="Tables 2 to 4, Figures 4, 6, 7")
HOVER_2 = Planned(name="hover-2", card="hover", plant="hover", seed=2, what="the second set of chirps")
TABLE_4 = Planned(
    name="table-4", card="hover", plant="hover-ideal", seed=3, what="Table 4's vehicle, nothing beyond it"
)
FORWARD = Planned(name="forward", card="forward", plant="forward", seed=4, what="Tables 5 and 6, Figures 8 to 10")
SLOW = Planned(
    name="rpm-1500", card="hover", plant="hover-ideal", seed=9, what="section 4.3, 1500 RPM", more=_rotor(SLOW_RPM)
)
FAST = Planned(
    name="rpm-1650", card="hover", plant="hover-ideal", seed=9, what="section 4.3, 1650 RPM", more=_rotor(FAST_RPM)
)
LQR = Planned(name="lqr", card="lqr-doublet", plant="hover", seed=5, what="Figure 5", more=("--on-ground",))


class _FlownDocument(documents.Open, frozen=True, kw_only=True):
    folder: str
    settings: str
    sha256: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Flown:
    """A flight that came to its end."""

    folder: FlightFolder
    sha256: str
    """Of its log."""


@dataclass(frozen=True, kw_only=True)
class Hangar:
    """Where the flights lie, and how they are flown."""

    path: Path
    quick: bool
    say: Say = lambda words: None
    on_progress: Callable[[Progress], None] = lambda progress: None
    aborted: Callable[[], str | None] = lambda: None
    interruptions: Callable[[], int] = lambda: 0

    def found(self, planned: Planned) -> Flown | None:
        """The flight as it was flown before with the same settings; None where it was not, or its log is another
        now."""
        try:
            told = documents.read_json(self._note(planned), _FlownDocument)
            folder = FlightFolder(self.path / told.folder)
            same = told.settings == self._settings(planned) and digest_of(folder.log) == told.sha256
        except (TippathError, OSError):
            return None
        return Flown(folder=folder, sha256=told.sha256) if same else None

    def fly(self, planned: Planned) -> Flown:
        """Fly a card in hover or forward flight, the vehicle aloft from the start.

        Raises TippathError where the vehicle does not start or a run, or one of its samples, is missing.
        """
        folder = self._folder(planned)
        with (
            SimulatedVehicle(planned.plant, folder.path / "vehicle", seed=planned.seed, more=planned.more) as vehicle,
            Session.open(vehicle.ground_link, primary=True, connect_timeout_s=10.0) as session,
        ):
            self._sweep(planned, session, folder)
            require_same_bytes(folder.log, vehicle.directory)
        return self._keep(planned, folder)

    def fly_gains(self, planned: Planned, fit: Fit, gains: Gains) -> Flown:
        """Push gains to the vehicle on the ground, take off, and let them follow rates. Raises as `fly`."""
        from gcs.analysis.standing import NOT_ASKED  # scipy comes along

        folder = self._folder(planned)
        with (
            SimulatedVehicle(planned.plant, folder.path / "vehicle", seed=planned.seed, more=planned.more) as vehicle,
            Session.open(vehicle.ground_link, primary=True, connect_timeout_s=10.0) as session,
        ):
            push_gains(session, judged(gains, fit, NOT_ASKED), self.say)
            take_off(vehicle, session, self.say)
            vehicle.say("lqr on")
            self._sweep(planned, session, folder)
            land(vehicle, session, self.say)
        return self._keep(planned, folder)

    def _sweep(self, planned: Planned, session: Session, folder: FlightFolder) -> None:
        result = fly_card(
            session,
            planned.test_card(self.quick),
            folder=folder,
            on_progress=self.on_progress,
            aborted=self.aborted,
            interruptions=self.interruptions,
            about={"link": session.link, "simulated": {"plant": planned.plant, "seed": planned.seed}},
        )
        require_flown(result, self.aborted)

    def _folder(self, planned: Planned) -> FlightFolder:
        """A new one: what was cut off stays."""
        number = 1
        while True:
            path = self.path / (planned.name if number == 1 else f"{planned.name}.{number}")
            try:
                path.mkdir(parents=True)
                return FlightFolder(path)
            except FileExistsError:
                number += 1
            except OSError as error:
                told = f"{path} cannot be made ({error.strerror or error})"
                raise TippathError(f"{told}; choose another folder with -o DIR") from error

    def _keep(self, planned: Planned, folder: FlightFolder) -> Flown:
        flown = Flown(folder=folder, sha256=digest_of(folder.log))
        told = {
            "folder": folder.path.name,
            "settings": self._settings(planned),
            "sha256": flown.sha256,
        }
        write_whole((json.dumps(told, indent=1) + "\n").encode(), self._note(planned))
        return flown

    def _note(self, planned: Planned) -> Path:
        return self.path / f"{planned.name}.json"

    def _settings(self, planned: Planned) -> str:
        settings = (planned.plant, planned.seed, planned.card, *planned.more)
        return f"{' '.join(map(str, settings))} quick={self.quick}"
