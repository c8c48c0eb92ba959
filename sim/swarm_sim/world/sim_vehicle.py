"""One simulated vehicle: its firmware, its faults, and its row in a group of vehicles. Pure."""

from __future__ import annotations

from swarm_sim.firmware.firmware import Firmware
from swarm_sim.firmware.flying.maneuvers import STILL, Demand, Sensed
from swarm_sim.firmware.message import Message
from swarm_sim.firmware.protocol.commands import REBOOT_S
from swarm_sim.physics.geodesy import Vector3
from swarm_sim.physics.kinematics import Array, Demands, MotionState, VelocityResponse, advance
from swarm_sim.world.faults import VehicleFaults


class SimVehicle:
    """Gives the firmware what the vehicle senses, and the group what the firmware demands."""

    def __init__(
        self, firmware: Firmware, faults: VehicleFaults, group: VehicleGroup, row: int
    ) -> None:
        self.sysid = firmware.sysid
        self.firmware = firmware
        self.faults = faults
        self.due_s = 0.0
        """When `run` has something to do next."""
        self._group = group
        self._row = row
        self._obeyed: Demand | None = None

    def sense(self) -> Sensed:
        """What it senses now: the truth, unless its sensors have a fault."""
        truth = self.truth()
        return self.faults.sense(truth) if self.faults.active else truth

    def truth(self) -> Sensed:
        """How it really moves."""
        return self._group.sense(self._row)

    def move_faults(self, now: float) -> None:
        """Moves weather and errors on, where there are any."""
        faults = self.faults
        if not faults.look() or not faults.move(now, self.truth()):
            return
        self._group.state.wind[self._row] = faults.wind
        self._group.state.drift[self._row] = faults.drift
        if faults["SIM_REBOOT"] == 1.0:
            self.firmware.parameters.set("SIM_REBOOT", 0.0)
            self.firmware.start(self.sense(), now + REBOOT_S)
        self._take(self.firmware.demand, None)

    def fell(self) -> bool:
        """Whether a touch-down now is a crash."""
        return self.faults.motors_dead or not self.firmware.armed

    def run(self, now: float) -> None:
        """Lets the firmware do what is due."""
        self.firmware.run(now, self.sense())
        self._obey()

    def handle(self, message: Message, now: float, channel: int) -> None:
        """Gives the firmware a message; its new demand acts at the next step."""
        self.firmware.handle(message, now, self.sense(), channel)
        self._obey()

    def pilot(self, kind: str, now: float) -> None:
        """A pilot's switch: the firmware may refuse it, as it may any mode."""
        self.firmware.switch(kind, now, self.sense())
        self._obey()

    def _obey(self) -> None:
        self.due_s = self.firmware.due_s
        demand = self.firmware.demand
        if demand is not self._obeyed:
            self._take(demand, self._obeyed)

    def _take(self, demand: Demand, before: Demand | None) -> None:
        self._obeyed = demand
        if self.faults.motors_dead:
            demand, before = demand._replace(lift=False), None
        self._group.obey(self._row, demand, before, self.faults.offset)


class VehicleGroup:
    """State and demands of some vehicles, each a row."""

    def __init__(self, response: VelocityResponse, position: Array, heading: Array) -> None:
        self.response = response
        self.state = MotionState.at_rest(position, response, heading)
        self.demands = Demands.idle(self.state)
        self._rows: list[Sensed] | None = None

    def step(self, dt: float) -> None:
        """Physics of the whole group."""
        advance(self.state, self.demands, self.response, dt)
        self._rows = None

    def sense(self, row: int) -> Sensed:
        """What vehicle `row` feels; worked out for all rows when it is first asked for."""
        if self._rows is None:
            self._rows = self._sense()
        return self._rows[row]

    def _sense(self) -> list[Sensed]:
        s = self.state
        thrust = s.memory[:, -1] if self.response.memory_rows else s.acceleration
        # plain Python numbers, much faster to read one by one than numpy's
        arrays = (s.position, s.velocity, thrust, s.heading, s.landed)
        columns = (array.tolist() for array in arrays)
        return [
            Sensed(tuple(p), tuple(v), tuple(a), h, on)
            for p, v, a, h, on in zip(*columns, strict=True)
        ]

    def obey(
        self, row: int, demand: Demand, before: Demand | None, offset: Vector3 = STILL
    ) -> None:
        """Takes over what differs from the demand `before`, whose positions are those reported:
        `offset` more than the true ones."""
        d = self.demands
        if before is None or demand.velocity_ned_mps != before.velocity_ned_mps:
            d.velocity[row] = demand.velocity_ned_mps
        if before is None or demand.position_ned_m != before.position_ned_m or offset != STILL:
            wanted = demand.position_ned_m
            d.position[row] = [
                0.0 if p is None else p - o for p, o in zip(wanted, offset, strict=True)
            ]
            d.hold[row] = [p is not None for p in wanted]
        if before is None or demand[2:] != before[2:]:
            d.speed[row], d.climb[row], d.descent[row], d.heading[row], d.lift[row] = demand[2:]
