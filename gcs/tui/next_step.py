"""What to do now, on each screen, in one line."""

from __future__ import annotations

from typing import TYPE_CHECKING

from gcs.analysis.text.findings import listed_runs
from gcs.desk.state import Choice, DeskState, Rung
from gcs.link.decode import sanitise
from gcs.tui.state import FETCHING, STARTING, Mark, RunView, Stage, State
from gcs.vehicle.autopilots import BY_ITSELF, SYSTEMID
from gcs.vehicle.snapshot import VehicleSnapshot

if TYPE_CHECKING:  # scipy comes along
    from gcs.analysis.proof import FlownProof

PROOF = "proof"
OF_LQR = (PROOF, "lqr-doublet", "ArduPilot proof")
"""Cards on which a controller flies; the first has runs enough to judge it."""
MULTIROTOR_FIT = "tippath fit LOG --model multirotor"
ON_VEHICLE = ("Connect", "Fly", "Controller", "help")
"""Screens on which a vehicle that is not there matters; the others work on what was recorded."""


def next_words(state: State, screen: str) -> str:
    """What to do now."""
    if state.replay is not None and screen in ("Fly", "Connect"):
        return _next_replay(state, screen)
    if state.lost and state.stage in (Stage.FLYING, Stage.ABORTING):
        return "the PILOT ends it with the transmitter; F12 sends a stop unheard"
    if state.stage is Stage.FLYING and screen != "Fly":
        return _flying(state)
    if state.busy:
        return _wait(state, screen)
    if screen in ON_VEHICLE:
        said = _of_vehicle(state, screen)
        if said:
            return said
    match screen:
        case "Connect":
            return _next_connect(state)
        case "Runs":
            return _next_runs(state)
        case "Fit":
            return _next_fit(state)
        case "Compare":
            return _next_compare(state.desk)
        case "Diagnose":
            return _next_diagnose(state.desk)
        case "Ladder":
            return _next_ladder(state.desk)
        case "Controller":
            return _next_controller(state)
        case "Report":
            return _next_report(state.desk)
        case _:
            return _next_fly(state, state.vehicle)


def _next_replay(state: State, screen: str) -> str:
    if screen == "Connect":
        return "a REPLAY is watched (2): no vehicle is listened to; choose a line to leave it"
    return "REPLAY, nothing is sent: P pauses, left/right 5 s, up/down a run, + - speed"


def _wait(state: State, screen: str) -> str:
    desk = state.desk
    asked = desk.ranking is not None and not desk.ranking.over
    if asked and screen == "Diagnose" and not desk.called_off:
        return "wait; K ends it and keeps the ranking so far"
    share = "" if desk.progress is None else f" {100 * desk.progress:.0f} %"
    left = f", {desk.left}" if desk.left else ""
    by_key = (desk.busy and not desk.called_off) or state.busy.startswith(FETCHING)
    off = ("; K ends it, the ranking stays" if asked else "; K calls it off") if by_key else ""
    return f"wait: {sanitise(state.busy)}{share}{left}{off}"


def _flying(state: State) -> str:
    """A run flies while another screen is looked at."""
    run, progress = current(state), state.progress
    left = "" if progress is None else f", {max(0.0, progress.duration_s - progress.elapsed_s):.0f} s left"
    used = "" if state.use is None else f", {state.use.largest:.0f} % of the limits"
    return f"{run.label if run else 'a run'} is FLYING{left}{used}; 2 shows it, F12 aborts"


def _of_vehicle(state: State, screen: str) -> str:
    """What is the matter with the vehicle or the link; empty where nothing is."""
    if state.vehicle is None:
        if screen == "Controller" and (state.desk.designed is None or not state.link):
            return ""  # gains are designed without a vehicle
        if not state.link:
            return "up/down and enter choose where to connect; A types a link" if screen == "Connect" else "1 connects"
        if state.simulated and state.trouble not in (None, STARTING):
            return "the simulated vehicle did not start: 1 begins again, or with another folder (-o DIR)"
        return "wait for the vehicle" + ("" if state.simulated or screen == "Connect" else ", or 1 for another link")
    if state.lost:
        return "nothing is heard: check power, radio, cable; nothing restarts by itself"
    if state.vehicle.link_problem:
        return f"the link: {sanitise(state.vehicle.link_problem)}"
    return ""


def current(state: State) -> RunView | None:
    """The run that is next, ready or flying."""
    return next((run for run in state.runs if run.number == state.current), None)


def _next_connect(state: State) -> str:
    if state.stage.under_way:
        return "a card is being flown (2); the link stays until it is over"
    if state.readiness is not None and not state.readiness.ready:
        return "set these with the vehicle's own station; C twice looks again"
    return "C: what to set before flying; 2 flies a card; 3 works on recorded flights"


def _next_fly(state: State, vehicle: VehicleSnapshot | None) -> str:
    run = current(state)
    match state.stage:
        case Stage.CHECKING:
            return "wait: the vehicle is looked at, nothing moves"
        case Stage.READY:
            return f"S starts {run.label if run else 'the run'}; F12 or space calls it off"
        case Stage.FLYING:
            return "the pilot holds position until the bell; F12 or space aborts"
        case Stage.ABORTING:
            return "wait: the vehicle goes back to the mode before"
        case Stage.CLOSING:
            return "wait: the rest of the log is fetched"
        case Stage.HELD:
            again = " again" if run is not None and run.why else ""
            return f"R: {run.label if run else 'the next run'}{again}; up/down: another run; E ends the card here"
        case _:
            return _next_idle(state, vehicle)


def _next_idle(state: State, vehicle: VehicleSnapshot | None) -> str:
    """On Fly while no card is under way."""
    to_fit = any(run.mark is Mark.KEEP and run.kind == "chirp" for run in state.runs)
    if vehicle is None or not vehicle.armed:
        if _flown_by_lqr(state):
            return "8, then F: flown against predicted"
        if to_fit:
            return "3 shows the runs that were flown; 4, then F fits them"
        return "T: the simulated pilot takes off" if state.simulated else "the pilot arms, takes off and hovers; then R"
    if vehicle.mode == SYSTEMID:
        return "an excitation runs that this app did not start; F12 ends it"
    if vehicle.mode in BY_ITSELF:
        flies = f"{sanitise(vehicle.mode_name)} flies it"
        return (
            f"{flies}; 3 shows the runs; 4, then F fits them" if to_fit else f"{flies}; R once the pilot has it again"
        )
    if _flown_by_lqr(state):
        return "8, then F: flown against predicted; R flies the card again"
    if to_fit:
        return "3 shows the runs; 4, F fits them; R flies the card again into a new folder"
    if any(run.mark in (Mark.KEEP, Mark.AGAIN) for run in state.runs):
        return "R flies the card again into a new folder (nothing moves yet)"
    return "R makes the first run ready (nothing moves yet)"


def _flown_by_lqr(state: State) -> bool:
    """Whether the card that is shown asked the LQR for rates, and the desk has its flight and the gains."""
    flown = any(run.mark in (Mark.KEEP, Mark.AGAIN) for run in state.runs)
    known = state.desk.present is not None and state.desk.path == state.flight and state.desk.proof is None
    return flown and known and state.card in OF_LQR


def _next_runs(state: State) -> str:
    desk = state.desk
    if desk.path is None:
        return _no_flight(state)
    if desk.unkept:
        return "D keeps the results in another folder: this one did not take them"
    fitted, judged = desk.chosen(Choice.FIT), desk.chosen(Choice.VALIDATE)
    if not fitted:
        return "F uses a run to fit: at least a roll and a pitch chirp"
    swept = {run.axis for run in (*fitted, *judged) if run.maneuver == "chirp"}
    if len(swept) == 1 and swept < {"roll", "pitch"}:
        return f"only {swept.pop()} is swept here: O opens a second log with it; or 4 fits this"
    with_judges = (
        f", checked on {len(judged)} other{'s' if len(judged) > 1 else ''}" if judged else "; V on a run lets it judge"
    )
    return f"4 fits {len(fitted)} run{'s' if len(fitted) > 1 else ''}{with_judges}"


def _no_flight(state: State) -> str:
    if state.stage.under_way:
        return "the card is still being flown (2); its runs come after it"
    return "O opens a flight folder or a log; 2 flies a card"


def _next_fit(state: State) -> str:
    desk = state.desk
    if state.stage.under_way:
        return "the card is still being flown (2); the fit comes after it"
    if desk.path is None and state.flight is None:
        return _no_flight(state)
    if desk.path is not None and not desk.chosen(Choice.FIT):
        return "3 chooses runs to fit: at least a roll and a pitch chirp"
    if not desk.ladder and desk.of_multirotor:
        return f"F fits TPP and CD all the same; a shell has its model: {MULTIROTOR_FIT}"
    if not desk.ladder:
        return "F fits TPP and CD to the chosen runs"
    if chosen_anew(desk):
        return "F fits again: runs or base were chosen anew"
    return "5 shows where the fit fails"


def chosen_anew(desk: DeskState) -> bool:
    """Whether the runs or the base are other ones than the fit's."""
    if desk.fitted is None or not desk.ladder:
        return False
    structure = desk.ladder[0].fit.model.structure
    based = structure.base != desk.base.model
    # without the folder, which the fit's own runs are not named by
    chosen = tuple({run.id.rpartition("/")[2] for run in desk.chosen(one)} for one in (Choice.FIT, Choice.VALIDATE))
    return based or chosen != (set(desk.fitted.runs), set(desk.fitted.validation))


def _next_compare(desk: DeskState) -> str:
    rung = desk.current
    if rung is None:
        return "4 fits a flight first"
    if rung.comparison is None:
        return f"C compares {full_name(desk)} with its runs"
    return "6 asks which effect is missing"


def _next_diagnose(desk: DeskState) -> str:
    rung = desk.current
    if rung is None:
        return "4 fits a flight first"
    if rung.answer is None:
        return f"D asks what {full_name(desk)} lacks"
    return _after_verdict(desk, rung)


def _after_verdict(desk: DeskState, rung: Rung) -> str:
    last = rung.answer
    assert last is not None
    if last.verdict == "complete":
        return "E: what may hide could matter; else 8 designs gains on it" if last.matters else "8 designs gains on it"
    if last.verdict == "missing" and winner(rung):
        return f"A adds {sanitise(winner(rung))}; U takes it back"
    if last.plan is not None and last.plan.fit_runs:
        return f"3, then F marks {sanitise(listed_runs(last.plan.fit_runs))}; 4, then F fits them too"
    if last.plan is not None and last.plan.card is not None:
        if desk.card is not None:
            return f"2, then C: fly {sanitise(desk.card.name)}, the card that would tell"
        return "W writes the card that would tell more; I adds an effect that you choose"
    return "I adds an effect that you choose; E says why nothing known does"


def winner(rung: Rung) -> str:
    """The effect to add; empty where there is none."""
    return "" if rung.answer is None else rung.answer.missing


def full_name(desk: DeskState) -> str:
    """`TPP + servo_lag`."""
    return sanitise(" ".join(one.name for one in desk.ladder))


def _next_ladder(desk: DeskState) -> str:
    rung = desk.current
    if rung is None:
        return "4 fits a flight first: the fit is the lowest rung"
    if rung.answer is None:
        return f"D asks what {full_name(desk)} lacks"
    return _after_verdict(desk, rung)


def _next_controller(state: State) -> str:
    designed, desk = state.designed, state.desk
    if designed is None and desk.present is not None and not desk.ladder:
        return "F: flown against predicted" if desk.proof is None else _after_proof(desk.proof)
    if designed is None:
        return "D designs gains" if desk.ladder or state.fitted is not None else "4 fits a flight first"
    shadow = "" if designed.shadow is not None or not desk.chosen(Choice.FIT) else "S: the shadow over these runs; "
    if state.vehicle is None:
        return f"{shadow}1 connects, to push them; 9 writes the report"
    if state.bank is not None and state.bank.active == designed.crc:
        if state.bank.switch_on:
            return "the LQR flies; card proof (2, C), then F here: flown against predicted"
        switch = "B" if state.simulated else "the pilot's switch"
        return f"in the air {switch} puts the LQR on; then card proof (2, C), and F here"
    if state.vehicle.armed:
        return (
            "L: the simulated pilot lands; then P" if state.simulated else "the pilot lands and disarms; then P pushes"
        )
    return f"{shadow}P pushes them to the vehicle (asks first)"


def _after_proof(found: FlownProof) -> str:
    if found.proof.verdict == "too few to say":
        return f"2, C: card {PROOF} has enough runs to be judged; X: the next run"
    return "X: the next run; 4 fits this flight"


def _next_report(desk: DeskState) -> str:
    if desk.path is None:
        return "3 opens a flight first"
    if not desk.ladder:
        return "4 fits the flight first; the report is made of fits"
    if desk.unkept:
        return "3, then D keeps the results in another folder; then W writes the page"
    if desk.report is None:
        return "W writes the report page, P that and a PDF"
    return "open the page in a browser; W writes it anew"
