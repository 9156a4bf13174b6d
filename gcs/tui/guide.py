"""The guided first flight: at every moment one or two lines that say what is seen, and which key is next.

Pure: a moment and a screen give a sentence. Nothing is ever pressed for the user, and F3 leaves it anywhere.
"""

from __future__ import annotations

from gcs.desk.state import DeskState
from gcs.tui.next_step import winner
from gcs.tui.state import Mark, Stage, State

LINES = 2
"""As many as it needs at 80 columns."""


def guide_words(state: State, screen: str) -> str:
    """What is seen on this screen now, and which key is next."""
    if state.lost:
        return "The link is lost: on hardware the pilot flies on with the transmitter. Nothing restarts by itself."
    if state.stage.under_way and screen != "Fly":
        return "A card is being flown. 2 goes back to it; F12 ends a run from any screen, also while you type."
    match screen:
        case "Connect":
            return _connect(state)
        case "Fly":
            return _fly(state)
        case "help":
            return "All keys, screen by screen; W shows the words instead. Escape goes back."
        case _:
            return _of_desk(state, screen)


def _connect(state: State) -> str:
    if state.vehicle is None and state.simulated:
        return "A helicopter is started in this computer, with a pilot of its own. 2 shows it."
    if state.vehicle is None:
        return "Choose a line with up and down, enter begins. The first starts a simulated helicopter: no harm is done."
    return "Below stands who is heard, how late the link is, and which station guards it. 2 goes flying."


def _fly(state: State) -> str:
    if state.vehicle is None:
        return "The simulated helicopter is starting; some seconds. The line at the top will show it, with F12 ABORT."
    match state.stage:
        case Stage.READY:
            return (
                "Ready means: settings are written and read back, nothing moves. S starts the sweep, F12 calls it off."
            )
        case Stage.FLYING:
            return _flying(state)
        case Stage.ABORTING:
            return (
                "The run is ended: the vehicle is asked for the mode before, until it shows it. The pilot has it then."
            )
        case Stage.CHECKING:
            return (
                "Before anything moves, link, mode, battery, log, hover and trim are looked at; what is amiss is said."
            )
        case Stage.HELD:
            return _held(state)
        case Stage.CLOSING:
            return "The rest of the vehicle's own log is fetched, until no sample is missing. Then 3 shows the runs."
        case _:
            return _idle(state)


def _idle(state: State) -> str:
    vehicle = state.vehicle
    if any(run.mark is Mark.KEEP for run in state.runs):
        return "The card is over, its runs are on disk. 3 shows them; from there the work goes up the number keys."
    if vehicle is not None and not vehicle.armed:
        return "On the ground. The pilot arms and takes off, never this app: T tells the simulated pilot to."
    return (
        "The strips: roll rate p, pitch rate q, both cyclic commands. Below them the card: R makes its first run ready."
    )


def _flying(state: State) -> str:
    progress = state.progress
    if progress is None or progress.elapsed_s < 0.35 * progress.duration_s:
        return "A sine on the stick that grows faster: the sweep. The strips answer; the pilot only holds position."
    if progress.elapsed_s < 0.7 * progress.duration_s:
        return "The bars: the run's peaks against the card's limits; 100 % aborts it. The bell rings twice half way."
    return "Above some hertz the answer shrinks: there the rotor decides. F12 would end it; else the bell does."


def _held(state: State) -> str:
    if any(run.mark is Mark.AGAIN for run in state.runs):
        return "What was aborted or is to be flown again waits in the list; up and down choose. R makes it ready."
    return "Keep: the rates followed the sweep over the band named (coherence), no gaps. R makes the next run ready."


def _of_desk(state: State, screen: str) -> str:
    desk = state.desk
    if desk.path is None:
        return "Nothing is open yet: a card that was flown opens by itself, O opens a recorded flight."
    match screen:
        case "Runs":
            return (
                "Sweeps fit the model, doublets judge it: a model is only believed on runs it has not seen. 4 is next."
            )
        case "Fit":
            return _fit(desk)
        case "Compare":
            return _compare(desk)
        case "Diagnose" | "Ladder":
            return _asked(state, desk)
        case "Controller":
            return "D designs a controller on the model and says how much gain and delay it bears; 9 ends in a page."
        case _:
            return "W writes one page with all of it. That was the way from a sweep to its cause: F3 ends the guide."


def _fit(desk: DeskState) -> str:
    if not desk.ladder:
        return "F fits two models: CD, a body alone, and TPP, body and rotor disc. One or two seconds."
    return "NRMSE is how much of the motion a model repeats: 100 % is all. TPP has the rotor disc. 5 is next."


def _compare(desk: DeskState) -> str:
    if desk.comparison is None:
        return "C sets the model beside the flight and says where it fails, and how much of that is noise."
    return (
        "The sentence says in which band the model fails. What follows the commands is missing physics. 6 asks which."
    )


def _asked(state: State, desk: DeskState) -> str:
    rung = desk.current
    if rung is None:
        return "A fit comes first: 4, then F."
    if rung.answer is None:
        return "D tries every effect of the catalogue on what is left of the error, and a wrong one as placebo."
    if winner(rung):
        return "The effect that explains most, and how sure that is. A adds it to the model: watch the error fall on 7."
    if rung.verdict == "complete":
        where = "Z opens a sealed answer. " if state.secret is not None else ""
        return f"What is left is noise: the model is complete, as far as these runs can tell. {where}8 is next."
    return "Something is left that no single effect explains; W says which maneuver would tell. 8 is next."
