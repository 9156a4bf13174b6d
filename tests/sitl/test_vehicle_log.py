"""The DataFlash writer against pymavlink's reader, value for value."""

from __future__ import annotations

import random
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from sitl.autopilot.logger import BLOCK_BYTES, FORMATS, DataFlashLog, FileSink, filler, next_log_path

Reader = Callable[[Path], list[Any]]


class Broken:
    """A full disk."""

    def write(self, data: bytes) -> None:
        raise OSError(28, "No space left on device")

    def close(self) -> None:
        pass


def random_values(layout: str, rng: random.Random) -> list[int | float | bytes]:
    makers: dict[str, Callable[[], int | float | bytes]] = {
        "Q": lambda: rng.randrange(1, 2**40),
        "b": lambda: rng.randrange(-128, 128),
        "B": lambda: rng.randrange(256),
        "M": lambda: rng.randrange(128),
        "H": lambda: rng.randrange(2**16),
        "f": lambda: struct.unpack("<f", struct.pack("<f", rng.uniform(-1e3, 1e3)))[0],
        "d": lambda: rng.uniform(-1e3, 1e3),
        "c": lambda: rng.randrange(-(2**15), 2**15),
        "n": lambda: rng.randbytes(2).hex().encode(),
        "N": lambda: rng.randbytes(8).hex().encode(),
        "Z": lambda: rng.randbytes(32).hex().encode(),
    }
    return [makers[letter]() for letter in layout]


def test_every_message_reads_back_value_for_value(tmp_path: Path, read_log: Reader) -> None:
    path = tmp_path / "log.BIN"
    log = DataFlashLog([FileSink(path)], 2000)
    rng = random.Random(1)
    # Multipliers of a reader's own (M, f) leave values as they are; FMT and its kin would redefine the log.
    plain = [f for f in FORMATS if f.name not in ("FMT", "UNIT", "MULT", "FMTU", "PAD4", "PAD5")]
    written: list[tuple[str, list[int | float | bytes]]] = []
    for f in plain * 20:
        values = random_values(f.layout, rng)
        if f.columns.startswith("TimeUS"):
            values[0] = 10_000 + 2000 * len(written)
        log.write(f.name, *values)
        written.append((f.name, values))
    log.close()
    names = {f.name for f in plain}
    read = [m for m in read_log(path) if m.get_type() in names]
    assert [m.get_type() for m in read] == [name for name, _ in written]
    for message, (_, values) in zip(read, written, strict=True):
        fields = [getattr(message, name) for name in message.get_fieldnames()]
        layout = next(f.layout for f in plain if f.name == message.get_type())
        expected = [
            v.decode() if isinstance(v, bytes) else v / 100 if letter == "c" else v
            for letter, v in zip(layout, values, strict=True)
        ]
        assert fields == expected


def test_the_formats_are_those_of_the_real_vehicles_logs() -> None:
    real = {
        "SIDS": (10, 40, "QBfffffff", "TimeUS,Ax,Mag,FSt,FSp,TFin,TC,TR,TFout"),
        "SIDD": (9, 47, "Qfffffffff", "TimeUS,Time,Targ,F,Gx,Gy,Gz,Ax,Ay,Az"),
        "RATE": (75, 63, "Qfffffffffffff", "TimeUS,RDes,R,ROut,PDes,P,POut,YDes,Y,YOut,ADes,A,AOut,AOutSlew"),
        "RPM": (113, 21, "QBffB", "TimeUS,I,RPM,Qual,H"),
        "MODE": (120, 14, "QMBB", "TimeUS,Mode,ModeNum,Rsn"),
        "MSG": (59, 75, "QZ", "TimeUS,Message"),
        "PARM": (32, 35, "QNff", "TimeUS,Name,Value,Default"),
        "ATT": (72, 36, "QffffffB", "TimeUS,DesRoll,Roll,DesPitch,Pitch,DesYaw,Yaw,AEKF"),
        "FMT": (128, 89, "BBnNZ", "Type,Length,Name,Format,Columns"),
    }
    ours = {f.name: (f.number, f.length, f.layout, f.columns) for f in FORMATS}
    assert {name: ours[name] for name in real} == real
    assert (ours["PAD4"][1], ours["PAD5"][1]) == (4, 5)


def test_numbers_names_and_columns_are_sound() -> None:
    assert len({f.number for f in FORMATS}) == len({f.name for f in FORMATS}) == len(FORMATS)
    for f in FORMATS:
        columns = len(f.columns.split(","))
        assert columns == len(f.layout) == len(f.units) == len(f.multipliers), f.name
        assert len(f.columns) <= 64
        assert len(f.layout) <= 16


def test_filler_reaches_a_whole_block_from_any_size() -> None:
    for size in range(2 * BLOCK_BYTES + 1):
        fours, fives = filler(size)
        assert (size + 4 * fours + 5 * fives) % BLOCK_BYTES == 0
        assert 0 <= 4 * fours + 5 * fives < 2 * BLOCK_BYTES


@pytest.mark.parametrize("extra", [0, 1, 2, 3, 7, 40])
def test_a_closed_log_is_whole_blocks_of_whole_messages(tmp_path: Path, read_log: Reader, extra: int) -> None:
    path = tmp_path / "log.BIN"
    log = DataFlashLog([FileSink(path)], 2000)
    for number in range(extra):
        log.write("EV", 4000 + number, number)
    log.close()
    assert path.stat().st_size % BLOCK_BYTES == 0
    sizes = {f.name: f.length for f in FORMATS}
    assert sum(sizes[m.get_type()] for m in read_log(path)) == path.stat().st_size


def test_a_sink_that_fails_is_given_up_and_named_and_the_others_go_on(tmp_path: Path) -> None:
    path = tmp_path / "log.BIN"
    log = DataFlashLog([Broken(), FileSink(path)], 2000)
    log.flush()
    assert log.trouble == "No space left on device"
    size = path.stat().st_size
    log.write("EV", 4000, 10)
    log.close()
    assert path.stat().st_size > size


def test_no_log_is_ever_overwritten(tmp_path: Path) -> None:
    for name in ("vehicle-1.BIN", "vehicle-12.BIN", "vehicle-x.BIN", "vehicle-²4.BIN"):
        (tmp_path / name).write_bytes(b"kept")
    assert next_log_path(tmp_path).name == "vehicle-13.BIN"
    with pytest.raises(FileExistsError):
        FileSink(tmp_path / "vehicle-12.BIN")
