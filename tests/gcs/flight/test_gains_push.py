"""Push and revert against a scripted bank: every bit proved, nothing acted twice, refusals in the vehicle's words."""

from __future__ import annotations

import argparse
import copy
import json
import random
import struct
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import jsonschema
import pytest
from contract_schemas import GAINS
from damaged_documents import FILES, changed

from gcs import documents
from gcs.cli import push as push_command
from gcs.cli import revert as revert_command
from gcs.errors import LinkError
from gcs.flight.gains import BANK, MORE, GainsDocument, GainsError, gains_of, load_gains, push, revert
from gcs.flight.session import Session
from gcs.link.procedures import RefusedError


@pytest.fixture
def session(vehicle: Any, connect: Callable[..., Session]) -> Iterator[Session]:
    vehicle.offer_bank()
    with connect() as opened:
        yield opened


def active(vehicle: Any) -> tuple[int, ...]:
    return tuple(vehicle.parameters[f"LQR_{name}"][0] for name in BANK)


MORE_DOCUMENT: dict[str, Any] = {
    "elevator": {"K": [0.5, 0.25, -1.5, 2.0], "prefilter": [0.75, -0.5]},
    "dynamic_prefilter": {
        "frequency_rad_s": [12.0, 30.0],
        "damping": [0.8, 0.75],
        "F": [[1.0, 2.0, 3.0, 4.0], [5.0, 6.0, 7.0, 8.0], [9.0, 10.0, 11.0, 12.0]],
    },
}


def with_more(document: dict[str, Any]) -> dict[str, Any]:
    parameters = {**document["model"]["parameters"], "L_p": -0.5, "M_q": 2.5, "M_elev": 37.5}
    return {**document, **MORE_DOCUMENT, "model": {"structure": "tpp", "parameters": parameters}}


def test_elevator_and_dynamic_prefilter_stand_behind_the_29(gains_document: dict[str, Any]) -> None:
    gains = gains_of(with_more(gains_document))
    assert gains.bits[:29] == gains_of(gains_document).bits
    flat = [0.5, 0.25, -1.5, 2.0, 0.75, -0.5, -0.5, 2.5, 37.5, 12.0, 30.0, 0.8, 0.75, *range(1, 13)]
    assert struct.pack("<25I", *gains.bits[29:]) == struct.pack("<25f", *flat)
    assert gains.crc == zlib.crc32(struct.pack("<54I", *gains.bits)) & 0xFFFFFF
    assert list(gains.values)[29:42:6] == ["K31", "L_P", "Z2"]
    assert gains_of(gains_document).whole.crc == gains_of(gains_document).crc
    two = {**gains_document, "dynamic_prefilter": {**MORE_DOCUMENT["dynamic_prefilter"], "F": [[1.0] * 4] * 2}}
    assert [name for name, value in gains_of(two).values.items() if name[0] in "FW" and value == 0] == [
        "F31",
        "F32",
        "F33",
        "F34",
    ]


@pytest.mark.parametrize(
    ("key", "value", "match"),
    [
        ("F", [[1.0] * 4], "F has 1 rows, not one for each command"),
        ("damping", [0.8, 0.0], "frequency_rad_s and damping are positive"),
        ("frequency_rad_s", [float("nan"), 1.0], "frequency_rad_s"),
    ],
)
def test_a_dynamic_prefilter_that_is_none_is_refused(
    gains_document: dict[str, Any], key: str, value: Any, match: str
) -> None:
    document = with_more(gains_document)
    document["dynamic_prefilter"] = {**document["dynamic_prefilter"], key: value}
    with pytest.raises(GainsError, match=match):
        gains_of(document)


def test_a_bank_that_has_more_takes_a_set_with_it_and_one_without(
    vehicle: Any, connect: Callable[..., Session], gains_document: dict[str, Any]
) -> None:
    vehicle.offer_bank(more=True)
    with connect() as session:
        full = gains_of(with_more(gains_document))
        assert push(session, full).crc == full.crc
        assert vehicle.parameters["LQR_F34"][0] == full.bits[-1]
        bare = gains_of(gains_document)
        result = push(session, bare)
        assert (result.crc, result.previous_crc, len(result.values)) == (bare.crc, full.crc, 54)
        assert all(vehicle.parameters[f"LQR_{name}"][0] == 0 for name in MORE)
        assert push(session, bare).committed is False
        assert revert(session).crc == full.crc


def test_a_bank_without_it_is_told_and_nothing_is_written(
    session: Session, vehicle: Any, gains_document: dict[str, Any]
) -> None:
    with pytest.raises(GainsError, match=r"no parameter LQS_F11.*--prefilter steady") as caught:
        push(session, gains_of(with_more(gains_document)))
    assert caught.value.reason == "no bank"
    assert not any(m.get_type() == "PARAM_SET" for m in vehicle.heard)


def writes(vehicle: Any, name: str) -> int:
    return sum(m.get_type() == "PARAM_SET" and m.param_id == name for m in vehicle.heard)


def test_the_bank_is_in_the_agreed_order(gains_document: dict[str, Any]) -> None:
    gains = gains_of(gains_document)
    flat = [
        *(v for row in gains_document["K"] for v in row),
        *(v for row in gains_document["observer_gain"] for v in row),
        *(v for row in gains_document["prefilter"] for v in row),
        *range(1, 10),
    ]
    packed = struct.pack("<29f", *flat)
    assert struct.pack("<29I", *gains.bits) == packed
    assert gains.crc == zlib.crc32(packed) & 0xFFFFFF
    assert list(gains.values)[:5] == ["K11", "K12", "K13", "K14", "K21"]
    assert list(gains.values)[-3:] == ["A_LON", "B_LAT", "B_LON"]


def test_a_push_is_proved_bit_for_bit_and_a_revert_goes_back(
    session: Session, vehicle: Any, gains_document: dict[str, Any]
) -> None:
    first = gains_of(gains_document)
    result = push(session, first)
    assert (result.committed, result.crc, result.previous_crc) == (True, first.crc, 0)
    assert active(vehicle) == first.bits
    assert result.switch_on is False
    gains_document["K"][0][0] = 9.0
    second = gains_of(gains_document)
    assert push(session, second).previous_crc == first.crc
    assert active(vehicle) == second.bits
    back = revert(session)
    assert (back.crc, back.reverted_crc) == (first.crc, second.crc)
    assert active(vehicle) == first.bits
    json.dumps([result.to_json(), back.to_json()], allow_nan=False)


def test_the_same_set_is_not_committed_twice(session: Session, vehicle: Any, gains_document: dict[str, Any]) -> None:
    gains = gains_of(gains_document)
    push(session, gains)
    assert not push(session, gains).committed
    assert writes(vehicle, "LQR_COMMIT") == 1


def test_a_refused_commit_says_why_and_changes_nothing(
    session: Session, vehicle: Any, gains_document: dict[str, Any]
) -> None:
    vehicle.commit_refusal = "armed"
    with pytest.raises(GainsError, match=r"LQR commit refused: armed; the active bank is as before"):
        push(session, gains_of(gains_document))
    assert active(vehicle) == (0,) * 29


def test_nothing_is_written_to_an_armed_vehicle(
    session: Session, vehicle: Any, gains_document: dict[str, Any], fake_time: Any
) -> None:
    vehicle.armed = True
    fake_time.until(lambda: session.snapshot().armed)
    for move in (lambda: push(session, gains_of(gains_document)), lambda: revert(session)):
        with pytest.raises(GainsError, match="the vehicle is armed: land and disarm first"):
            move()
    assert not [m for m in vehicle.heard if m.get_type() == "PARAM_SET"]


def test_a_checksum_is_hexadecimal_also_in_a_refusal(
    session: Session, vehicle: Any, gains_document: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    gains = gains_of(gains_document)
    vehicle.commit_refusal = "armed"
    monkeypatch.setattr(vehicle, "text", lambda *_: None)  # its words get lost: ours are left
    with pytest.raises(GainsError) as caught:
        push(session, gains)
    assert f"{gains.crc:06x}" in str(caught.value)
    assert str(gains.crc) not in str(caught.value)


def test_a_commit_whose_answer_is_lost_is_not_repeated(
    session: Session, vehicle: Any, gains_document: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    plain = vehicle.echo
    monkeypatch.setattr(vehicle, "echo", lambda name, *a: None if name == "LQR_COMMIT" else plain(name, *a))
    result = push(session, gains_of(gains_document))
    assert result.committed
    assert writes(vehicle, "LQR_COMMIT") == 1


def test_a_revert_whose_answer_is_lost_is_not_repeated(
    session: Session, vehicle: Any, gains_document: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    push(session, gains_of(gains_document))
    plain = vehicle.echo
    monkeypatch.setattr(vehicle, "echo", lambda name, *a: None if name == "LQR_REVERT" else plain(name, *a))
    assert revert(session).crc == 0
    assert writes(vehicle, "LQR_REVERT") == 1


def test_a_commit_that_never_arrived_is_sent_again(
    session: Session, vehicle: Any, gains_document: dict[str, Any]
) -> None:
    lost: list[Any] = []

    def first_one(m: Any) -> bool:
        if m.get_type() == "PARAM_SET" and m.param_id == "LQR_COMMIT" and not lost:
            lost.append(m)
            return True
        return False

    vehicle.deaf = first_one
    assert push(session, gains_of(gains_document)).committed
    assert writes(vehicle, "LQR_COMMIT") == 2


def test_a_shadow_bank_that_rounds_is_caught_before_the_commit(
    session: Session, vehicle: Any, gains_document: dict[str, Any]
) -> None:
    keep = vehicle._set

    def echo_but_forget(name: str, bits: int) -> None:
        keep(name, bits)
        if name == "LQS_L12":  # a denormal: some processors flush it to zero
            vehicle.parameters[name] = (0, 9)

    vehicle._set = echo_but_forget
    with pytest.raises(GainsError, match=r"shadow bank differs .* L12; nothing was committed"):
        push(session, gains_of(gains_document))
    assert writes(vehicle, "LQR_COMMIT") == 0


def test_a_value_that_is_refused_ends_the_push(session: Session, vehicle: Any, gains_document: dict[str, Any]) -> None:
    vehicle.read_only.add("LQS_G11")
    with pytest.raises(RefusedError, match="LQS_G11"):
        push(session, gains_of(gains_document))
    assert writes(vehicle, "LQR_COMMIT") == 0


def test_nothing_to_go_back_to(session: Session) -> None:
    with pytest.raises(GainsError, match="no previous bank"):
        revert(session)


def test_a_vehicle_without_the_bank(connect: Any, gains_document: dict[str, Any]) -> None:
    with (
        connect() as session,
        pytest.raises(GainsError, match="this vehicle offers no LQR bank"),
    ):
        push(session, gains_of(gains_document))


def test_a_link_lost_under_way_is_called_that(
    session: Session, vehicle: Any, gains_document: dict[str, Any], fake_time: Any
) -> None:
    def leave(m: Any) -> bool:
        if m.get_type() == "PARAM_SET" and m.param_id == "LQS_L11":
            vehicle.mute = True
            fake_time.at += 5.0
        return False

    vehicle.deaf = leave
    with pytest.raises(LinkError, match="link to the vehicle is lost"):
        push(session, gains_of(gains_document))


BAD: list[tuple[Callable[[dict[str, Any]], object], str]] = [
    (lambda d: d.update(format="tippath.fit/1"), "format is 'tippath.gains/1', not 'tippath.fit/1'; .*tippath design"),
    (lambda d: d.pop("K"), "K is missing"),
    (lambda d: d["K"].pop(), "K is 2 rows of 4 numbers"),
    (lambda d: d.update(K=[1, 2]), "K is 2 rows of 4 numbers"),
    (lambda d: d["observer_gain"][3].append(1.0), "observer_gain is 4 rows of 2 numbers"),
    (lambda d: d["prefilter"].__setitem__(0, "ab"), "prefilter is 2 rows of 2 numbers"),
    (lambda d: d["K"][1].__setitem__(2, float("nan")), r"K\[1\]\[2\] is a number that is finite, not nan"),
    (lambda d: d["K"][1].__setitem__(2, None), r"K\[1\]\[2\] is a number, not null"),
    (lambda d: d["K"][1].__setitem__(2, True), r"K\[1\]\[2\] is a number, not true"),
    (lambda d: d["K"][1].__setitem__(2, 10**400), r"K\[1\]\[2\] is a number that is finite, not a"),
    (lambda d: d["K"][1].__setitem__(2, 1e39), "K23 = 1e\\+39 is too large"),
    (lambda d: d.pop("model"), "model is missing"),
    (lambda d: d["model"].update(structure="cd"), "the model is 'cd'"),
    (lambda d: d["model"]["parameters"].pop("tau_f"), "model.parameters.tau_f is missing"),
]


@pytest.mark.parametrize(("spoil", "said"), BAD)
def test_a_file_that_holds_no_set_is_refused(
    gains_document: dict[str, Any], tmp_path: Path, spoil: Callable[[dict[str, Any]], object], said: str
) -> None:
    gains_of(copy.deepcopy(gains_document))
    spoil(gains_document)
    path = tmp_path / "gains.json"
    path.write_text(json.dumps(gains_document))
    with pytest.raises(GainsError, match=said) as caught:
        load_gains(path)
    assert str(caught.value).startswith(str(path))


@pytest.mark.parametrize("text", ["", "[]", "{", "null", "\x00"])
def test_what_is_no_document_is_refused(tmp_path: Path, text: str) -> None:
    path = tmp_path / "gains.json"
    path.write_text(text)
    with pytest.raises(GainsError, match="tippath design"):
        load_gains(path)
    with pytest.raises(GainsError, match="cannot be read"):
        load_gains(tmp_path / "absent.json")


@pytest.mark.parametrize("damage", FILES)
def test_a_file_that_is_no_set_of_gains_is_refused_and_named(damage: str, tmp_path: Path) -> None:
    path = tmp_path / "gains.json"
    path.write_bytes(FILES[damage])
    with pytest.raises(GainsError, match=r"gains\.json: .*tippath design"):
        load_gains(path)


def test_a_changed_set_is_read_or_refused(gains_document: dict[str, Any]) -> None:
    rng, refused = random.Random(4), 0
    for _ in range(1000):
        try:
            gains_of(changed(gains_document, rng))
        except GainsError:
            refused += 1
    assert refused > 500


def test_what_a_push_reads_is_what_a_design_promises(gains_document: dict[str, Any]) -> None:
    """The schema that comes from the struct accepts a document, and is no stricter than the contract's."""
    schema = documents.schema(GainsDocument)
    jsonschema.validate(gains_document, schema)
    definition = schema["$defs"]["GainsDocument"]
    assert set(definition["required"]) <= set(GAINS["required"])
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate({**gains_document, "K": [[1, 2], [3, 4]]}, schema)


def test_parameters_with_units_are_read_too(gains_document: dict[str, Any]) -> None:
    plain = gains_of(gains_document)
    parameters = gains_document["model"]["parameters"]
    gains_document["model"]["parameters"] = {name: {"value": value, "unit": "1"} for name, value in parameters.items()}
    assert gains_of(gains_document) == plain


def command(module: Any, words: list[str]) -> int:
    parser = argparse.ArgumentParser()
    module.add_parser(parser.add_subparsers())
    args = parser.parse_args(words)
    status: int = args.run(args)
    return status


def test_the_commands(
    connect: Any,
    vehicle: Any,
    gains_document: dict[str, Any],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(Session, "open", connect)
    vehicle.offer_bank()
    path = tmp_path / "gains.json"
    path.write_text(json.dumps(gains_document))
    crc = gains_of(gains_document).crc
    assert command(push_command, ["push", str(path), "--why", "made up", "--connect", vehicle.link, "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["format"] == "tippath.push/1"
    assert (document["crc"], document["verified"], document["committed"]) == (crc, 29, True)
    assert (document["checksum"], document["previous_checksum"]) == (f"{crc:06x}", None)
    assert command(push_command, ["push", str(path), "--why", "made up", "--connect", vehicle.link]) == 0
    assert "had this set already" in capsys.readouterr().out
    assert command(revert_command, ["revert", "--connect", vehicle.link, "--json", "--primary"]) == 0
    assert json.loads(capsys.readouterr().out) == {
        "format": "tippath.revert/1",
        "crc": 0,
        "checksum": None,
        "reverted_crc": crc,
        "reverted_checksum": f"{crc:06x}",
    }
    assert command(revert_command, ["revert", "--connect", vehicle.link]) == 0
    assert f"{crc:06x} is active again" in capsys.readouterr().out
