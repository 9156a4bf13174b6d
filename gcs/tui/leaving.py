"""What is asked before the app, or the link to a vehicle, is left. Pure, as `words`."""

from __future__ import annotations

from gcs.tui.state import Stage, State

HEARTBEAT = (
    "This station's heartbeat ends with the link; where the vehicle's failsafe listens to it, the vehicle acts on that."
)
STAYS = "Nothing else changes: the pilot has it."


def before_quitting(state: State) -> tuple[str, ...]:
    """What a yes does where something is under way, flies or is kept nowhere yet; empty where nothing need be asked."""
    if state.stage in (Stage.HELD, Stage.READY):
        return ("A card is under way, and no run flies. Yes ends the card, completes the log, and then quits.",)
    if state.stage.under_way:
        return (
            "A card is under way. Yes aborts the run first, waits until the vehicle is back in the mode before it, "
            "completes the log, and then quits.",
        )
    unkept = state.desk.unkept
    kept = (f"Not kept yet: {', '.join(unkept)}. N, then 3 and D keeps them in another folder.",) if unkept else ()
    return (*_in_the_air(state), *kept)


def _in_the_air(state: State) -> tuple[str, ...]:
    """What becomes of a vehicle that is left armed. A simulated one ends with the app: asked under the LQR only."""
    vehicle = state.vehicle
    if vehicle is None or vehicle.lost or not vehicle.armed or state.replay is not None:
        return ()
    lqr = state.bank is not None and bool(state.bank.active) and bool(state.bank.switch_on)
    if state.simulated:
        ends = "The LQR flies the simulated vehicle, which ends with the app."
        return (f"{ends} A real one would fly on under it, until its pilot's switch ends that.",) if lqr else ()
    if lqr:
        flies = "The LQR flies the vehicle, and goes on: only the pilot's switch ends it, and nobody here sees it then."
        return (flies, HEARTBEAT)
    return (f"The vehicle is armed. {HEARTBEAT} {STAYS}",)
