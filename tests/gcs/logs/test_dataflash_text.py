"""Text DataFlash against another program's reading of the binary log it was made from, and against damage."""

from __future__ import annotations

import random
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from injuries import COUNTS, bounded_turns, injure
from pymavlink import DFReader

from gcs.errors import TippathError
from gcs.logs import ingest, opening
from gcs.logs.formats import dataflash_text
from gcs.logs.formats.dataflash_table import DataFlashTables
from gcs.logs.formats.dataflash_text import TextLog, parse
from sysid.data.record import Record
from sysid.fit.identify import identify
from sysid.model.paper import CD

SWEEPS = ["heli_roll_sweep.BIN", "heli_pitch_sweep.BIN"]
LOGS = [*SWEEPS[:1], *(pytest.param(name, marks=pytest.mark.thorough) for name in SWEEPS[1:]), "log171.bin"]
WHOLE_NUMBERS = [(b"SIDS", 1), (b"SIDS", 2), (b"SIDY", 1), (b"SIDY", 2), (b"RPM", 2)]
"""Message and cell that hold one."""
MOST = {"log171.bin": 50_000}
"""So many messages of a log are converted, where it is long and nothing is swept."""
Values = dict[tuple[str, str], list[Any]]


def printed(value: Any) -> str:
    """As ground stations print a value: numbers as they are, text up to its first zero."""
    return str(list(value)) if isinstance(value, list | tuple) or hasattr(value, "typecode") else str(value)


def convert(path: Path, between: str = ", ", end: str = "\n", most: int = 1_000_000) -> tuple[bytes, Values, int]:
    """The first `most` messages of a binary log as lines of text, their values, both by pymavlink's reader, and where
    in the log they end."""
    lines: list[str] = []
    values: Values = {}
    log = DFReader.DFReader_binary(str(path))
    try:
        while len(lines) < most and (message := log.recv_msg()) is not None:
            name, cells = message.get_type(), []
            for column in message.get_fieldnames():
                value = getattr(message, column)
                values.setdefault((name, column), []).append(value)
                cells.append(printed(value))
            lines.append(between.join([name, *cells]))
    finally:
        log.close()
    return (end.join(lines) + end).encode(), values, log.offset


@pytest.fixture(scope="module")
def as_text(shared_data: Path, tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], tuple[Path, Values]]:
    """The real logs as text files; each is converted once."""
    folder = tmp_path_factory.mktemp("text")
    done: dict[str, tuple[Path, Values]] = {}

    def text_of(name: str) -> tuple[Path, Values]:
        if name not in done:
            binary = shared_data / "ardupilot" / name
            raw, values, end = convert(binary, most=MOST.get(name, 1_000_000))
            path = folder / f"{Path(name).stem}.log"
            path.write_bytes(raw)
            path.with_suffix(".BIN").write_bytes(binary.read_bytes()[:end])
            done[name] = path, values
        return done[name]

    return text_of


@pytest.fixture(scope="session")
def spoken(flown: Callable[..., bytes], tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """Two chirps of the simulated vehicle as text, with half of the samples that it logs."""
    path = tmp_path_factory.mktemp("spoken") / "flight.BIN"
    path.write_bytes(flown([{"axis": 10}, {"axis": 11}], rate_hz=250))
    return convert(path)[0]


@pytest.fixture(scope="session")
def briefly(spoken: bytes) -> bytes:
    """A stretch of the first chirp, with the formats."""
    lines = spoken.splitlines(keepends=True)
    return b"".join([*lines[:10], *lines[2500:6500]])


def table_of(log: TextLog, name: str) -> list[tuple[float, ...]]:
    """The samples of a message type as a profile sees them."""
    tables = DataFlashTables(log, "log")
    if name not in log.formats or not log.count(name):
        return []
    series = [tables.series(f"{name}.{column}") for column in log.formats[name].columns]
    return list(zip(*(one.values.tolist() for one in series), strict=True))


# ------------------------------------------------------------------------------------------------ values


@pytest.mark.data
@pytest.mark.parametrize("name", LOGS)
def test_every_value_of_a_real_log_is_the_one_that_was_printed(
    as_text: Callable[[str], tuple[Path, Values]], name: str
) -> None:
    path, values = as_text(name)
    log, _ = dataflash_text.read(path)
    compared = 0
    for (message, column), theirs in values.items():
        ours = log.column(message, column)
        assert len(ours) == len(theirs), (message, column)
        if ours.dtype.kind == "S":
            assert log.texts(message, column) == [text.strip() for text in theirs]
        else:
            assert np.array_equal(ours, np.array(theirs, np.float64), equal_nan=True), (message, column)
        compared += len(theirs)
    assert not log.damage.any
    assert set(log.names) == {message for message, _ in values}
    assert compared > 300_000


@pytest.mark.data
@pytest.mark.parametrize("name", LOGS)
def test_the_runs_of_a_text_log_are_those_of_the_binary_one(
    as_text: Callable[[str], tuple[Path, Values]], name: str
) -> None:
    path, _ = as_text(name)
    text, binary = ingest([path]), ingest([path.with_suffix(".BIN")])
    assert len(text.runs) == len(binary.runs)
    for ours, theirs in zip(text.runs, binary.runs, strict=True):
        for field in ("maneuver", "axis", "start_s", "duration_s", "rate_hz", "gaps", "usable", "rate_source"):
            assert getattr(ours, field) == getattr(theirs, field), field
        assert (ours.reasons, ours.sources, ours.swept_band_hz) == (
            theirs.reasons,
            theirs.sources,
            theirs.swept_band_hz,
        )
        assert (ours.record is None) == (theirs.record is None)
        if ours.record is not None and theirs.record is not None:
            assert set(ours.record.channels) == set(theirs.record.channels)
            for channel, values in theirs.record.channels.items():
                np.testing.assert_allclose(ours.record.channels[channel], values, rtol=1e-6, atol=1e-9)


@pytest.mark.data
@pytest.mark.thorough
def test_the_fit_of_two_text_logs_is_that_of_the_binary_ones(
    as_text: Callable[[str], tuple[Path, Values]], shared_data: Path
) -> None:
    text = records([as_text(name)[0] for name in SWEEPS])
    binary = records([shared_data / "ardupilot" / name for name in SWEEPS])
    ours, theirs = (identify(CD, one).nrmse_percent for one in (text, binary))
    for axis in ("p", "q"):
        assert ours[axis] == pytest.approx(theirs[axis], abs=0.1)


def records(paths: list[Path]) -> list[Record]:
    return [run.record for run in ingest(paths).usable if run.record is not None]


# ------------------------------------------------------------------------------------------------ spellings

OLD = """\
FMT,128,89,FMT,BBnNZ,Type,Length,Name,Format,Columns
FMT,129,23,PARM,Nf,Name,Value
FMT,131,27,IMU,Iffffff,TimeMS,GyrX,GyrY,GyrZ,AccX,AccY,AccZ
FMT,132,67,MSG,Z,Message
FMT,133,10,MODE,Mhh,Mode,ThrCrs,Rsn
FMT,134,17,ATT,cccccCC,RollIn,Roll,PitchIn,Pitch,YawIn,Yaw,NavYaw
PARM,SYSID_SW_MREV,120.0000
MSG,ArduCopter V3.1, (a comma)
MODE,STABILIZE,420,0
ATT,0.00,-1.25,0.00,2.50,0.00,180.25,180.25
IMU,1000,0.010000,-0.020000,0.000000,0.1,0.2,-9.8
IMU,1020,1.1E-05,-2e+1,.5,5.,NaN,-Infinity
"""


def test_old_logs_without_blanks_and_with_milliseconds() -> None:
    log = parse(OLD.encode())
    assert log.damage == dataflash_text.Damage(len(OLD), 0, 0)
    tables = DataFlashTables(log, "old.log")
    assert tables.series("IMU.GyrX").t.tolist() == [1.0, 1.02]
    assert tables.series("IMU.GyrX").values.tolist() == [0.01, 1.1e-05]
    assert log.column("IMU", "GyrY").tolist() == [-0.02, -20.0]
    assert log.column("IMU", "GyrZ").tolist() == [0.0, 0.5]
    assert np.isnan(log.column("IMU", "AccY")[1])
    assert np.isneginf(log.column("IMU", "AccZ")[1])
    assert not tables.has("ATT.Roll")  # no time, no clock
    assert log.column("ATT", "Roll").tolist() == [-1.25]
    assert log.texts("MSG", "Message") == ["ArduCopter V3.1, (a comma)"]
    assert log.texts("MODE", "Mode") == ["STABILIZE"]
    assert not tables.has("MODE.Mode")
    assert log.texts("PARM", "Name") == ["SYSID_SW_MREV"]
    assert not tables.texts()
    assert not tables.modes()


@pytest.mark.parametrize(
    "change",
    [
        lambda text: text.replace("\n", "\r\n"),
        lambda text: text.replace("\n", "\r"),
        lambda text: text.replace(",", ", ").replace(",  ", ", "),
        lambda text: text.replace("\n", "\n\n"),
        lambda text: text.replace("\n", "\n \t\n"),
        lambda text: "\ufeff" + text,
        lambda text: "\n\n" + text,
        lambda text: text.replace("\nIMU", "\n  IMU"),
    ],
)
def test_ends_of_lines_blanks_and_marks_make_no_difference(change: Callable[[str], str], tmp_path: Path) -> None:
    whole, other = parse(OLD.encode()), parse(change(OLD).encode())
    assert not other.damage.any
    assert other.names == whole.names
    for name in whole.names:
        for column, values in whole.table(name).items():
            if name == "FMT":
                continue
            ours = other.column(name, column)
            assert np.array_equal(ours, values, equal_nan=ours.dtype.kind == "f"), (name, column)
    path = tmp_path / "log.txt"
    path.write_bytes(change(OLD).encode())
    assert opening.open_log(path, None).kind == "dataflash"


def test_arrays_and_their_neighbours(tmp_path: Path) -> None:
    lines = [
        "FMT, 128, 89, FMT, BBnNZ, Type,Length,Name,Format,Columns",
        "FMT, 9, 79, ISBD, QHaf, TimeUS,N,x,y",
        f"ISBD, 1000, 3, {list(range(32))}, 0.5",
        f"ISBD, 2000, 4, {' '.join(map(str, range(32)))}, 1.5",
        "ISBD, 3000, 4, [1, 2, x], 1.5",
    ]
    log = parse("\n".join([*lines, ""]).encode())
    assert log.column("ISBD", "x").tolist() == [list(range(32)), list(range(32))]
    assert log.column("ISBD", "y").tolist() == [0.5, 1.5]
    assert log.damage.skipped_bytes == len(lines[-1]) + 1


def test_two_boots_are_two_logs(spoken: bytes) -> None:
    twice = parse(spoken + spoken)
    one, two = twice.boots
    assert table_of(one, "RATE") == table_of(two, "RATE") == table_of(parse(spoken), "RATE")
    assert one.starts("FMT").size == two.starts("FMT").size
    (alone,) = parse(spoken).boots
    assert alone.count("RATE") == one.count("RATE")


def test_a_line_that_stands_in_the_wrong_place_is_no_boot(spoken: bytes) -> None:
    lines = spoken.splitlines(keepends=True)
    moved = b"".join([*lines[:9000], *lines[3000:3040], *lines[9000:]])
    assert len(parse(moved).boots) == 1


# ------------------------------------------------------------------------------------------------ damage


def with_line(spoken: bytes, line: bytes, at: int = 5000) -> TextLog:
    lines = spoken.splitlines(keepends=True)
    return parse(b"".join([*lines[:at], line, *lines[at:]]))


@pytest.mark.parametrize(
    "line",
    [
        b"RATE, 10000000, 0, 0.1\n",
        b"RATE, 1" + b", 0" * 20 + b"\n",
        b"SIDD, 1, 0, 0, 0, 0, 0, 0.1.2, 0, 0, 0\n",
        b"SIDD, 1, 0, 0, 0, 0, 0, 1-2, 0, 0, 0\n",
        b"SIDD, 1, 0, 0, 0, 0, 0, 1 2, 0, 0, 0\n",
        b"SIDD, 1, 0, 0, 0, 0, 0, , 0, 0, 0\n",
        b"SIDD, 1, 0, 0, 0, 0, 0, 1_0, 0, 0, 0\n",
        b"SIDD, 1, 0, 0, 0, 0, 0, 1\0, 0, 0, 0\n",
        b"SIDD, 1, 0, 0, 0, 0, 0, 1\xff, 0, 0, 0\n",
        b"SIDD, 1, 0, 0, 0, 0, 0, 1e, 0, 0, 0\n",
        b"SIDD, 1, 0, 0, 0, 0, 0, -, 0, 0, 0\n",
        b"SIDD, 1, 0, 0, 0, 0, 0, ., 0, 0, 0\n",
        b"SIDD, 1, 0, 0, 0, 0, 0, " + b"1" * 60 + b", 0, 0, 0\n",
        b"MSG, 1, a bell \x07\n",
        b"MSG, x, text\n",
        b"no comma\n",
        b", 1, 2\n",
        b"TOOLONG, 1, 2\n",
        b"\xe4\xf6, 1, 2\n",
        b"\0" * 600 + b"\n",
        b"A\x1b[2, 1, 2\n",
    ],
)
def test_a_line_that_is_no_message_is_left_out_and_counted(briefly: bytes, line: bytes) -> None:
    whole, read = parse(briefly), with_line(briefly, line, 2000)
    assert read.damage == dataflash_text.Damage(len(briefly) + len(line), len(line), 1)
    for name in ("RATE", "SIDD", "MSG", "MODE"):
        assert read.count(name) == whole.count(name)
        assert table_of(read, name) == table_of(whole, name) or name == "MSG"


def test_texts_of_any_bytes_are_made_printable(spoken: bytes) -> None:
    read = with_line(spoken, b"MSG, 10000000, caf\xe9, \xc3\xa4\n")
    assert "caf\ufffd, ä" in read.texts("MSG", "Message")
    assert not read.damage.any


def test_a_message_without_a_format_is_named(spoken: bytes) -> None:
    lines = [line for line in spoken.splitlines(keepends=True) if not line.startswith(b"FMT, 12, ")]
    read = parse(b"".join(lines))
    count = parse(spoken).count("TPEX")
    assert read.undeclared == {"TPEX": count}
    assert any("TPEX" in note for note in read.notes)
    assert read.damage.resyncs == 0
    assert read.damage.skipped_bytes == sum(len(line) for line in lines if line.startswith(b"TPEX"))
    assert read.count("RATE") == parse(spoken).count("RATE")


def test_a_damaged_format_loses_to_the_true_one(spoken: bytes) -> None:
    lines = spoken.splitlines(keepends=True)
    rate = next(line for line in lines if line.startswith(b"FMT, 75, "))
    wrong = rate.replace(b"Qfffff", b"Qhhfff")
    read = parse(lines[0] + wrong + b"".join(lines[1:]))
    assert table_of(read, "RATE") == table_of(parse(spoken), "RATE")
    assert read.formats["RATE"].types == "Qfffffffffffff"


def test_a_file_cut_anywhere_keeps_the_whole_lines_before_the_cut(briefly: bytes) -> None:
    chance = random.Random(31)
    names = ("RATE", "SIDD", "TPEX")
    for cut in [*range(1, 120), *(chance.randrange(len(briefly) - 2000) for _ in range(20))]:
        left = briefly[:-cut]
        read = parse(left)
        assert read.damage.tail_cut == (not left.endswith(b"\n"))
        expected = Counter(line.split(b",")[0].decode() for line in left.split(b"\n")[:-1])
        assert [read.count(name) for name in names] == [expected[name] for name in names]
        assert read.damage.skipped_bytes == len(left) - left.rfind(b"\n") - 1


def test_missing_bytes_cost_a_few_messages_and_invent_none(briefly: bytes) -> None:
    names = ("RATE", "SIDD", "TPEX")
    whole = parse(briefly)
    samples = {name: set(table_of(whole, name)) for name in names}
    chance = random.Random(32)
    for _ in range(10):
        at = chance.randrange(2000, len(briefly) - 20_000)
        for size, filling in ((1500, b""), (8192, b""), (517, bytes(517)), (4096, chance.randbytes(4096))):
            injured = briefly[:at] + filling + briefly[at + size :]
            read = parse(injured)
            for name in names:
                assert set(table_of(read, name)) <= samples[name], (at, size, name)
                assert whole.count(name) - read.count(name) <= size / 50 + 3
            assert read.damage.skipped_bytes <= len(filling) + 300


def test_flipped_bits_cost_only_the_lines_they_hit(spoken: bytes) -> None:
    whole = parse(spoken)
    total = sum(whole.count(name) for name in whole.names)
    injured = bytearray(spoken)
    chance = random.Random(33)
    for _ in range(200):
        injured[chance.randrange(2000, len(injured))] ^= 1 << chance.randrange(8)
    read = parse(bytes(injured))
    found = sum(read.count(name) for name in read.names)
    assert total - 210 <= found < total
    # digits that became other digits cannot be seen; everything else is
    different = sum(
        len(set(table_of(read, name)) - set(table_of(whole, name))) for name in ("RATE", "SIDD", "TPEX", "RPM")
    )
    assert different < 100


WORDS = (b"\n", b"\r\n", b",", b", ", b"FMT, ", b"RATE, 1, ", b"nan", b"\xff")


def mutated(data: bytes, chance: random.Random) -> bytes:
    """With words of the format anywhere, and cut."""
    return injure(data, chance, lambda chance: chance.choice(WORDS), cut=True)


@pytest.mark.parametrize("count", COUNTS)
def test_no_injury_makes_the_reader_fail_and_whole_lines_stay_what_they_were(spoken: bytes, count: int) -> None:
    lines = spoken.splitlines(keepends=True)
    short = b"".join([*lines[:9], *lines[len(lines) // 4 : len(lines) // 4 + 400]])
    chance = random.Random(34)
    original = set(short.splitlines())
    read_at_all = 0
    for _ in bounded_turns(count):
        injured = mutated(short, chance)
        try:
            log = parse(injured)
        except TippathError:
            continue
        read_at_all += 1
        assert 0 <= log.damage.skipped_bytes <= len(injured)
        raw = injured.split(b"\n")
        for boot in log.boots:
            tables = DataFlashTables(boot, "log")
            for key in tables.fields():
                tables.series(key)
            tables.texts(), tables.modes(), tables.armed()
        for name in log.names:
            fmt = log.formats[name]
            columns = log.table(name)
            for values in columns.values():
                assert len(values) == log.count(name)
            for i, line in enumerate(log.starts(name).tolist()):
                if raw[line].rstrip(b"\r") in original and all(letter not in "anNZM" for letter in fmt.types):
                    cells = raw[line].split(b",")[1:]
                    assert [float(cell) for cell in cells] == [columns[column][i] for column in fmt.columns]
    assert read_at_all > 0.6 * count


def test_what_is_no_log_is_refused_with_a_reason(tmp_path: Path) -> None:
    chance = random.Random(35)
    for data, words in (
        (b"", "empty"),
        (b"\n\n\n", "not a text DataFlash log"),
        (b"IMU, 1, 2, 3\n" * 50, "no line FMT"),
        (b"FMT, 1", "no line FMT"),
        (chance.randbytes(5000), "no line FMT"),
        (b"\0" * 100_000, "no line FMT"),
    ):
        with pytest.raises(TippathError, match=words):
            parse(data)
    with pytest.raises(TippathError, match="cannot be read"):
        dataflash_text.read(tmp_path / "absent.log")


def test_a_log_is_recognised_by_its_first_line_and_a_binary_one_by_its_own(
    spoken: bytes, two_chirps: bytes, tmp_path: Path
) -> None:
    for name, data in (("a.txt", spoken), ("b", spoken), ("c.log", two_chirps), ("d.log", b"hello\n" + spoken)):
        path = tmp_path / name
        path.write_bytes(data)
        assert opening.open_log(path, None).kind == "dataflash"
        assert len(ingest([path]).usable) == 2


def test_the_words_before_an_old_logs_formats_are_no_damage(spoken: bytes) -> None:
    """Ground stations of 2013 wrote them there."""
    heading = b"\nArduCopter V3.0.1\nFree RAM: 1331\r\nAPM 2\n"
    log = parse(heading + spoken)
    assert not log.damage.any
    assert log.names == parse(spoken).names
    assert parse(b"ArduC\xffpter V3.0.1\n" + spoken).damage.skipped_bytes == 18
    assert parse(b"FMT, 9\n" + spoken).damage.skipped_bytes == 7
    assert parse(spoken + b"APM 2\n").damage.skipped_bytes == 6


@pytest.mark.filterwarnings("error")
def test_times_that_are_no_numbers_make_no_boot(spoken: bytes) -> None:
    lines = spoken.splitlines(keepends=True)
    at = [i for i, line in enumerate(lines) if line.startswith(b"RATE,")]
    for k, word in zip(at[200:204], (b"inf", b"inf", b"nan", b"-inf"), strict=True):
        cells = lines[k].split(b",")
        lines[k] = b",".join([cells[0], b" " + word, *cells[2:]])
    log = parse(b"".join(lines))
    assert log.boots == (log,)


@pytest.mark.parametrize(
    ("word", "message", "place"),
    [
        *((word, *where) for word in (b"nan", b"1e400") for where in WHOLE_NUMBERS),
        *((word, b"SIDS", 2) for word in (b"inf", b"-inf", b"1e999")),
    ],
)
def test_whole_numbers_that_are_none(
    spoken: bytes, saved: Callable[[bytes, str], Path], word: bytes, message: bytes, place: int
) -> None:
    """Where a whole number is due, the line is left out; a float may be nan."""
    lines = [line.split(b",") for line in spoken.splitlines()]
    for cells in lines:
        if cells[0] == message:
            cells[place] = b" " + word
    runs = ingest([saved(b"\n".join(b",".join(cells) for cells in lines) + b"\n", "1.log")]).runs
    assert [(run.axis, run.usable) for run in runs] == [("roll", True), ("pitch", True)]
