"""Two sets of rate gains behind the pilot's switch: the script that is shipped, run, and its imitation do the same."""

from __future__ import annotations

import random
import struct
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any, Protocol

import lupa.lua53
import pytest

from sitl.autopilot.gain_switch import FLOWN, NEW, OLD, PERIOD_S
from sitl.autopilot.modes import Phase
from sitl.autopilot.parameters import float32
from sitl.autopilot.vehicle import make_vehicle
from sitl.pilot import obey

SCRIPT = Path(__file__).resolve().parents[2] / "gcs" / "vehicle" / "scripts" / "tippath_gains.lua"
FLOWN_SET = (0.135, 0.135, 0.0036, 0.0, 0.135, 0.135, 0.0036, 0.0)
NEW_SET = (0.17, 0.15, 0.004, 0.01, 0.16, 0.14, 0.003, 0.02)


def crc(values: tuple[float, ...]) -> int:
    return zlib.crc32(struct.pack("<8f", *values)) & 0xFFFFFF


class Carrier(Protocol):
    """What a script runs on."""

    @property
    def said(self) -> list[str]: ...
    def read(self, name: str) -> float: ...
    def write(self, name: str, value: float) -> None: ...
    def turn(self, position: str) -> None: ...
    def arm(self, armed: bool) -> None: ...
    def look(self) -> None: ...
    def restart(self) -> None: ...


class Imitated:
    """The simulated vehicle."""

    def __init__(self) -> None:
        self.vehicle = make_vehicle("quad", 1, on_ground=True, like="ardupilot-quad", gain_switch=True)
        self.vehicle.texts.clear()
        self.look()

    @property
    def said(self) -> list[str]:
        return [text for _, text in self.vehicle.texts if text.startswith("tippath gains")]

    def read(self, name: str) -> float:
        return self.vehicle.parameters[name]

    def write(self, name: str, value: float) -> None:
        assert self.vehicle.write_parameter(name, value) is not None

    def turn(self, position: str) -> None:
        assert obey(self.vehicle, f"switch {position}") == "ok"

    def arm(self, armed: bool) -> None:
        self.vehicle.phase = Phase.LANDED if armed else Phase.DISARMED

    def look(self) -> None:
        assert self.vehicle.gain_switch is not None
        self.vehicle.gain_switch.pass_by(PERIOD_S)

    def restart(self) -> None:
        self.vehicle.restart(on_ground=True)
        self.look()  # as a script does when it is loaded


class Run:
    """The script itself in a Lua 5.3, on an autopilot of a few lines."""

    def __init__(self) -> None:
        self.saved = dict(zip(FLOWN, map(float32, FLOWN_SET), strict=True))
        self.said: list[str] = []
        self.position: int | None = 0
        self._boot()

    def _boot(self) -> None:
        self.armed = False
        self.ram = dict(self.saved)
        self.load()

    def load(self) -> None:
        """As a restart of scripts alone."""
        self.lua = lupa.lua53.LuaRuntime(unpack_returned_tuples=True)
        prefix: list[str] = []

        def add_table(_: Any, __: int, name: str, most: int) -> bool:
            prefix.append(name)
            return most <= 63

        def add_param(_: Any, __: int, ___: int, name: str, value: float) -> bool:
            self.ram.setdefault(prefix[0] + name, float32(value))
            return len(prefix[0] + name) <= 16

        def parameter(name: str) -> Any:
            assert name in self.ram, f"No parameter: {name}"

            def put(_: Any, value: float) -> bool:
                self.ram[name] = float32(value)
                return True

            def put_and_save(_: Any, value: float) -> bool:
                self.saved[name] = self.ram[name] = float32(value)
                return True

            return self.lua.table(get=lambda _: self.ram[name], set=put, set_and_save=put_and_save)

        table, channel = self.lua.table, self.lua.table(get_aux_switch_pos=lambda _: self.position)
        has: dict[str, Any] = {
            "param": table(add_table=add_table, add_param=add_param),
            "Parameter": parameter,
            "gcs": table(send_text=lambda _, __, text: self.said.append(text)),
            "arming": table(is_armed=lambda _: self.armed),
            "rc": table(
                find_channel_for_option=lambda _, option: channel if option == 300 else None,
                has_valid_input=lambda _: self.position is not None,
            ),
        }
        for name, value in has.items():
            self.lua.globals()[name] = value
        self.update, every_ms = self.lua.execute(SCRIPT.read_text())
        assert every_ms == 1000 * PERIOD_S

    def read(self, name: str) -> float:
        return self.ram[name]

    def write(self, name: str, value: float) -> None:
        self.saved[name] = self.ram[name] = float32(value)

    def turn(self, position: str) -> None:
        self.position = {"low": 0, "middle": 1, "high": 2}[position]

    def arm(self, armed: bool) -> None:
        self.armed = armed

    def look(self) -> None:
        self.update, _ = self.update()

    def restart(self) -> None:
        self._boot()


@pytest.fixture(params=[Imitated, Run], ids=["imitated", "run"])
def carrier(request: pytest.FixtureRequest) -> Carrier:
    made: Callable[[], Carrier] = request.param
    return made()


def flown(carrier: Carrier) -> tuple[float, ...]:
    return tuple(carrier.read(name) for name in FLOWN)


def as_held(values: tuple[float, ...]) -> tuple[float, ...]:
    return tuple(map(float32, values))


def commit(carrier: Carrier, values: tuple[float, ...] = NEW_SET, checksum: int | None = None) -> None:
    for name, value in zip(NEW, values, strict=True):
        carrier.write(name, value)
    carrier.write("TPG_COMMIT", crc(values) if checksum is None else checksum)
    carrier.look()


def test_a_new_set_flies_while_the_switch_is_high_and_the_old_one_else(carrier: Carrier) -> None:
    carrier.look()
    commit(carrier)
    assert (carrier.read("TPG_COMMIT"), carrier.read("TPG_ACTIVE")) == (0, crc(NEW_SET))
    assert tuple(carrier.read(name) for name in OLD) == flown(carrier) == as_held(FLOWN_SET)
    carrier.look()
    carrier.arm(True)
    carrier.turn("high")
    carrier.look()
    assert flown(carrier) == as_held(NEW_SET)
    assert carrier.read("TPG_FLIES") == 1
    carrier.turn("middle")
    carrier.look()
    assert flown(carrier) == as_held(FLOWN_SET)
    assert carrier.said[-3:] == [
        f"tippath gains: set {crc(NEW_SET):06x} is behind the switch",
        "tippath gains: new set flies",
        "tippath gains: old set flies",
    ]


def test_a_switch_that_was_high_all_the_time_flies_nothing_new(carrier: Carrier) -> None:
    carrier.turn("high")
    commit(carrier)
    for _ in range(3):
        carrier.look()
    assert flown(carrier) == as_held(FLOWN_SET)
    assert carrier.said[-1] == "tippath gains: switch was not low since the commit: old set flies"
    assert len(carrier.said) == 2


def test_an_armed_vehicle_and_a_wrong_checksum_take_no_set(carrier: Carrier) -> None:
    carrier.arm(True)
    commit(carrier)
    assert (carrier.read("TPG_ACTIVE"), carrier.said) == (0, ["tippath gains: commit refused: armed"])
    carrier.arm(False)
    commit(carrier, checksum=0xABCDEF)
    assert carrier.read("TPG_ACTIVE") == 0
    assert carrier.said[-1] == f"tippath gains: commit refused: CRC abcdef, new set {crc(NEW_SET):06x}"


def test_a_set_is_forgotten(carrier: Carrier) -> None:
    commit(carrier)
    carrier.look()
    carrier.turn("high")
    carrier.look()
    carrier.write("TPG_COMMIT", -1)
    carrier.look()
    carrier.turn("low")
    carrier.look()
    carrier.turn("high")
    carrier.look()
    assert (carrier.read("TPG_ACTIVE"), carrier.read("TPG_FLIES")) == (0, 0)
    assert flown(carrier) == as_held(FLOWN_SET)


def test_a_restart_flies_the_old_set_and_keeps_the_new_one_behind_the_switch(carrier: Carrier) -> None:
    commit(carrier)
    carrier.look()
    carrier.turn("high")
    carrier.look()
    carrier.restart()
    assert flown(carrier) == as_held(FLOWN_SET)
    carrier.look()
    assert flown(carrier) == as_held(FLOWN_SET)
    carrier.turn("low")
    carrier.look()
    carrier.turn("high")
    carrier.look()
    assert flown(carrier) == as_held(NEW_SET)


def test_a_damaged_set_is_forgotten_at_the_start(carrier: Carrier) -> None:
    commit(carrier)
    carrier.write(NEW[2], 0.5)
    carrier.restart()
    assert carrier.read("TPG_ACTIVE") == 0
    assert carrier.said[-1] == f"tippath gains: set {crc(NEW_SET):06x} is damaged, and forgotten"


def test_gains_that_somebody_changed_since_are_left(carrier: Carrier) -> None:
    commit(carrier)
    carrier.look()
    carrier.write(FLOWN[0], 0.2)
    carrier.turn("high")
    carrier.look()
    assert flown(carrier) == as_held((0.2, *FLOWN_SET[1:]))
    assert carrier.said[-1] == "tippath gains: gains are others than at the commit: nothing is switched"


def test_the_script_and_its_imitation_do_the_same_whatever_happens() -> None:
    rng = random.Random(17)
    both: tuple[Carrier, Carrier] = (Imitated(), Run())
    names = (*FLOWN, *NEW, *OLD, "TPG_COMMIT", "TPG_ACTIVE", "TPG_FLIES")
    flew, history = 0, []
    for _ in range(3000):
        move = rng.choice(("turn", "turn", "look", "look", "look", "arm", "commit", "write", "restart"))
        position, armed = rng.choice(("low", "middle", "high", "high")), rng.random() < 0.3
        value, name = rng.choice((0.0, 0.1, 0.2)), rng.choice((*FLOWN[:2], *NEW[:2]))
        values = (value, *NEW_SET[1:])
        wanted = rng.choice((crc(values), crc(values), -1, 5))
        history.append((move, position, armed, name, value, wanted))
        for one in both:
            match move:
                case "turn":
                    one.turn(position)
                case "look":
                    one.look()
                case "arm":
                    one.arm(armed)
                case "commit":
                    commit(one, values, wanted)
                case "write" if value == 0.1:
                    one.write(name, value)
                case "restart" if armed:
                    one.restart()
        a, b = ({name: one.read(name) for name in names} for one in both)
        assert a == b, (history[-12:], [one.said[-4:] for one in both])
        assert both[0].said[-50:] == both[1].said[-50:]
        flew += a["TPG_FLIES"] == 1
    assert flew > 50


def test_a_script_that_is_loaded_again_in_flight_knows_what_flies() -> None:
    one = Run()
    commit(one)
    one.look()
    one.turn("high")
    one.look()
    one.load()
    one.look()
    assert (flown(one), one.read("TPG_FLIES")) == (as_held(NEW_SET), 1)
    one.turn("low")
    one.look()
    assert flown(one) == as_held(FLOWN_SET)


def test_the_pilot_turns_the_switch_of_a_vehicle_that_has_one() -> None:
    with_script, without = (make_vehicle("quad", 1, like="ardupilot-quad", gain_switch=has) for has in (True, False))
    assert obey(with_script, "switch high") == "ok"
    assert obey(with_script, "switch up").startswith("refused: unknown line")
    assert obey(without, "switch high") == "refused: no script holds gains behind a switch"
    assert "TPG_ACTIVE" in with_script.parameters
    assert "TPG_ACTIVE" not in without.parameters


def test_new_gains_act_in_flight() -> None:
    vehicle = make_vehicle("quad", 1, like="ardupilot-quad", gain_switch=True)
    for name, value in zip(NEW, NEW_SET, strict=True):
        vehicle.parameters.put(name, value, saved=True)
    vehicle.parameters.put("TPG_ACTIVE", crc(NEW_SET), saved=True)
    for name, value in zip(OLD, FLOWN_SET, strict=True):
        vehicle.parameters.put(name, value, saved=True)
    vehicle.restart(on_ground=False)
    for position in ("low", "high"):
        assert obey(vehicle, f"switch {position}") == "ok"
        for _ in range(100):
            vehicle.step()
    assert vehicle.parameters["ATC_RAT_RLL_P"] == float32(0.17)
    assert [text for _, text in vehicle.texts][-1] == "tippath gains: new set flies"
