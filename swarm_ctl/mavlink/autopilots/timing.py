"""Intervals and limits of the drivers, each with its reason, and the pace of repeated requests.
All in mission time."""

from __future__ import annotations

import math
from collections.abc import Mapping

from swarm_ctl.core.model.fleet import RadioShare
from swarm_ctl.core.swarm.radio import budget

HEARTBEAT_S = 1.0
"""Ours. ArduPilot's GCS failsafe waits 5 s: one in five has to arrive."""
GCS_TIMEOUT_S = 5.0
"""A dead agent's ArduCopter lands this long after the agent's last heartbeat: five lost in a
row."""
RETRY_S = 1.0
"""A vehicle's heartbeat shows the effect of a command within 1 s: asking sooner would ask twice."""
KILL_RETRY_S = 0.2
"""For this one command a lost frame must not cost a second."""
TAKEOFF_RETRY_S = 3.0
"""A take-off that was not accepted (lost, or refused) is asked for again."""
TAKEOFF_WAIT_S = 10.0
"""An accepted one is, only if the vehicle still stands after so long: motors spool up for up to
5 s (PX4), and a second take-off restarts the climb or is refused. Both firmwares disarm a vehicle
that has not left the ground by then."""
LANDED_MAX_AGE_S = 1.5
"""3 EXTENDED_SYS_STATE missing in a row: whether the vehicle stands is not known."""
CLIMBS_MPS = 0.3
"""Over the vertical noise of an estimate on the ground (0.1 m/s seen on PX4)."""
GROUNDED_S = 5.0
"""Armed on the ground this long in the landing mode: the autopilot's own disarming (ArduCopter at
once, PX4 after 2 s) has failed."""
HEARTBEAT_LOST_S = 3.0
"""MAVSDK's figure, the strictest of the known ground stations."""
FIX_MAX_AGE_S = 1.0
"""20 local positions missing in a row."""
STATUS_MAX_AGE_S = 5.0
"""10 SYS_STATUS or EXTENDED_SYS_STATE missing in a row, 25 GLOBAL_POSITION_INT; behind a shared
radio 5."""
ORIGIN_REFRESH_S = 10.0
"""A known origin is asked for again this often: an EKF that is reset moves it."""
LISTEN_S = 2.5
"""From a vehicle's first heartbeat on: two that speak with one system id show within two heartbeats
(1 Hz) of theirs, and half a second for a late one."""
VERSION_TRIES = 5
"""Requests for AUTOPILOT_VERSION, one a second: a vehicle that answers none has no uid."""
QUIET_RETRY_S = 5.0
"""Streams that may be silent (no traffic, no wind estimate) are asked for again this often."""
STREAM_BEFORE_S = 1.2
"""PX4 refuses OFFBOARD unless setpoints have come for over 1 s."""
STREAM_GAP_S = 0.4
"""... at 2 Hz at least: a longer gap starts the second anew."""
TAKEOFF_MPS = 1.5
"""The climb of a take-off that we fly: MPC_TKO_SPEED as delivered."""
TAKEOFF_LEAST_MPS = 0.3
"""... and its last metres."""
MAX_SETPOINT_MPS = 100.0
"""No multirotor is faster: a setpoint beyond it is a mistake."""

STREAMS_HZ: Mapping[str, float] = {
    "LOCAL_POSITION_NED": 20.0,
    "GLOBAL_POSITION_INT": 5.0,
    "SYS_STATUS": 2.0,
    "EXTENDED_SYS_STATE": 2.0,
    "ADSB_VEHICLE": 5.0,
    "ATTITUDE": 4.0,
    "GPS_RAW_INT": 2.0,
}
"""LOCAL_POSITION_NED once a tick for the law; GLOBAL_POSITION_INT ties it to the common frame;
SYS_STATUS has health and battery; ADSB_VEHICLE is the proximity sensor; ATTITUDE has the tilt,
GPS_RAW_INT the receiver's fix and accuracy."""
WIND_HZ = 2.0
"""Each firmware has its own message for it: `Autopilot.wind_message`."""
ESTIMATE_HZ = 2.0
"""`Autopilot.estimate_rules` names each firmware's report; `estimate.SILENT_S` is six of them."""
SLOW_HZ = 1.0
"""A stream so slow may miss a second: it is asked for again as seldom as one that is silent."""
MAY_BE_SILENT = frozenset({"ADSB_VEHICLE", "WIND", "WIND_COV"})


def streams_hz(radio: RadioShare | None, autopilot: str, *, signed: bool) -> Mapping[str, float]:
    """How often a vehicle of this firmware is asked for its messages: less behind a radio that it
    shares."""
    return STREAMS_HZ if radio is None else budget(radio, autopilot, signed=signed).streams_hz


_CLOCK_NOISE_S = 1e-6
"""Ticks are sums of floats, so an interval may end this much early."""


class Pacer:
    """Stores when each thing was last asked for."""

    def __init__(self) -> None:
        self._asked: dict[str, float] = {}

    def asked(self, what: str) -> bool:
        """Whether `what` was ever asked for."""
        return what in self._asked

    def recent(self, what: str, within_s: float, now: float) -> bool:
        """Whether `what` was asked for in the last `within_s` [s]."""
        return now - self._asked.get(what, -math.inf) < within_s

    def due(self, what: str, every_s: float, now: float) -> bool:
        """Whether `what` was not asked for in the last `every_s` [s]; if so, it is marked as asked
        for now."""
        if now - self._asked.get(what, -math.inf) < every_s - _CLOCK_NOISE_S:
            return False
        self._asked[what] = now
        return True
