"""All vehicles of one simulator: their firmware, and one array pass of physics a step. Pure."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swarm_sim.config import LagConfig, SimConfig
from swarm_sim.firmware.ardupilot_persona import ArdupilotPersona
from swarm_sim.firmware.autopilot import AutopilotSetup, Contact, Outgoing
from swarm_sim.firmware.firmware import Firmware
from swarm_sim.firmware.flying.maneuvers import STILL, Demand, Sensed
from swarm_sim.firmware.message import MavSeverity, Message
from swarm_sim.firmware.protocol.commands import REBOOT_S
from swarm_sim.firmware.px4_persona import Px4Persona
from swarm_sim.physics.geodesy import TangentPlane, Vector3
from swarm_sim.physics.kinematics import (
    Array,
    Demands,
    Mask,
    MotionState,
    VelocityResponse,
    advance,
    some,
)
from swarm_sim.physics.response import ArdupilotResponse, IdealResponse, LagResponse, Px4Response
from swarm_sim.world.faults import TICK_S, VehicleFaults

STEP_S = 0.02
"""Physics step, mission time. The fastest stream of a persona unasked comes each step (50 Hz), a
setpoint waits 10 ms on average, and the lags of the responses (50 ms and more, solved exactly over
a step) are still well resolved."""

_FIRMWARE: dict[str, type[Firmware]] = {"ardupilot": ArdupilotPersona, "px4": Px4Persona}
_RESPONSES: dict[str, VelocityResponse] = {
    "ardupilot": ArdupilotResponse(),
    "px4": Px4Response(),
    "ideal": IdealResponse(),
}


@dataclass(frozen=True, slots=True)
class WorldEvent:
    """What happened to a vehicle: `liftoff`, `touchdown`, `crash`, `disarm` (in the air),
    `collision` (one event for each of the two), or what the timetable has set
    (`SIM_GPS_FREEZE 1`)."""

    time_s: float
    sysid: int
    event: str
    impact_mps: float | None = None
    """Speed at a `touchdown` or `crash`."""
    height_m: float | None = None
    """Above the ground, of a `disarm`."""
    other: int | None = None
    """The sysid of the other vehicle of a `collision`."""


class World:
    """All vehicles, in the order of the configuration. `time_s` is that of the last step."""

    def __init__(self, config: SimConfig, now: float) -> None:
        self._step = math.ceil(now / STEP_S)
        self._range_m = config.sensing_range_m
        self.plane = TangentPlane(config.origin.geodetic())
        self.groups, self._members = _groups(config, self.plane)
        self._in_range: list[list[int]] | None = None
        """By vehicle: those that it senses, once one has asked in this step."""
        rows = {i: row for members in self._members.values() for row, i in enumerate(members)}
        self.vehicles = [self._vehicle(i, rows[i], config) for i in range(len(rows))]
        self.pairs = PairMinima(len(self.vehicles))
        self.events: list[WorldEvent] = []
        self._airborne: Mask = np.zeros(len(self.vehicles), dtype=np.bool_)
        self._flying = False
        self._armed = [False] * len(self.vehicles)
        self._marks: list[bytes] = []
        self._timetable = deque(sorted(config.faults, key=lambda entry: entry.at_s))
        self._timetable_s = 0.0 if config.faults_since == "start" else math.inf
        self._faults_due_s = self.time_s

    @property
    def time_s(self) -> float:
        """Mission time [s]."""
        return self._step * STEP_S

    @property
    def next_s(self) -> float:
        """When the next step is due."""
        return (self._step + 1) * STEP_S

    def step(self) -> list[int]:
        """One step of everything; the vehicles (by place) that may have something to send."""
        self._step += 1
        now = self.time_s
        self._follow_timetable()
        if self._flying:
            self._watch_arming()
        if now >= self._faults_due_s:
            self._faults_due_s = now + TICK_S - 1e-6
            for vehicle in self.vehicles:
                vehicle.move_faults(now)
        for group in self.groups.values():
            group.step(STEP_S)
        self._in_range = None
        if self._flying or self._moved_on():
            for pair in self.pairs.update(self.positions(), self._landed()):
                self._collide(*pair)
            self._moved_on()
        ran = [i for i, v in enumerate(self.vehicles) if v.due_s <= now + 1e-6]
        for i in ran:
            self.vehicles[i].run(now)
        return ran

    def handle(self, index: int, message: Message, channel: int = 0) -> None:
        """A message for the vehicle at `index`, on one of its channels."""
        self.vehicles[index].handle(message, self.time_s, channel)

    def outbox(self, index: int) -> list[Outgoing]:
        """What the vehicle at `index` has to say; empties it."""
        firmware = self.vehicles[index].firmware
        said, firmware.outbox = firmware.outbox, []
        return said

    def positions(self) -> Array:
        """(n, 3) NED from the configured origin [m]."""
        return self._gathered(lambda state: state.position)

    def velocities(self) -> Array:
        """(n, 3) [m/s]."""
        return self._gathered(lambda state: state.velocity)

    def armed(self) -> list[bool]:
        """Per vehicle."""
        return [v.firmware.armed for v in self.vehicles]

    def airborne(self) -> list[bool]:
        """Per vehicle."""
        return [not x for x in self._landed().tolist()]

    @property
    def flying(self) -> bool:
        """Any is in the air."""
        return self._flying

    def parked(self) -> bool:
        """All stand on the ground, disarmed."""
        return not any(self.armed()) and not any(self.airborne())

    def _collide(self, *pair: int) -> None:
        for i, other in (pair, pair[::-1]):
            vehicle = self.vehicles[i]
            sysid = self.vehicles[other].sysid
            self._event(i, "collision", other=sysid)
            text = f"Collision with vehicle {sysid}"
            vehicle.firmware.text(MavSeverity.EMERGENCY, text)
            if vehicle.faults["SIM_COLL_FALL"] == 1.0:
                vehicle.faults.fallen = True

    def _follow_timetable(self) -> None:
        while self._timetable and self._timetable[0].at_s <= self.time_s - self._timetable_s:
            entry = self._timetable.popleft()
            for index, vehicle in enumerate(self.vehicles):
                if entry.sysid in (None, vehicle.sysid):
                    for name, value in entry.set.items():
                        vehicle.firmware.parameters.set(name, value)
                        self._event(index, f"{name} {value:g}")
                    if entry.pilot is not None:
                        vehicle.pilot(entry.pilot, self.time_s)
                        self._event(index, f"pilot: {vehicle.firmware.mode.name}")

    def _watch_arming(self) -> None:
        """Notes which vehicles lost their motors in the air, by a command or by their firmware."""
        before, self._armed = self._armed, self.armed()
        for i, armed in enumerate(self._armed):
            if before[i] and not armed and self._airborne[i]:
                height = self._gathered(lambda state: state.ground - state.position[..., 2])
                self._event(i, "disarm", height_m=float(height[i]))

    def _moved_on(self) -> bool:
        """Notes which vehicles left the ground or came back to it; whether any is in the air."""
        marks = [group.state.landed.tobytes() for group in self.groups.values()]
        if marks != self._marks:
            self._marks = marks
            airborne = ~self._landed()
            for i in np.nonzero(airborne != self._airborne)[0].tolist():
                self._timetable_s = min(self._timetable_s, self.time_s)
                if airborne[i]:
                    self._event(i, "liftoff")
                else:
                    self._touch_down(i)
            self._airborne = airborne
            self._flying = bool(airborne.any())
        return self._flying

    def _touch_down(self, i: int) -> None:
        impact_mps = float(self._gathered(lambda state: state.impact)[i])
        self._event(i, "touchdown", impact_mps=impact_mps)
        if self.vehicles[i].fell():
            self._event(i, "crash", impact_mps=impact_mps)
            self.vehicles[i].firmware.crashed()

    def _event(self, index: int, what: str, **more: Any) -> None:
        self.events.append(WorldEvent(self.time_s, self.vehicles[index].sysid, what, **more))

    def _landed(self) -> Mask:
        return self._gathered(lambda state: state.landed)

    def _gathered(self, what: Callable[[MotionState], NDArray[Any]]) -> NDArray[Any]:
        """An array of all vehicles, in their order."""
        parts = [what(group.state) for group in self.groups.values()]
        if len(parts) == 1:
            return parts[0]
        out = np.empty((len(self.vehicles), *parts[0].shape[1:]), dtype=parts[0].dtype)
        for members, part in zip(self._members.values(), parts, strict=True):
            out[members] = part
        return out

    def _vehicle(self, index: int, row: int, config: SimConfig) -> SimVehicle:
        described = config.vehicles[index]
        group = self.groups[described.motion]
        start = group.sense(row)
        rng = np.random.default_rng([config.seed, described.sysid])
        setup = AutopilotSetup(
            sysid=described.sysid,
            plane=self.plane,
            start=start,
            local_origin_ned_m=_local_origin(start.position_ned_m, rng),
            ready_after_s=described.ready_after_s,
            traffic=partial(self._traffic, index),
            channels=1 + len(described.also),
        )
        firmware = _FIRMWARE[described.persona](setup, self.time_s)
        exact = dict.fromkeys(firmware.own_faults, 0.0) if described.response == "ideal" else {}
        for name, value in (exact | config.sim_parameters | described.sim_parameters).items():
            firmware.parameters.set(name, value)
        return SimVehicle(
            firmware, VehicleFaults(firmware.parameters, config.seed, described.sysid), group, row
        )

    def _traffic(self, index: int) -> Iterable[Contact]:
        if self._in_range is None:  # a sphere about each one
            positions = self.positions()
            away = positions[:, None] - positions
            near = (away * away).sum(axis=2) <= self._range_m**2
            np.fill_diagonal(near, val=False)
            self._in_range = [np.flatnonzero(row).tolist() for row in near]
        for i in self._in_range[index]:
            truth = self.vehicles[i].truth()
            yield self.vehicles[i].sysid, truth.position_ned_m, truth.velocity_ned_mps


def _groups(
    config: SimConfig, plane: TangentPlane
) -> tuple[dict[str | LagConfig, VehicleGroup], dict[str | LagConfig, list[int]]]:
    """The groups by how they move, and the places of their vehicles, a row each."""
    places: dict[str | LagConfig, list[int]] = {}
    for i, vehicle in enumerate(config.vehicles):
        places.setdefault(vehicle.motion, []).append(i)
    groups = {}
    for motion, members in places.items():
        described = [config.vehicles[i] for i in members]
        starts = np.array([plane.ned_from_geodetic(v.geodetic()) for v in described])
        heading = np.radians([v.heading_deg for v in described])
        groups[motion] = VehicleGroup(_response(motion), starts, heading)
    return groups, places


def _response(motion: str | LagConfig) -> VelocityResponse:
    if isinstance(motion, str):
        return _RESPONSES[motion]
    dead_steps = round(motion.dead_time_s / STEP_S)
    return LagResponse(motion.lag_s, motion.acceleration_mps2, dead_steps)


def _local_origin(start: Vector3, rng: np.random.Generator) -> Vector3:
    """Where a vehicle's own frame has its zero: 3 to 30 m away, as after a power-up elsewhere."""
    bearing = rng.uniform(0.0, 2.0 * math.pi)
    distance = rng.uniform(3.0, 30.0)
    north, east, down = start
    offset = distance * math.cos(bearing), distance * math.sin(bearing), rng.uniform(-2.0, 2.0)
    return north + offset[0], east + offset[1], down + offset[2]


COLLISION_M = 0.5
"""Airframes half a metre across touch when their centres are closer than this."""
_NEAR_M = 3.0
"""Pairs nearer than this are looked at between steps, too. Farther ones pass each other at 40 m/s
with an error of 3 cm at most."""


_OVER_M = 3.0
"""A vehicle so much higher than one that stands on the ground flies over it: no approach."""


class PairMinima:
    """Running smallest horizontal distance of all pairs of n vehicles, and which pairs touch."""

    def __init__(self, n: int) -> None:
        self._below = np.tri(n, k=0, dtype=np.bool_)
        self._least = np.where(self._below, -1.0, np.inf)
        self._told = self._least.copy()
        self.square = np.full((n, n), np.inf)
        """Of the horizontal distances [m2] at the newest step; inf: one flies over the other."""
        self._touching: set[tuple[int, int]] = set()
        self._before: Array | None = None

    def update(self, position: Array, landed: Mask | None = None) -> list[tuple[int, int]]:
        """Takes positions (n, 3), and which vehicles have landed (n,); returns the pairs (i < j)
        that have just begun to touch (in three dimensions), at this step or on the way to it."""
        if len(position) == 1:
            return []
        before, self._before = self._before, position.copy()
        # all pairs at once, by squares; the diagonal is each vehicle with itself
        north, east = position[:, 0], position[:, 1]
        square = np.subtract.outer(north, north) ** 2 + np.subtract.outer(east, east) ** 2
        self.square = square
        if landed is not None and some(landed):
            down = position[:, 2]
            higher = np.abs(np.subtract.outer(down, down)) > _OVER_M
            square[higher & (landed != landed[:, None])] = np.inf
        np.minimum(self._least, square, out=self._least)
        close = square < _NEAR_M**2
        alone = np.count_nonzero(close) == len(position)
        if alone and not self._touching:
            return []
        i, j = np.nonzero(close & ~self._below)
        before = position if before is None else before
        start, end = before[i] - before[j], position[i] - position[j]
        flat = _closest(start[:, :2], end[:, :2])
        self._least[i, j] = np.minimum(self._least[i, j], (flat**2).sum(axis=1))
        apart = np.abs(_closest(start, end))
        touch = (np.hypot(apart[:, 0], apart[:, 1]) < COLLISION_M) & (apart[:, 2] < COLLISION_M)
        now = set(zip(i[touch].tolist(), j[touch].tolist(), strict=True))
        begun = sorted(now - self._touching)
        self._touching = now
        return begun

    def shrunk(self) -> list[tuple[int, int, float]]:
        """Pairs (i, j, metres) whose smallest distance shrank since the last call."""
        rows, columns = np.nonzero(self._least < self._told)
        self._told[rows, columns] = self._least[rows, columns]
        distances = np.sqrt(self._least[rows, columns])
        return list(zip(rows.tolist(), columns.tolist(), distances.tolist(), strict=True))


def _closest(start: Array, end: Array) -> Array:
    """The shortest vector (pairs, axes) on each straight way from `start` to `end`."""
    way = end - start
    share = -(start * way).sum(axis=1) / np.maximum((way * way).sum(axis=1), 1e-12)
    return np.asarray(start + np.clip(share, 0.0, 1.0)[:, None] * way)


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
