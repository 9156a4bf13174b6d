"""The table of clothes: what makes the simulated vehicle this project's own, or a stock ArduCopter.

Values only; who wears them asks for what it needs. Taken from ArduCopter 4.7.0-dev: names, defaults, formats, texts.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sitl.autopilot import gain_switch
from sitl.autopilot.logger import FORMATS, MULTIPLIERS, OWN, UNITS, Dialect, Format
from sitl.autopilot.parameters import TABLE, Kind, Parameter
from sitl.autopilot.recording import Recording
from sitl.autopilot.samples import OwnSampler, Sampler, StockSampler
from sitl.autopilot.stock_recording import StockRecording
from sitl.plants.stock import STOCK_PLANTS


@dataclass(frozen=True, slots=True)
class Axis:
    """Where a number of SID_AXIS acts."""

    place: str
    """`angle`, `rate` or `mixer`."""
    channel: str
    """`roll`, `pitch`, `yaw`, `thrust` or `elevator`."""


_OWN_AXES = {
    10: Axis("mixer", "roll"),
    11: Axis("mixer", "pitch"),
    7: Axis("rate", "roll"),
    8: Axis("rate", "pitch"),
    20: Axis("mixer", "elevator"),  # ArduPilot ends at 19
}

_TURNS = ("roll", "pitch", "yaw")
# 4 to 6 leave out the feed-forward of the angle's rate, which this vehicle's controller does not have.
_STOCK_AXES = {
    number: Axis(place, channel)
    for first, place in ((1, "angle"), (4, "angle"), (7, "rate"), (10, "mixer"))
    for number, channel in enumerate(_TURNS, first)
} | {13: Axis("mixer", "thrust")}


@dataclass(frozen=True, slots=True, kw_only=True)
class Clothes:
    """What an autopilot is taken for."""

    name: str
    plants: tuple[str, ...] = ()
    """It can fly, the usual one first; empty where that is not the clothes' business."""
    mav_type: int = mavlink.MAV_TYPE_HELICOPTER
    version: tuple[int, int, int] = (0, 1, 0)
    git_hash: bytes = b"tippath"
    greeting: tuple[str, ...] = ()
    """Said at boot, and the first texts of every log; empty for the vehicle's own."""
    table: tuple[Parameter, ...] = TABLE
    after_reboot: frozenset[str] = frozenset()
    """Parameters that act only after the next boot."""
    dialect: Dialect = OWN
    axes: Mapping[int, Axis] = field(default_factory=lambda: _OWN_AXES)
    other_axis: str = "SID_AXIS = {}: this vehicle has 7, 8, 10, 11, 20"
    tail_s: float | None = 1.0
    """From a maneuver's end to "Finished"; None for ArduPilot's, both fades and two periods of the start frequency."""
    explains: bool = True
    """Whether a parameter error is explained in a second text."""
    boots_for_s: float = 0.0
    """Before it can be armed."""
    checks_logging: bool = False
    """Before arming, as ARMING_CHECK says."""
    recording: Callable[..., Recording] = Recording
    sampler: Callable[..., Sampler] = OwnSampler
    stock_loops: bool = False
    """Whether the parameters' angle and rate controllers fly it, instead of this vehicle's own laws."""
    vibration: float = 1.0
    """Of the gyro, as a factor on that of a helicopter with two stiff blades."""
    yaw_gain: float = 0.0
    """Command per rad/s and per rad of a sweep's target on yaw."""
    forwards: bool = False
    """Whether other stations' heartbeats go out on every link."""
    shows_failsafe: bool = False
    """Whether the heartbeat's status says CRITICAL in a failsafe."""
    gain_switch: bool = False
    """Whether its card has the script that holds a second set of rate gains behind the pilot's switch."""
    shortest_interval: Callable[[float], float] = float
    """Of telemetry: what becomes of 1 / 0.8 of a loop's milliseconds."""


OWN_CLOTHES: Clothes = Clothes(name="tippath")

_RC = ((60, "RCIN"), (62, "RCOU"))
_CHANNELS = "TimeUS," + ",".join(f"C{n}" for n in range(1, 15))
_PIDS = ((103, "PIDR"), (104, "PIDP"), (105, "PIDY"))
_PID_COLUMNS = "TimeUS,Tar,Act,Err,P,I,D,FF,DFF,Dmod,SRate,Flags"
_DMS_COLUMNS = "TimeUS,N,Dp,RT,RS,Fa,Fmn,Fmx,Pa,Pmn,Pmx,Sa,Smn,Smx"
_ADDED_FORMATS = (
    *((number, name, "Q" + 14 * "H", _CHANNELS, "s" + 14 * "Y", "F" + 14 * "-") for number, name in _RC),
    *((number, name, "QffffffffffB", _PID_COLUMNS, "s" + 11 * "-", "F" + 11 * "-") for number, name in _PIDS),
    (115, "DMS", "QIIIIBBBBBBBBB", _DMS_COLUMNS, "s" + 13 * "-", "F" + 13 * "-"),
    (
        163,
        "IMU",
        "QBffffffIIfBBHH",
        "TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ,EG,EA,T,GH,AH,GHz,AHz",
        "s#EEEooo--O--zz",
        "F-000000-----00",
    ),
    (195, "ANG", "Qfffffff", "TimeUS,DesRoll,Roll,DesPitch,Pitch,DesYaw,Yaw,Dt", "sddddhhs", "F0000000"),
    (10, "SIDS", "QBfffffff", "TimeUS,Ax,Mag,FSt,FSp,TFin,TC,TR,TFout", "s--ssssss", "F--------"),
)
_NOT_STOCK = ("TPEX", "LQRO", "SIDY", "PAD4", "PAD5", "ARSP", "SIDS")
_STOCK_DIALECT = Dialect(
    formats=(
        *(form for form in FORMATS if form.name not in _NOT_STOCK),
        *(
            Format(number=number, name=name, layout=layout, columns=columns, units=units, multipliers=multipliers)
            for number, name, layout, columns, units, multipliers in _ADDED_FORMATS
        ),
    ),
    units=UNITS | {"Y": "us"},
    multipliers=MULTIPLIERS,
    padded=False,
)

_REAL = Kind.REAL32


def _rate_controller(axis: str, **values: float) -> tuple[Parameter, ...]:
    usual = dict.fromkeys(("FF", "D_FF", "FLTE", "FLTD", "PDMX", "SMAX", "NTF", "NEF"), 0.0) | {"FLTT": 20.0}
    return tuple(Parameter(f"ATC_RAT_{axis}_{name}", value, _REAL) for name, value in (usual | values).items())


_COPTER = (
    Parameter("FORMAT_VERSION", 120, Kind.INT16, read_only=True),
    Parameter("MAV_SYSID", 1, Kind.INT16, read_only=True),
    Parameter("MAV_GCS_SYSID", 255, Kind.INT16),
    Parameter("MAV_OPTIONS", 0, Kind.INT16),
    Parameter("MAV_TELEM_DELAY", 0, Kind.INT8),
    Parameter("ANGLE_MAX", 3000, Kind.INT16),
    Parameter("ARMING_CHECK", 1, Kind.INT32),
    Parameter("ARMING_OPTIONS", 0, Kind.INT32),
    Parameter("ARMING_RUDDER", 2, Kind.INT8),
    Parameter("BATT_MONITOR", 4, Kind.INT8),
    Parameter("BRD_BOOT_DELAY", 0, Kind.INT16),
    *(Parameter(f"FLTMODE{n}", mode, Kind.INT8) for n, mode in enumerate((7, 9, 6, 3, 5, 0), 1)),
    Parameter("FLTMODE_CH", 5, Kind.INT8),
    Parameter("FRAME_TYPE", 1, Kind.INT8),
    Parameter("FS_CRASH_CHECK", 1, Kind.INT8),
    Parameter("FS_EKF_ACTION", 1, Kind.INT8),
    Parameter("FS_EKF_THRESH", 0.8, _REAL),
    Parameter("FS_GCS_ENABLE", 0, Kind.INT8),
    Parameter("FS_GCS_TIMEOUT", 5, _REAL),
    Parameter("FS_OPTIONS", 16, Kind.INT32),
    Parameter("FS_THR_ENABLE", 1, Kind.INT8),
    Parameter("FS_THR_VALUE", 975, Kind.INT16),
    Parameter("FS_VIBE_ENABLE", 1, Kind.INT8),
    Parameter("INS_GYRO_FILTER", 20, Kind.INT16),
    Parameter("INS_HNTCH_ENABLE", 0, Kind.INT8),
    Parameter("LOG_BACKEND_TYPE", 1, Kind.INT8),
    Parameter("LOG_BITMASK", 180222, Kind.INT32),
    Parameter("LOG_DISARMED", 0, Kind.INT8),
    Parameter("LOG_FILE_BUFSIZE", 200, Kind.INT16),
    Parameter("LOG_FILE_DSRMROT", 0, Kind.INT8),
    Parameter("LOG_FILE_MB_FREE", 500, Kind.INT16),
    Parameter("LOG_FILE_RATEMAX", 0, _REAL),
    Parameter("LOG_MAV_BUFSIZE", 8, Kind.INT8),
    Parameter("LOG_MAV_RATEMAX", 0, _REAL),
    Parameter("LOG_MAX_FILES", 500, Kind.INT16),
    Parameter("LOG_REPLAY", 0, Kind.INT8),
    *(Parameter(f"RCMAP_{name}", n, Kind.INT8) for n, name in enumerate(("ROLL", "PITCH", "THROTTLE", "YAW"), 1)),
    Parameter("RC_FS_TIMEOUT", 1, _REAL),
    Parameter("RC_OPTIONS", 32, Kind.INT32),
    Parameter("RC_OVERRIDE_TIME", 3, _REAL),
    Parameter("RC_PROTOCOLS", 1, Kind.INT32),
    Parameter("SCHED_LOOP_RATE", 400, Kind.INT16),
    *(
        Parameter(f"SERVO{n}_{name}", value, Kind.INT16)
        for n in range(1, 5)
        for name, value in (("FUNCTION", 32 + n), ("MAX", 1900), ("MIN", 1100), ("REVERSED", 0), ("TRIM", 1500))
    ),
    Parameter("SID_AXIS", 0, Kind.INT8),
    Parameter("SID_MAGNITUDE", 15, _REAL),
    Parameter("SID_F_START_HZ", 0.5, _REAL),
    Parameter("SID_F_STOP_HZ", 40, _REAL),
    Parameter("SID_T_FADE_IN", 15, _REAL),
    Parameter("SID_T_REC", 70, _REAL),
    Parameter("SID_T_FADE_OUT", 2, _REAL),
)

_HELI = (
    *_COPTER,
    Parameter("FRAME_CLASS", 6, Kind.INT8),
    Parameter("RC_SPEED", 125, Kind.INT16),
    Parameter("ATC_ANG_RLL_P", 4.5, _REAL),
    Parameter("ATC_ANG_PIT_P", 4.5, _REAL),
    Parameter("ATC_INPUT_TC", 0.15, _REAL),
    *(
        _rate_controller("RLL", P=0.024, I=0.15, D=0.001, FF=0.15, IMAX=0.4, ILMI=0.05, FLTE=20.0)
        + _rate_controller("PIT", P=0.024, I=0.15, D=0.001, FF=0.15, IMAX=0.4, ILMI=0.05, FLTE=20.0)
    ),
    Parameter("H_COL_MAX", 1740, Kind.INT16),
    Parameter("H_COL_MIN", 1460, Kind.INT16),
    Parameter("H_CYC_MAX", 2500, Kind.INT16),
    Parameter("H_FLYBAR_MODE", 0, Kind.INT8),
    Parameter("H_RSC_CRITICAL", 50, Kind.INT8),
    Parameter("H_RSC_GOV_RANGE", 100, Kind.INT16),
    Parameter("H_RSC_GOV_RPM", 1500, Kind.INT16),
    Parameter("H_RSC_IDLE", 0, Kind.INT8),
    Parameter("H_RSC_MODE", 2, Kind.INT8),
    Parameter("H_RSC_RAMP_TIME", 1, Kind.INT8),
    Parameter("H_RSC_RUNUP_TIME", 10, Kind.INT8),
    Parameter("H_RSC_SETPOINT", 66, Kind.INT16),
    Parameter("H_SW_TYPE", 3, Kind.INT8),
    Parameter("H_TAIL_TYPE", 0, Kind.INT8),
)

_QUAD = (
    *_COPTER,
    Parameter("FRAME_CLASS", 1, Kind.INT8),
    Parameter("RC_SPEED", 490, Kind.INT16),
    Parameter("ATC_ANG_RLL_P", 4.5, _REAL),
    Parameter("ATC_ANG_PIT_P", 4.5, _REAL),
    Parameter("ATC_INPUT_TC", 0.15, _REAL),
    *_rate_controller("RLL", P=0.135, I=0.135, D=0.0036, IMAX=0.5, FLTD=20.0),
    *_rate_controller("PIT", P=0.135, I=0.135, D=0.0036, IMAX=0.5, FLTD=20.0),
    Parameter("MOT_PWM_MAX", 2000, Kind.INT16),
    Parameter("MOT_PWM_MIN", 1000, Kind.INT16),
    Parameter("MOT_SPIN_ARM", 0.1, _REAL),
    Parameter("MOT_SPIN_MIN", 0.15, _REAL),
    Parameter("MOT_THST_EXPO", 0.65, _REAL),
    Parameter("MOT_THST_HOVER", 0.39, _REAL),
)


def _stock(
    name: str,
    frame: str,
    *,
    plants: tuple[str, ...],
    mav_type: int,
    table: tuple[Parameter, ...],
    vibration: float = 1.0,
) -> Clothes:
    return Clothes(
        name=name,
        plants=plants,
        mav_type=mav_type,
        version=(4, 7, 0),
        git_hash=b"90700977",
        greeting=("ArduCopter V4.7.0-dev (90700977)", f"Frame: {frame}"),
        table=tuple(sorted(table, key=lambda parameter: parameter.name)),
        after_reboot=frozenset({"LOG_BACKEND_TYPE", "SCHED_LOOP_RATE"}),
        dialect=_STOCK_DIALECT,
        axes=_STOCK_AXES,
        other_axis="Axis requires switch from Loiter",
        tail_s=None,
        explains=False,
        boots_for_s=42.0,
        checks_logging=True,
        recording=StockRecording,
        sampler=StockSampler,
        stock_loops=True,
        vibration=vibration,
        yaw_gain=0.5,
        forwards=True,
        shows_failsafe=True,
        shortest_interval=int,
    )


_HELI_PLANTS = tuple(plant for plant in STOCK_PLANTS if plant != "quad")
CLOTHES = {
    clothes.name: clothes
    for clothes in (
        _stock("ardupilot-heli", "HELI", plants=_HELI_PLANTS, mav_type=mavlink.MAV_TYPE_HELICOPTER, table=_HELI),
        _stock(
            "ardupilot-quad",
            "QUAD/PLUS",
            plants=("quad",),
            mav_type=mavlink.MAV_TYPE_QUADROTOR,
            table=_QUAD,
            vibration=0.05,  # its rotors' 90 Hz would fold to 10 Hz in a log of 100 Hz
        ),
    )
}
"""By the word that asks for them."""


def with_gain_switch(clothes: Clothes) -> Clothes:
    """The same with the script on its card."""
    table = tuple(sorted((*clothes.table, *gain_switch.TABLE), key=lambda parameter: parameter.name))
    return replace(clothes, table=table, gain_switch=True)
