"""What the vehicle says about itself, as MAVLink messages: one function of the vehicle for each.

Only the data that somebody asks about this vehicle. Height and position are scripted (see `sitl.autopilot.vehicle`), so
the position messages stand still; they are here because other ground stations wait for them.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sitl.autopilot.modes import Phase
from sitl.autopilot.storage import BY_FTP
from sitl.autopilot.vehicle import Vehicle

Message = Any
"""pymavlink's generated classes carry no types."""

_LATITUDE, _LONGITUDE = 520000000, 43700000  # 1e-7 degrees
_SENSORS = (
    mavlink.MAV_SYS_STATUS_SENSOR_3D_GYRO
    | mavlink.MAV_SYS_STATUS_SENSOR_3D_ACCEL
    | mavlink.MAV_SYS_STATUS_LOGGING
    | mavlink.MAV_SYS_STATUS_AHRS
)
_LANDED_STATE = {
    Phase.DISARMED: mavlink.MAV_LANDED_STATE_ON_GROUND,
    Phase.SPOOLING: mavlink.MAV_LANDED_STATE_ON_GROUND,
    Phase.LANDED: mavlink.MAV_LANDED_STATE_ON_GROUND,
    Phase.CLIMBING: mavlink.MAV_LANDED_STATE_TAKEOFF,
    Phase.HOVERING: mavlink.MAV_LANDED_STATE_IN_AIR,
    Phase.DESCENDING: mavlink.MAV_LANDED_STATE_LANDING,
}


def _ms(vehicle: Vehicle) -> int:
    return (vehicle.time_us // 1000) & 0xFFFFFFFF


def _pulse(command: float) -> int:
    """A servo's pulse in us for a command of -1..1."""
    return round(1500 + 500 * command)


def heartbeat(vehicle: Vehicle) -> Message:
    armed = mavlink.MAV_MODE_FLAG_SAFETY_ARMED if vehicle.armed else 0
    stabilised = mavlink.MAV_MODE_FLAG_STABILIZE_ENABLED | mavlink.MAV_MODE_FLAG_MANUAL_INPUT_ENABLED
    state = mavlink.MAV_STATE_STANDBY if vehicle.landed else mavlink.MAV_STATE_ACTIVE
    if vehicle.ground.lost and vehicle.clothes.shows_failsafe:
        state = mavlink.MAV_STATE_CRITICAL
    return mavlink.MAVLink_heartbeat_message(
        vehicle.clothes.mav_type,
        mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA,
        mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED | stabilised | armed,
        int(vehicle.mode),
        state,
        3,
    )


def sys_status(vehicle: Vehicle) -> Message:
    current = 200 if vehicle.landed else 3500  # 10 mA
    return mavlink.MAVLink_sys_status_message(
        _SENSORS,
        _SENSORS,
        # A fence that is not there is healthy on ArduPilot; MAVProxy calls anything else a breach.
        _SENSORS | mavlink.MAV_SYS_STATUS_GEOFENCE,
        300,
        round(1000 * vehicle.battery_v),
        current,
        vehicle.battery_percent,
        *(0,) * 6,
    )


def system_time(vehicle: Vehicle) -> Message:
    return mavlink.MAVLink_system_time_message(0, _ms(vehicle))


def attitude(vehicle: Vehicle) -> Message:
    phi, theta = vehicle.attitude
    yaw = math.remainder(vehicle.yaw, 2 * math.pi)
    return mavlink.MAVLink_attitude_message(_ms(vehicle), phi, theta, yaw, *vehicle.gyro)


def rpm(vehicle: Vehicle) -> Message:
    return mavlink.MAVLink_rpm_message(vehicle.rotor_rpm, 0.0)


def servo_output_raw(vehicle: Vehicle) -> Message:
    x, y, e, c = vehicle.commands
    governor = 1700 if vehicle.armed else 1000
    servos = (_pulse(x), _pulse(y), _pulse(c), _pulse(e), 0, 0, 0, governor)
    return mavlink.MAVLink_servo_output_raw_message(vehicle.time_us & 0xFFFFFFFF, 0, *servos)


def rc_channels(vehicle: Vehicle) -> Message:
    stick = _pulse(vehicle.commands[3])
    switch = 2000 if vehicle.lqr_selected else 1000
    channels = (1500, 1500, stick, 1500, 1000, 1000, 1000, switch)
    return mavlink.MAVLink_rc_channels_message(_ms(vehicle), len(channels), *channels, *(0,) * 10, 255)


def highres_imu(vehicle: Vehicle) -> Message:
    plant = vehicle.plant
    force = (0.0, 0.0, -9.80665) if vehicle.landed else (plant.ax, plant.ay, plant.az)
    return mavlink.MAVLink_highres_imu_message(vehicle.time_us, *force, *vehicle.gyro, *(0.0,) * 7, 0x3F)


def vfr_hud(vehicle: Vehicle) -> Message:
    heading = round(math.degrees(vehicle.yaw)) % 360
    throttle = round(50 * (1 + vehicle.commands[3]))
    return mavlink.MAVLink_vfr_hud_message(vehicle.airspeed, 0.0, heading, throttle, vehicle.height_m, 0.0)


def global_position_int(vehicle: Vehicle) -> Message:
    height = round(1000 * vehicle.height_m)
    heading = round(100 * math.degrees(vehicle.yaw)) % 36000
    return mavlink.MAVLink_global_position_int_message(
        _ms(vehicle), _LATITUDE, _LONGITUDE, height, height, 0, 0, 0, heading
    )


def extended_sys_state(vehicle: Vehicle) -> Message:
    return mavlink.MAVLink_extended_sys_state_message(mavlink.MAV_VTOL_STATE_UNDEFINED, _LANDED_STATE[vehicle.phase])


def autopilot_version(vehicle: Vehicle) -> Message:
    """With FTP where this vehicle offers its logs by it."""
    ftp = mavlink.MAV_PROTOCOL_CAPABILITY_FTP if vehicle.storage.offers(BY_FTP) else 0
    major, minor, patch = vehicle.clothes.version
    return mavlink.MAVLink_autopilot_version_message(
        mavlink.MAV_PROTOCOL_CAPABILITY_MAVLINK2
        | mavlink.MAV_PROTOCOL_CAPABILITY_PARAM_ENCODE_C_CAST
        | mavlink.MAV_PROTOCOL_CAPABILITY_COMMAND_INT
        | ftp,
        (major << 24) | (minor << 16) | (patch << 8) | mavlink.FIRMWARE_VERSION_TYPE_DEV,
        *(0,) * 3,
        *(bytearray(vehicle.clothes.git_hash.ljust(8, b"\0")), bytes(8), bytes(8)),
        *(0, 0, vehicle.seed & 0xFFFFFFFF),
    )


MESSAGES: dict[int, Callable[[Vehicle], Message]] = {
    mavlink.MAVLINK_MSG_ID_HEARTBEAT: heartbeat,
    mavlink.MAVLINK_MSG_ID_SYS_STATUS: sys_status,
    mavlink.MAVLINK_MSG_ID_SYSTEM_TIME: system_time,
    mavlink.MAVLINK_MSG_ID_ATTITUDE: attitude,
    mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: global_position_int,
    mavlink.MAVLINK_MSG_ID_SERVO_OUTPUT_RAW: servo_output_raw,
    mavlink.MAVLINK_MSG_ID_RC_CHANNELS: rc_channels,
    mavlink.MAVLINK_MSG_ID_VFR_HUD: vfr_hud,
    mavlink.MAVLINK_MSG_ID_HIGHRES_IMU: highres_imu,
    mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION: autopilot_version,
    mavlink.MAVLINK_MSG_ID_RPM: rpm,
    mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: extended_sys_state,
}
"""All that can be asked for, by message id."""

DEFAULT_INTERVALS_S = {
    mavlink.MAVLINK_MSG_ID_HEARTBEAT: 1.0,
    mavlink.MAVLINK_MSG_ID_SYS_STATUS: 1.0,
    mavlink.MAVLINK_MSG_ID_SYSTEM_TIME: 1.0,
    mavlink.MAVLINK_MSG_ID_ATTITUDE: 0.1,
    mavlink.MAVLINK_MSG_ID_RPM: 0.2,
    mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: 1.0,
}
"""What every peer gets without asking."""
