"""What a radio that several vehicles share carries: how often each gets a setpoint, and how often
it is asked to tell what.

Half duplex: setpoints and telemetry share the radio's bytes per second.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from swarm_ctl.core.model.autopilots import AUTOPILOT_KINDS
from swarm_ctl.core.model.fleet import FleetAgent, RadioShare

USED: Final = 0.8
"""Of the radio's bytes: the rest is for requests, answers, repeats, and other senders. In flight
each vehicle's failsafe parameters are read again (`PARAMETER_READ_S`), 35 bytes a second."""
MOST_HZ: Final = 20.0
"""A setpoint and a position each tick."""
LEAST_HZ: Final = 5.0
"""Two in a row may be lost before an ArduCopter's setpoint time-out (0.5 s)."""
_FLOOR_HZ: Final = 3.0
"""What is asked for where not even `LEAST_HZ` fits: one that is lost stops an ArduCopter."""
_FRAME, _SIGNATURE = 12, 13
"""Bytes of a MAVLink 2 frame around its payload, and of its signature."""
_SETPOINT: Final = 53
POSITION: Final = "LOCAL_POSITION_NED"
_POSITION: Final = 28

STREAMS_HZ: Final[Mapping[str, float]] = {
    "GLOBAL_POSITION_INT": 1.0,
    "SYS_STATUS": 1.0,
    "EXTENDED_SYS_STATE": 2.0,
    "ADSB_VEHICLE": 1.0,
    "ATTITUDE": 1.0,
    "GPS_RAW_INT": 1.0,
    "WIND": 1.0,
    "WIND_COV": 1.0,
    "EKF_STATUS_REPORT": 2.0,
    "ESTIMATOR_STATUS": 2.0,
}
"""What a vehicle behind a shared radio is asked for beside its position. Each limit of age holds
with one lost: EXTENDED_SYS_STATE 1.5 s, the estimate's reports 3 s, a contact 3 s, SYS_STATUS
5 s."""
PAYLOADS: Final[Mapping[str, int]] = {
    "GLOBAL_POSITION_INT": 28,
    "SYS_STATUS": 31,
    "EXTENDED_SYS_STATE": 2,
    "ADSB_VEHICLE": 38,
    "ATTITUDE": 28,
    "GPS_RAW_INT": 52,
    "WIND": 12,
    "WIND_COV": 40,
    "EKF_STATUS_REPORT": 26,
    "ESTIMATOR_STATUS": 42,
}
"""Bytes at most; MAVLink 2 leaves trailing zeros out."""
_STEADY: Final = (9, 9, 18, 18)
"""Payloads that go each second whatever is asked for: both heartbeats, TIMESYNC and its answer."""


@dataclass(frozen=True, slots=True)
class Budget:
    """What one vehicle behind a shared radio gets."""

    hz: float
    """Of setpoints, and of its position."""
    streams_hz: Mapping[str, float]
    """How often it is asked for each message."""
    needed_bytes_per_s: float
    """What the radio would have to carry for all its vehicles at `hz`."""
    carried: bool
    """The radio carries `LEAST_HZ` for each."""


def budget(share: RadioShare, autopilot: str, *, signed: bool) -> Budget:
    """What a vehicle of this firmware gets of its radio: the setpoints and positions that are left
    beside all else, 3 to 20 a second."""
    frame = _FRAME + (_SIGNATURE if signed else 0)
    without = AUTOPILOT_KINDS[autopilot].lacks
    streams = {name: hz for name, hz in STREAMS_HZ.items() if name not in without}
    steady = float(sum(payload + frame for payload in _STEADY))
    steady += sum(hz * (PAYLOADS[name] + frame) for name, hz in streams.items())
    pair = _SETPOINT + _POSITION + 2 * frame
    left = share.bytes_per_s * USED / share.vehicles - steady
    hz = float(max(_FLOOR_HZ, min(MOST_HZ, left // pair)))
    needed = share.vehicles * (steady + max(hz, LEAST_HZ) * pair) / USED
    return Budget(hz, {POSITION: hz, **streams}, needed, carried=left >= LEAST_HZ * pair)


def radio_words(agents: Sequence[FleetAgent], *, signed: bool) -> str:
    """What the vehicles behind one radio get, for its operator."""
    gets = [(a.radio, budget(a.radio, a.autopilot, signed=signed)) for a in agents if a.radio]
    radio, least = min(gets, key=lambda each: each[1].hz)
    return (
        f"{radio.endpoint}, {len(agents)} vehicles{', signed' if signed else ''}: {least.hz:g}"
        " setpoints and positions a second each,"
        f" {least.needed_bytes_per_s:.0f} of {radio.bytes_per_s} bytes/s"
    )
