"""The vehicle's side of the wire for tests: messages as a vehicle would send them, and their
bytes."""

from __future__ import annotations

from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as dialect

from swarm_ctl.mavlink.wires import MemoryWire

Message = Any

PREARM = dialect.MAV_SYS_STATUS_PREARM_CHECK
GUIDED = 4


def heartbeat(
    *,
    custom_mode: int = 0,
    armed: bool = False,
    autopilot: int = 3,
    kind: int = 2,
    base_mode: int = 1,
) -> Message:
    """HEARTBEAT of a vehicle; the defaults are a disarmed ArduCopter in STABILIZE."""
    return dialect.MAVLink_heartbeat_message(
        kind, autopilot, base_mode | 128 * armed, custom_mode, 4, 3
    )


def local_position(
    position: tuple[float, float, float] = (1.0, 2.0, -3.0),
    velocity: tuple[float, float, float] = (0.1, 0.2, -0.3),
    boot_ms: int = 1000,
) -> Message:
    """LOCAL_POSITION_NED."""
    return dialect.MAVLink_local_position_ned_message(boot_ms, *position, *velocity)


def global_position(
    lat: int = 473_977_420,
    lon: int = 85_455_940,
    alt_mm: int = 488_000,
    relative_mm: int = 3_000,
    boot_ms: int = 1000,
) -> Message:
    """GLOBAL_POSITION_INT (1e-7 degrees, millimetres)."""
    return dialect.MAVLink_global_position_int_message(
        boot_ms, lat, lon, alt_mm, relative_mm, 10, 20, -30, 9000
    )


def global_origin(lat: int = 473_977_000, lon: int = 85_455_000, alt_mm: int = 485_000) -> Message:
    """GPS_GLOBAL_ORIGIN."""
    return dialect.MAVLink_gps_global_origin_message(lat, lon, alt_mm)


def system_status(
    present: int = PREARM, enabled: int = PREARM, health: int = PREARM, battery_percent: int = 80
) -> Message:
    """SYS_STATUS."""
    return dialect.MAVLink_sys_status_message(
        present, enabled, health, 100, 12000, 100, battery_percent, 0, 0, 0, 0, 0, 0
    )


def ekf_report(flags: int = 831, **variances: float) -> Message:
    """EKF_STATUS_REPORT of a real ArduCopter in the air; `pos_horiz=1.2` and such differ."""
    names = ("velocity", "pos_horiz", "pos_vert", "compass", "terrain_alt")
    return dialect.MAVLink_ekf_status_report_message(
        flags, *(variances.get(name, 0.02) for name in names)
    )


def estimator_status(flags: int = 895, accuracy_m: float = 0.3, **ratios: float) -> Message:
    """ESTIMATOR_STATUS of a real PX4 in the air; `vel=1.2` and such differ."""
    names = ("vel", "pos_horiz", "pos_vert", "mag", "hagl", "tas")
    found = (ratios.get(name, 0.1) for name in names)
    return dialect.MAVLink_estimator_status_message(0, flags, *found, accuracy_m, 0.3)


def gps_raw(fix: int = 3, satellites: int = 10, h_acc_mm: int = 900) -> Message:
    """GPS_RAW_INT."""
    place = (473_977_420, 85_455_940, 488_000)
    return dialect.MAVLink_gps_raw_int_message(
        0, fix, *place, 70, 100, 0, 0, satellites, 0, h_acc_mm
    )


def extended_state(landed: int) -> Message:
    """EXTENDED_SYS_STATE."""
    return dialect.MAVLink_extended_sys_state_message(0, landed)


def wind(speed: float) -> Message:
    """WIND: from the west [degrees], speed in m/s."""
    return dialect.MAVLink_wind_message(-90.0, speed, 0.0)


def wind_cov(north: float, east: float) -> Message:
    """WIND_COV: where it blows, m/s."""
    return dialect.MAVLink_wind_cov_message(0, north, east, 0.0, 0.2, 0.0, 500.0, 0.0, 0.0)


def traffic(address: int, *, flags: int = 0x1F, heading: int = 9000, speed: int = 200) -> Message:
    """ADSB_VEHICLE: heading in centidegrees, speed in cm/s, climbing at 0.5 m/s."""
    return dialect.MAVLink_adsb_vehicle_message(
        address, 473_977_500, 85_456_000, 1, 490_000, heading, speed, 50, b"TEST", 14, 0, flags, 0
    )


def text(content: str, severity: int = 4, number: int = 0, chunk: int = 0) -> Message:
    """STATUSTEXT, one chunk."""
    return dialect.MAVLink_statustext_message(severity, content.encode(), number, chunk)


def ack(command: int, result: int, system: int = 250, component: int = 191) -> Message:
    """COMMAND_ACK."""
    return dialect.MAVLink_command_ack_message(command, result, 0, 0, system, component)


def parameter(name: str, value: float, kind: int = 9) -> Message:
    """PARAM_VALUE; `value` already in the vehicle's encoding."""
    return dialect.MAVLink_param_value_message(name.encode(), value, kind, 10, 0)


def version(uid: int = 0, uid2: bytes = bytes(18), number: int = 0x04070000) -> Message:
    """AUTOPILOT_VERSION."""
    custom = bytes(8)
    return dialect.MAVLink_autopilot_version_message(
        0, number, 0, 0, 0, custom, custom, custom, 0, 0, uid, uid2
    )


class Vehicle:
    """The other end of a memory wire: packs with its own ids and sequence, unpacks what the link
    sent."""

    def __init__(self, end: MemoryWire, sysid: int = 1, component: int = 1) -> None:
        self.end = end
        self.codec = dialect.MAVLink(None, srcSystem=sysid, srcComponent=component)
        self.reader = dialect.MAVLink(None)

    def bytes_of(self, *messages: Message) -> bytes:
        """The frames of `messages`, counting seq on."""
        frames = []
        for message in messages:
            frames.append(message.pack(self.codec))
            self.codec.seq = (self.codec.seq + 1) % 256
        return b"".join(frames)

    def say(self, *messages: Message) -> None:
        """Send each in a chunk of its own."""
        for message in messages:
            self.end.write(self.bytes_of(message))

    def heard(self) -> list[Message]:
        """Everything the link sent since the last call, decoded."""
        messages = []
        while (data := self.end.read()) is not None:
            messages += self.reader.parse_buffer(data)
        return messages
