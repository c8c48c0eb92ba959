"""What has become of the own vehicle in this flight; `OwnVehicle` alone writes it.

Times are on the agent's clock [s], heights above its take-off point [m].
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from swarm_ctl.core.agent.tick import Tick
from swarm_ctl.core.control.navigation import OwnFix
from swarm_ctl.core.model.vehicle import FALLS_MPS

_FLOWN_M: Final = 1.0
"""A position estimate on the ground wanders by less."""
HOLDS_M: Final = 2.0
"""No agent holds lower: told heights err by half a metre and more, and a vehicle that touches the
ground takes off again."""
_FELL_S: Final = 5.0
"""From a fall to the heartbeats that say `disarmed`: they come once a second."""
_SUNK_M: Final = 3.0
"""Far below the height to keep: this much, and half of the height. A baro drifts by less in a
flight."""

_TELLS_S: Final = 3.0
"""From a vehicle's first heartbeat until it has said, too, whether it stands on the ground: it is
asked to once a second, and two of three answers may be lost. Chosen, not measured."""
GONE_VEHICLE_S: Final = 10.0
"""Without a heartbeat for this long while winding down, there is nothing left to land."""


@dataclass(slots=True)
class OwnVehicle:
    """What has become of the own vehicle in this flight."""

    arming_s: float = -math.inf
    """When the vehicle was last asked to arm, or taken over in the air."""
    since_s: float = math.inf
    """When the agent began to listen to it."""
    known_s: float = math.inf
    """When its heartbeats said first what is believed of it."""
    was_armed: bool = False
    had_control: bool = False
    """The vehicle has followed our setpoints in this flight."""
    landing_s: float | None = None
    ended_s: float | None = None
    flown: bool = False
    """The vehicle was in the air in this flight."""
    fell_s: float = -math.inf
    """When it last went down as fast as only a fall does."""
    sunk_since_s: float | None = None
    """Since when it has been far below the height that it had reached and is to keep."""
    at_height: bool = False
    """It has reached its planned height."""
    ground_m: float = 0.0
    """Height of the take-off point in the common frame."""
    target_height_m: float = 0.0
    planned_height_m: float = 0.0
    up_m: float = 0.0
    """Of that, how far the own slot is above the flight height."""

    @property
    def ours(self) -> bool:
        """This process asked the vehicle to arm, or took it over: it may tell it to land."""
        return math.isfinite(self.arming_s)

    def height(self, fix: OwnFix) -> float:
        """Above the take-off point [m]."""
        return fix.height_m - self.ground_m

    def fell(self, now: float) -> bool:
        """It has just gone down as fast as only a fall does."""
        return now - self.fell_s <= _FELL_S

    def sunk_s(self, now: float) -> float:
        """For how long the vehicle has been far below its height [s]; 0: it is not."""
        return 0.0 if self.sunk_since_s is None else now - self.sunk_since_s

    def strange(self, now: float) -> bool:
        """The agent has just started, and may not know yet whether this vehicle is armed, or in
        the air: nothing else than its silence says that it stands on the ground."""
        heard_s = min(self.known_s + _TELLS_S, self.since_s + GONE_VEHICLE_S)
        return not self.ours and now < heard_s

    # --- what is seen ---

    def observe(self, tick: Tick) -> None:
        """Note when it was heard first, and that it armed, or followed our setpoints, by our own
        doing."""
        view, now = tick.view, tick.now
        self.since_s = min(self.since_s, now)
        if math.isfinite(view.heartbeat_s) and not view.mode_doubt:
            self.known_s = min(self.known_s, now)
        self.was_armed |= view.armed and self.ours
        self.had_control |= self.was_armed and view.controlled

    def watch_height(self, tick: Tick) -> None:
        """Note that the vehicle flies, that it is at its height, and that it has sunk far below."""
        fix, height_m = tick.newest_fix, self.target_height_m
        if fix is None or not self.was_armed:
            return
        if fix.velocity_ned_mps[2] > FALLS_MPS:  # of one that was disarmed, too
            self.fell_s = tick.now
        if not tick.view.armed:
            return
        missing_m = height_m - self.height(fix)
        self.flown |= self.height(fix) > _FLOWN_M and not tick.view.on_ground
        # Where a hold has stopped the climb is no height that it had reached.
        there = abs(self.planned_height_m - self.height(fix)) < _FLOWN_M
        self.at_height |= self.flown and self.had_control and there
        if not self.at_height or missing_m <= max(_SUNK_M, 0.5 * height_m):
            self.sunk_since_s = None
        elif self.sunk_since_s is None:
            self.sunk_since_s = tick.now

    # --- what is done with it ---

    def ask_to_arm(self, now: float, fix: OwnFix | None) -> None:
        """From here it takes off."""
        if fix is not None:
            self.ground_m = fix.height_m
        self.arming_s = now

    def take_over(self, now: float, ground_m: float) -> None:
        """It was found in the air."""
        self.arming_s, self.was_armed, self.ground_m = now, True, ground_m

    def leave(self, now: float) -> None:
        """It was found in the air, and flies on without us: as if it had been ours."""
        self.arming_s = now

    def climb_to(self, height_m: float) -> None:
        """The mission's height from now on."""
        self.target_height_m = self.planned_height_m = height_m
        self.up_m = 0.0

    def fly_up(self, up_m: float) -> None:
        """To the height of the own slot, so far above the flight height."""
        if up_m != self.up_m:
            self.climb_to(self.planned_height_m - self.up_m + up_m)
            self.up_m, self.at_height, self.sunk_since_s = up_m, False, None

    def go_home_at(self, height_m: float) -> None:
        """The height of the way back."""
        self.target_height_m = height_m

    def stop_climbing(self, fix: OwnFix | None, least_m: float) -> None:
        """Never climb on while stopping, but to `least_m`."""
        if fix is not None:
            height_m = max(self.height(fix), least_m)
            self.target_height_m = min(self.target_height_m, height_m)

    def climb_again(self) -> None:
        """Back to the mission's height."""
        self.target_height_m = self.planned_height_m

    def take_back(self) -> None:
        """From a pilot, who flew where he liked."""
        self.sunk_since_s, self.at_height = None, False
        self.climb_again()

    def land(self, now: float) -> None:
        """It is told to land from now on."""
        self.landing_s = now

    def end(self, now: float) -> None:
        """Its flight is over, or nothing is left to fly."""
        self.ended_s = now
