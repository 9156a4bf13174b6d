"""The parameter table by itself: casts, refusals, and two banks that change over as a whole or not at all."""

from __future__ import annotations

import math
import struct
import zlib

import pytest

from sitl.autopilot.control_laws import LqrGains
from sitl.autopilot.parameters import BANK_MORE, BANK_ORDER, HIDDEN_WITHOUT_AXIS, Kind, Parameters, bank_crc, cast


@pytest.fixture
def parameters() -> Parameters:
    return Parameters(LqrGains.from_values)


def load_shadow(parameters: Parameters, bank: tuple[float, ...]) -> int:
    for name, value in zip(BANK_ORDER, bank, strict=True):
        answer = parameters.write("LQS_" + name, value, armed=True)
        assert answer is not None
        assert answer.value == value
    # Written out once more, from the contract's words rather than with the code under test.
    return zlib.crc32(b"".join(struct.pack("<f", value) for value in bank)) & 0xFFFFFF


def commit(parameters: Parameters, bank: tuple[float, ...]) -> int:
    crc = load_shadow(parameters, bank)
    answer = parameters.write("LQR_COMMIT", crc, armed=False)
    assert answer is not None
    assert answer.value == crc
    assert answer.bank_changed
    return crc


@pytest.mark.parametrize(
    ("kind", "value", "stored"),
    [
        (Kind.INT8, 10.7, 10),
        (Kind.INT8, -10.7, -10),
        (Kind.INT8, 2.9999998, 3),
        (Kind.INT8, 1000, 127),
        (Kind.INT16, -1e9, -32768),
        (Kind.INT32, 16777215.0, 16777215),
        (Kind.REAL32, -1, -1),
        (Kind.REAL32, 1e9, 1e9),
        (Kind.REAL32, 0.1, 0.10000000149011612),
    ],
)
def test_values_are_stored_as_a_c_cast_stores_them(kind: Kind, value: float, stored: float) -> None:
    assert cast(kind, value) == stored


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_no_answer_to_a_value_that_is_not_finite(parameters: Parameters, value: float) -> None:
    assert parameters.write("SID_MAGNITUDE", value, armed=False) is None
    assert parameters["SID_MAGNITUDE"] == pytest.approx(0.05)
    assert parameters.write("LQR_COMMIT", value, armed=False) is None


def test_no_answer_to_a_name_that_does_not_exist(parameters: Parameters) -> None:
    assert parameters.write("SID_NOTHING", 1, armed=False) is None
    assert parameters.read("SID_NOTHING") is None


@pytest.mark.parametrize("name", ["LQR_K11", "LQR_B_LON", "LQR_ACTIVE", "LQR_SW", "SCHED_LOOP_RATE", "SYSID_THISMAV"])
def test_a_write_to_a_read_only_parameter_echoes_the_old_value(parameters: Parameters, name: str) -> None:
    before = parameters[name]
    answer = parameters.write(name, before + 3, armed=False)
    assert answer is not None
    assert answer.value == before == parameters[name]


def test_both_names_of_the_ground_stations_id_are_one_parameter(parameters: Parameters) -> None:
    parameters.write("MAV_GCS_SYSID", 254, armed=True)
    assert parameters["SYSID_MYGCS"] == parameters["MAV_GCS_SYSID"] == 254


def test_the_list_grows_by_six_when_an_axis_is_selected(parameters: Parameters) -> None:
    before = parameters.visible()
    assert not HIDDEN_WITHOUT_AXIS & set(before)
    assert parameters.read("SID_T_REC") is not None
    parameters.write("SID_AXIS", 10, armed=False)
    assert set(parameters.visible()) - set(before) == HIDDEN_WITHOUT_AXIS
    assert parameters.count == len(before) + 6


def test_names_fit_the_wire(parameters: Parameters) -> None:
    assert max(len(name) for name in parameters.table) <= 16
    assert len(BANK_ORDER) == 29


def test_a_commit_needs_the_whole_sets_crc(parameters: Parameters, paper_bank: tuple[float, ...]) -> None:
    crc = load_shadow(parameters, paper_bank)
    assert parameters.active_bank() is None
    wrong = parameters.write("LQR_COMMIT", crc ^ 1, armed=False)
    assert wrong is not None
    assert wrong.value == 0
    assert wrong.text is not None
    assert "refused" in wrong.text
    assert parameters.active_bank() is None
    right = parameters.write("LQR_COMMIT", crc, armed=False)
    assert right is not None
    assert right.value == crc
    assert right.text is None
    assert parameters.active_bank() == paper_bank
    assert parameters["LQR_ACTIVE"] == crc == bank_crc(paper_bank)
    assert [parameters["LQR_" + name] for name in BANK_ORDER] == list(paper_bank)


MORE = (*(0.01,) * 4, 0.1, -0.1, -0.5, 2.0, 30.0, 12.0, 30.0, 0.8, 0.8, *(0.001,) * 12)


def test_a_bank_of_more_is_one_set_too_and_without_it_the_29_are(
    parameters: Parameters, paper_bank: tuple[float, ...]
) -> None:
    first = commit(parameters, paper_bank)
    more = tuple(struct.unpack("<f", struct.pack("<f", value))[0] for value in MORE)
    for name, value in zip(BANK_MORE, more, strict=True):
        parameters.write("LQS_" + name, value, armed=False)
    stale = parameters.write("LQR_COMMIT", first, armed=False)
    assert stale is not None
    assert stale.value == 0, "the 29 alone are another set now"
    whole = zlib.crc32(struct.pack("<54f", *paper_bank, *more)) & 0xFFFFFF
    taken = parameters.write("LQR_COMMIT", whole, armed=False)
    assert taken is not None
    assert taken.value == whole, taken.text
    assert parameters.active_bank() == (*paper_bank, *more)
    parameters.write("LQR_REVERT", 1, armed=False)
    assert parameters.active_bank() == paper_bank
    assert parameters["LQR_F34"] == 0
    parameters.write("LQS_W2", 0, armed=False)
    unknown = parameters.write("LQR_COMMIT", bank_crc((*paper_bank, *more[:10], 0.0, *more[11:])), armed=False)
    assert unknown is not None
    assert unknown.text == "LQR commit refused: what F takes has no frequency or damping"


def test_one_bit_in_one_value_is_another_set(parameters: Parameters, paper_bank: tuple[float, ...]) -> None:
    crc = load_shadow(parameters, paper_bank)
    parameters.write("LQS_G22", math.nextafter(paper_bank[19], 1), armed=False)  # same float32
    answer = parameters.write("LQR_COMMIT", crc, armed=False)
    assert answer is not None
    assert answer.value == crc
    flipped = struct.unpack("<f", struct.pack("<I", struct.unpack("<I", struct.pack("<f", paper_bank[19]))[0] ^ 1))[0]
    parameters.write("LQS_G22", flipped, armed=False)
    answer = parameters.write("LQR_COMMIT", crc, armed=False)
    assert answer is not None
    assert answer.value == 0
    assert parameters.active_bank() == paper_bank


def test_armed_nothing_changes_over(parameters: Parameters, paper_bank: tuple[float, ...]) -> None:
    crc = load_shadow(parameters, paper_bank)
    answer = parameters.write("LQR_COMMIT", crc, armed=True)
    assert answer is not None
    assert (answer.value, answer.text) == (0, "LQR commit refused: armed")
    assert parameters["LQR_ACTIVE"] == 0
    commit(parameters, paper_bank)
    commit(parameters, (*paper_bank[:-1], 0.25))
    answer = parameters.write("LQR_REVERT", 1, armed=True)
    assert answer is not None
    assert (answer.value, answer.text) == (0, "LQR revert refused: armed")
    assert parameters["LQR_B_LON"] == 0.25


def test_an_unstable_observer_is_refused_with_its_reason(parameters: Parameters, paper_bank: tuple[float, ...]) -> None:
    bank = tuple(-value if 8 <= place < 16 else value for place, value in enumerate(paper_bank))
    crc = load_shadow(parameters, bank)
    answer = parameters.write("LQR_COMMIT", crc, armed=False)
    assert answer is not None
    assert (answer.value, answer.text) == (0, "LQR commit refused: the observer is unstable")
    assert parameters.active_bank() is None


def test_revert_swaps_and_swaps_back(parameters: Parameters, paper_bank: tuple[float, ...]) -> None:
    answer = parameters.write("LQR_REVERT", 1, armed=False)
    assert answer is not None
    assert (answer.value, answer.text) == (0, "LQR revert refused: no previous bank")
    first = commit(parameters, paper_bank)
    answer = parameters.write("LQR_REVERT", 1, armed=False)
    assert answer is not None
    assert answer.value == 0  # before the first commit there was no bank
    second = commit(parameters, (*paper_bank[:-1], -0.125))
    for expected in (first, second, first):
        answer = parameters.write("LQR_REVERT", 1, armed=False)
        assert answer is not None
        assert answer.value == 1
        assert answer.bank_changed
        back = parameters.read("LQR_ACTIVE")
        assert back is not None
        assert back.value == expected
        idle = parameters.read("LQR_REVERT")
        assert idle is not None
        assert idle.value == 0


def test_a_write_repeated_because_its_echo_was_lost_acts_once(
    parameters: Parameters, paper_bank: tuple[float, ...]
) -> None:
    first = commit(parameters, paper_bank)
    second = commit(parameters, (*paper_bank[:-1], -0.125))
    again = parameters.write("LQR_COMMIT", second, armed=False)
    assert again is not None
    assert (again.value, again.bank_changed) == (second, False)
    for _ in range(3):
        answer = parameters.write("LQR_REVERT", 1, armed=False)
        assert answer is not None
        assert answer.value == 1
    assert parameters["LQR_ACTIVE"] == first
