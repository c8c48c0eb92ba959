"""What is known of each kind of autopilot, whoever asks: the law, a mission's forecast, a radio's
budget, a study. How it is spoken to stands in `swarm_ctl/mavlink/autopilots/`, how the simulator
plays it in `sim/swarm_sim/firmware/`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from swarm_ctl.core.model.plan import Response

_LOW_M: Final = 10.0


@dataclass(frozen=True, slots=True)
class UpAndDown:
    """How an autopilot takes off and lands by itself."""

    arm_s: float
    """From the order until it climbs, and from its height until it follows setpoints."""
    climb_mps: float
    descent_mps: float
    """To `_LOW_M`."""
    touchdown_mps: float
    """The mean from there."""
    disarm_s: float

    def landing_s(self, height_m: float) -> float:
        """Fast to `_LOW_M`, slowly from there, then disarming."""
        fast_s = max(0.0, height_m - _LOW_M) / self.descent_mps
        return fast_s + min(height_m, _LOW_M) / self.touchdown_mps + self.disarm_s


@dataclass(frozen=True, slots=True)
class AutopilotKind:
    """A family of firmware, at its default parameters. The figures were measured on real ones
    (docs/understand/figures.md#real-autopilots)."""

    response: Response
    """To a velocity setpoint, by what was measured and what keeps simulated vehicles apart."""
    setpoint_timeout_s: float
    """What an agent sets before it arms: for so long the vehicle of a silent agent flies its last
    setpoint."""
    up_and_down: UpAndDown
    """At 10 and 20 m."""
    lacks: tuple[str, ...]
    """MAVLink streams that others have."""
    pilots: str
    """What a real one leaves to pilots and ground stations while its agent flies it."""


AUTOPILOT_KINDS: Final[Mapping[str, AutopilotKind]] = {
    # ArduCopter bounds jerk and acceleration, which acts like a dead time.
    "ardupilot": AutopilotKind(
        response=Response(dead_time_s=0.4, lag_s=0.62, acceleration_mps2=2.8),
        setpoint_timeout_s=0.5,
        up_and_down=UpAndDown(5.6, 2.5, 1.2, 0.5, 3.0),
        lacks=("WIND_COV", "ESTIMATOR_STATUS"),
        pilots=(
            "ArduCopter heeds only its agent's RC_CHANNELS_OVERRIDE and MANUAL_CONTROL in flight,"
            " so a ground station's joystick does nothing; its modes and commands, and a radio"
            " control's sticks, work"
        ),
    ),
    # It follows a velocity unshaped, so it starts at once. After the time-out it leaves OFFBOARD
    # for good, so it waits longer.
    "px4": AutopilotKind(
        response=Response(dead_time_s=0.0, lag_s=0.8, acceleration_mps2=8.0),
        setpoint_timeout_s=1.0,
        up_and_down=UpAndDown(6.4, 1.5, 0.87, 0.53, 2.6),
        lacks=("WIND", "EKF_STATUS_REPORT"),
        pilots=(
            "a ground station's modes and commands work on a PX4. In OFFBOARD it heeds sticks, of"
            " a radio control or a joystick, where COM_RC_OVERRIDE has bit 1. With NAV_DLL_ACT"
            " over 0 it arms beside a ground station only"
        ),
    ),
}
"""By the name that a fleet has for it."""
