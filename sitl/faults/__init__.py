"""What goes wrong between the simulated vehicle and the ground, and on board: repeatable from a seed.

Each fault is a small thing of its own, driven by the time that it is given, so a test composes them on a link in
memory with a clock of its own:

- `air`: stages that packets of one direction pass (loss, lag, bandwidth, duplicates, ...), and the link that has them;
- `others`: who else is heard on the link (a second vehicle with the same id, another ground station);
- `impostor`: who gives himself out for the vehicle or the ground;
- `on_board`: what goes wrong in the vehicle (its log, clock, gyro, parameters);
- `words`: all of them as options of a command line, and `script` the same in a file.

`Faults` collects those of one flight. A new fault is a stage, a voice or a trouble more, and an option in `words`.
"""

from __future__ import annotations

from sitl.faults.air import (
    Bandwidth,
    Corruption,
    Duplicates,
    During,
    Faults,
    FaultyLink,
    Lag,
    Loss,
    LossyLink,
    Packet,
    Reordering,
    Stage,
    Trouble,
    Voice,
)
from sitl.faults.on_board import LogStop
from sitl.faults.others import (
    Order,
    OtherStation,
    SecondVehicle,
    StartWatch,
    StrayHeartbeat,
    parameter_write,
    start_of_log,
)
from sitl.faults.windows import ALWAYS, Once, Outage, Way, Window

__all__ = [
    "ALWAYS",
    "Bandwidth",
    "Corruption",
    "Duplicates",
    "During",
    "Faults",
    "FaultyLink",
    "Lag",
    "LogStop",
    "Loss",
    "LossyLink",
    "Once",
    "Order",
    "OtherStation",
    "Outage",
    "Packet",
    "Reordering",
    "SecondVehicle",
    "Stage",
    "StartWatch",
    "StrayHeartbeat",
    "Trouble",
    "Voice",
    "Way",
    "Window",
    "parameter_write",
    "start_of_log",
]
