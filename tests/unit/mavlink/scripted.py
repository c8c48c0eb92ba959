"""Scripted vehicles: as little of each firmware as a driver's sequence needs, with the quirks seen
on the real ones.

They live on a virtual clock, take pymavlink messages and fold their answers straight into a
`Telemetry`. A `Random` may lose any message in either direction.
"""

from __future__ import annotations

from random import Random
from typing import Any

from pymavlink.dialects.v20 import common

from swarm_ctl.core.model.vehicle import Goal
from swarm_ctl.mavlink.autopilots import Autopilot
from swarm_ctl.mavlink.telemetry.incoming import fold
from swarm_ctl.mavlink.telemetry.vehicle_telemetry import Telemetry
from tests.unit.mavlink import wire

TICK_S = 0.05
GROUND_ALT_MM = 485_000
STREAMED = {32: "local", 33: "global", 1: "status", 245: "landed", 30: "attitude", 24: "gps"}
STREAMED |= {193: "estimate", 230: "estimate"}


class Scripted:
    """What both have in common: intervals, parameters, heartbeat, climb and descent at 1 m/s."""

    autopilot = 0
    parameters: dict[str, tuple[float, int]]
    landing_modes: tuple[int, ...]

    def __init__(
        self,
        driver: Autopilot,
        *,
        ready_s: float = 0.0,
        spool_up_s: float = 0.0,
        loss: float = 0.0,
        seed: int = 1,
    ) -> None:
        self.driver = driver
        self.heard = Telemetry(watched=driver.watched)
        self.ready_s = ready_s
        self.now = 0.0
        self.mode = 0
        self.armed = False
        self.height_m = 0.0
        self.target_m = 0.0
        self.spool_up_s, self.lifts_s = spool_up_s, 0.0
        self.intervals: dict[int, float] = {}
        self.sent: list[tuple[float, Any]] = []
        self._last: dict[int, float] = {}
        self._loss, self._random = loss, Random(seed)

    # --- the run ---

    def run(self, goal: Goal, seconds: float) -> list[tuple[float, Any]]:
        """Pursue `goal` for a while; everything the driver sent, with its times."""
        begun = len(self.sent)
        for _ in range(round(seconds / TICK_S)):
            self.tick(self.driver.pursue(goal, self.heard, self.now))
        return self.sent[begun:]

    def tick(self, messages: list[Any]) -> None:
        self.sent += [(self.now, message) for message in messages]
        for message in messages:
            if self._random.random() >= self._loss:
                self.take(message)
        self.now += TICK_S
        self.move()
        self.stream()

    @property
    def ready(self) -> bool:
        return self.now >= self.ready_s

    @property
    def on_ground(self) -> bool:
        return self.height_m <= 0.0

    def say(self, message: Any) -> None:
        if self._random.random() >= self._loss:
            fold(self.heard, message, self.now)

    # --- what it does ---

    def take(self, message: Any) -> None:
        handler = getattr(self, "on_" + message.msgname.lower(), None)
        if handler is not None:
            handler(message)

    def on_command_long(self, message: Any) -> None:
        handler = getattr(self, f"do_{message.command}", None)
        result = 3 if handler is None else handler(message)
        self.say(wire.ack(message.command, result))

    def on_param_request_read(self, message: Any) -> None:
        if message.param_id in self.parameters:
            self.say(wire.parameter(message.param_id, *self.parameters[message.param_id]))

    def on_param_set(self, message: Any) -> None:
        if message.param_id in self.parameters:
            self.parameters[message.param_id] = (
                message.param_value,
                self.parameters[message.param_id][1],
            )
            self.on_param_request_read(message)

    def do_511(self, message: Any) -> int:
        self.intervals[round(message.param1)] = message.param2 * 1e-6
        return 0

    def do_512(self, message: Any) -> int:
        if message.param1 == 0:
            self.say(self.heartbeat())
            return 0
        if not self.ready:
            return 4
        self.say(wire.global_origin(alt_mm=GROUND_ALT_MM))
        return 0

    def do_400(self, message: Any) -> int:
        if message.param1 == 0.0:
            self.armed = self.armed and not self.on_ground
            return 4 if self.armed else 0
        if not self.may_arm():
            return 4
        self.armed = True
        return 0

    def may_arm(self) -> bool:
        return self.ready

    def move(self) -> None:
        if not self.armed:
            return
        if self.mode in self.landing_modes:
            self.height_m = max(0.0, self.height_m - TICK_S)
            self.armed = not self.on_ground
        elif self.height_m < self.target_m and self.now >= self.lifts_s:
            self.height_m += TICK_S

    def stream(self) -> None:
        if self.every(0, 1.0):
            self.say(self.heartbeat())
        for number, interval_s in self.intervals.items():
            if number in STREAMED and self.every(number, interval_s):
                self.say_stream(STREAMED[number])

    @property
    def healthy(self) -> bool:
        return self.ready

    def climb_to(self, height_m: float) -> None:
        self.target_m = height_m
        self.lifts_s = self.now + self.spool_up_s

    def heartbeat(self) -> Any:
        return wire.heartbeat(custom_mode=self.mode, armed=self.armed, autopilot=self.autopilot)

    def say_stream(self, name: str) -> None:
        boot_ms = round(self.now * 1000)
        if name == "landed":
            self.say(wire.extended_state(1 if self.on_ground else 2))
        elif name == "attitude":
            self.say(common.MAVLink_attitude_message(boot_ms, 0.1, -0.1, 1.0, 0.0, 0.0, 0.0))
        elif name == "gps":
            self.say(wire.gps_raw())
        elif name == "estimate":
            self.say(wire.estimator_status() if self.autopilot == 12 else wire.ekf_report())
        elif name == "status":
            self.say(wire.system_status(health=wire.PREARM * self.healthy))
        elif name == "local" and self.ready:
            self.say(wire.local_position((0.0, 0.0, -self.height_m), boot_ms=boot_ms))
        elif name == "global" and self.ready:
            self.say(
                wire.global_position(
                    alt_mm=GROUND_ALT_MM + round(self.height_m * 1000), boot_ms=boot_ms
                )
            )

    def every(self, number: int, interval_s: float) -> bool:
        if self.now - self._last.get(number, -1e9) < interval_s - 1e-9:
            return False
        self._last[number] = self.now
        return True


class ScriptedArdupilot(Scripted):
    """Accepts intervals but is silent before it is ready; arms in GUIDED only; a second take-off
    fails."""

    autopilot = 3
    landing_modes = (9,)

    def __init__(self, driver: Autopilot, **how: Any) -> None:
        super().__init__(driver, **how)
        self.parameters = {
            "GUID_TIMEOUT": (3.0, 9),
            "FS_GCS_ENABLE": (0.0, 2),
            "SYSID_MYGCS": (255.0, 4),
            **dict.fromkeys(("WPNAV_SPEED", "WPNAV_ACCEL", "ANGLE_MAX"), (1000.0, 9)),
            **dict.fromkeys(("WPNAV_SPEED_UP", "WPNAV_SPEED_DN"), (200.0, 9)),
        }

    def do_176(self, message: Any) -> int:
        self.mode = round(message.param2)
        return 0

    def may_arm(self) -> bool:
        return self.ready and self.mode == wire.GUIDED

    def do_22(self, message: Any) -> int:
        if not self.armed or not self.on_ground:
            return 4
        self.climb_to(message.param7)
        return 0


LOITER, OFFBOARD, AUTO_LAND = 4 << 16 | 3 << 24, 6 << 16, 4 << 16 | 6 << 24
POSCTL = 3 << 16


class ScriptedPx4(Scripted):
    """Streams by itself; OFFBOARD needs setpoints before and during, lifts off after spool-up by
    one that climbs, and is where a landed vehicle goes back to."""

    autopilot = 12
    landing_modes = (AUTO_LAND,)

    def __init__(self, driver: Autopilot, **how: Any) -> None:
        super().__init__(driver, **how)
        self.parameters = {"COM_OF_LOSS_T": (5.0, 9), "COM_OBL_RC_ACT": (0.0, 6)}
        for name in ("XY_VEL_MAX", "Z_VEL_MAX_UP", "Z_VEL_MAX_DN", "TILTMAX_AIR"):
            self.parameters[f"MPC_{name}"] = (12.0, 9)
        self.intervals = {32: 1 / 30, 33: 0.2, 1: 0.5, 245: 0.5, 30: 0.02, 230: 0.5, 24: 0.2}
        self.mode = LOITER
        self.setpoint_s = self.streaming_since_s = self.climbs_s = -1e9
        self.climb_mps = 0.0

    def do_176(self, message: Any) -> int:
        wanted = round(message.param2) << 16 | round(message.param3) << 24
        if wanted == OFFBOARD and self.armed and not self.streamed:
            return 1
        self.mode = wanted
        return 0

    @property
    def streamed(self) -> bool:
        return self.now - self.streaming_since_s > 1.0 and self.now - self.setpoint_s < 0.5

    @property
    def healthy(self) -> bool:
        return self.ready and (self.mode != OFFBOARD or self.streamed)

    def may_arm(self) -> bool:
        return self.healthy and self.mode in (LOITER, OFFBOARD)

    def on_set_position_target_local_ned(self, message: Any) -> None:
        if self.now - self.setpoint_s > 0.5:
            self.streaming_since_s = self.now
        self.setpoint_s, self.climb_mps = self.now, -message.vz
        if self.armed and self.climb_mps > 0.0 and self.climbs_s == -1e9:
            self.climbs_s = self.now

    def move(self) -> None:
        flew = self.armed
        super().move()
        if flew and not self.armed and self.mode == AUTO_LAND:
            self.mode = OFFBOARD
        spooled = 0.0 <= self.now - self.climbs_s - self.spool_up_s < 1e6
        if self.armed and self.mode == OFFBOARD and spooled:
            self.height_m = max(0.0, self.height_m + self.climb_mps * TICK_S)
        if self.armed and self.mode == OFFBOARD and self.now - self.setpoint_s > 1.0:
            self.mode = AUTO_LAND
