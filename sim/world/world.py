"""All vehicles of one simulator: their firmware, and one array pass of physics a step. No sockets,
no clock."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np

from sim.config import SimConfig, VehicleConfig
from sim.firmware.ardupilot import Ardupilot
from sim.firmware.base import Contact, Firmware, Outgoing, Setup
from sim.firmware.flying.maneuvers import Demand, Sensed
from sim.firmware.message import Message, Severity
from sim.firmware.protocol.commands import REBOOT_S
from sim.firmware.px4 import Px4
from sim.physics.geodesy import TangentPlane, Vector3
from sim.physics.response import Ardupilot as ArdupilotResponse
from sim.physics.response import Ideal
from sim.physics.response import Px4 as Px4Response
from sim.physics.vehicle import Array, Mask, Response, State
from sim.world.faults import TICK_S, Faults
from sim.world.pair_distances import PairMinima
from sim.world.vehicle_group import Group

STEP_S = 0.02
"""Physics step, mission time. The fastest stream of a persona unasked comes each step (50 Hz), a
setpoint waits 10 ms on average, and the lags of the responses (50 ms and more, solved exactly over
a step) are still well resolved."""

_FIRMWARE: dict[str, type[Ardupilot | Px4]] = {"ardupilot": Ardupilot, "px4": Px4}
_RESPONSE: dict[str, Response] = {
    "ardupilot": ArdupilotResponse(),
    "px4": Px4Response(),
    "ideal": Ideal(),
}


@dataclass(frozen=True, slots=True)
class WorldEvent:
    """What happened to a vehicle: `liftoff`, `touchdown`, `crash`, `collision` (one event for each
    of the two), or what the timetable has set (`SIM_GPS_FREEZE 1`)."""

    time_s: float
    sysid: int
    event: str


class Vehicle:
    """One vehicle: its firmware, and its row in its group."""

    def __init__(self, config: VehicleConfig, group: Group, row: int) -> None:
        self.sysid = config.sysid
        self.faults: Faults
        self.group = group
        self.row = row
        self.firmware: Firmware
        self.due_s = 0.0
        """When `run` has something to do next."""
        self._obeyed: Demand | None = None

    def boot(self, setup: Setup, persona: str, now: float, seed: int) -> None:
        """Starts the firmware."""
        self.firmware = _FIRMWARE[persona](setup, now)
        self.faults = Faults(self.firmware.parameters, seed, self.sysid)

    def sense(self) -> Sensed:
        """What it feels now: the truth, but for what is wrong with its sensors."""
        truth = self.group.sense(self.row)
        return self.faults.sense(truth) if self.faults.active else truth

    def suffer(self, now: float) -> None:
        """Lets weather and errors go on, where there are any."""
        faults = self.faults
        if not faults.look() or not faults.move(now, self.group.sense(self.row)):
            return
        self.group.state.wind[self.row] = faults.wind
        if faults["SIM_REBOOT"] == 1.0:
            self.firmware.parameters.set("SIM_REBOOT", 0.0)
            self.firmware.start(self.sense(), now + REBOOT_S)
        self._take(self.firmware.demand, None)

    def run(self, now: float) -> None:
        """Lets the firmware do what is due."""
        self.firmware.run(now, self.sense())
        self._obey()

    def handle(self, message: Message, now: float) -> None:
        """Gives the firmware a message; its new demand acts at the next step."""
        self.firmware.handle(message, now, self.sense())
        self._obey()

    def _obey(self) -> None:
        self.due_s = self.firmware.due_s
        demand = self.firmware.demand
        if demand is not self._obeyed:
            self._take(demand, self._obeyed)

    def _take(self, demand: Demand, before: Demand | None) -> None:
        self._obeyed = demand
        faults = self.faults
        if faults.motors_dead:
            demand, before = demand._replace(lift=False), None
        self.group.obey(self.row, demand, before, faults.offset)


class World:
    """All vehicles, in the order of the configuration. `time_s` is the mission time of the last
    step."""

    def __init__(self, config: SimConfig, now: float) -> None:
        self._step = math.ceil(now / STEP_S)
        self._range_m = config.sensing_range_m
        self.plane = TangentPlane(config.origin.geodetic())
        starts = [self.plane.ned_from_geodetic(v.geodetic()) for v in config.vehicles]
        self.groups, rows = _groups(config, starts)
        self.vehicles = [
            Vehicle(v, self.groups[v.motion], r) for v, r in zip(config.vehicles, rows, strict=True)
        ]
        self._places = {
            name: [i for i, v in enumerate(config.vehicles) if v.motion == name]
            for name in self.groups
        }
        self.pairs = PairMinima(len(self.vehicles))
        self.events: list[WorldEvent] = []
        self._airborne: Mask = np.zeros(len(self.vehicles), dtype=np.bool_)
        self._flying = False
        self._marks: list[bytes] = []
        for i, (vehicle, described) in enumerate(zip(self.vehicles, config.vehicles, strict=True)):
            vehicle.boot(
                self._setup(i, described, config.seed), described.persona, self.time_s, config.seed
            )
            for name, value in (config.sim_parameters | described.sim_parameters).items():
                vehicle.firmware.parameters.set(name, value)
        self._timetable = deque(sorted(config.faults, key=lambda entry: entry.at_s))
        self._timetable_s = 0.0 if config.faults_since == "start" else math.inf
        self._suffer_s = self.time_s

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
        if self._timetable and self._timetable[0].at_s <= self.time_s - self._timetable_s:
            self._take_from_timetable()
        if self.time_s >= self._suffer_s:
            self._suffer_s = self.time_s + TICK_S - 1e-6
            for vehicle in self.vehicles:
                vehicle.suffer(self.time_s)
        for group in self.groups.values():
            group.step(STEP_S)
        self._observe()
        now = self.time_s
        ran = [i for i, v in enumerate(self.vehicles) if v.due_s <= now + 1e-6]
        for i in ran:
            self.vehicles[i].run(now)
        return ran

    def handle(self, place: int, message: Message) -> None:
        """A message for the vehicle at `place`."""
        self.vehicles[place].handle(message, self.time_s)

    def outbox(self, place: int) -> list[Outgoing]:
        """What the vehicle at `place` has to say; empties it."""
        firmware = self.vehicles[place].firmware
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

    def parked(self) -> bool:
        """All stand on the ground, disarmed."""
        return not any(self.armed()) and not any(self.airborne())

    def _observe(self) -> None:
        if self._flying or self._moved_on():
            for pair in self.pairs.update(self.positions()):
                self._collide(*pair)
            self._moved_on()

    def _check_crash(self, place: int) -> None:
        vehicle = self.vehicles[place]
        if vehicle.faults.motors_dead or not vehicle.firmware.armed:  # it fell
            self._event(place, "crash")
            vehicle.firmware.crashed()

    def _collide(self, *pair: int) -> None:
        for i, other in (pair, pair[::-1]):
            vehicle = self.vehicles[i]
            self._event(i, "collision")
            vehicle.firmware.text(
                Severity.EMERGENCY, f"Collision with vehicle {self.vehicles[other].sysid}"
            )
            if vehicle.faults["SIM_COLL_FALL"] == 1.0:
                vehicle.faults.fallen = True

    def _take_from_timetable(self) -> None:
        while self._timetable and self._timetable[0].at_s <= self.time_s - self._timetable_s:
            entry = self._timetable.popleft()
            for place, vehicle in enumerate(self.vehicles):
                if entry.sysid in (None, vehicle.sysid):
                    for name, value in entry.set.items():
                        vehicle.firmware.parameters.set(name, value)
                        self._event(place, f"{name} {value:g}")

    def _moved_on(self) -> bool:
        """Notes who left the ground and who came back to it; whether anybody flies."""
        marks = [group.state.landed.tobytes() for group in self.groups.values()]
        if marks != self._marks:
            self._marks = marks
            airborne = ~self._landed()
            for i in np.nonzero(airborne != self._airborne)[0].tolist():
                self._event(i, "liftoff" if airborne[i] else "touchdown")
                self._timetable_s = min(self._timetable_s, self.time_s)
                if not airborne[i]:
                    self._check_crash(i)
            self._airborne = airborne
            self._flying = bool(airborne.any())
        return self._flying

    def _event(self, place: int, what: str) -> None:
        self.events.append(WorldEvent(self.time_s, self.vehicles[place].sysid, what))

    def _landed(self) -> Mask:
        if len(self.groups) == 1:
            return next(iter(self.groups.values())).state.landed.copy()
        out = np.empty(len(self.vehicles), dtype=np.bool_)
        for name, group in self.groups.items():
            out[self._places[name]] = group.state.landed
        return out

    def _gathered(self, what: Callable[[State], Array]) -> Array:
        if len(self.groups) == 1:
            return what(next(iter(self.groups.values())).state)
        out = np.empty((len(self.vehicles), 3))
        for name, group in self.groups.items():
            out[self._places[name]] = what(group.state)
        return out

    def _setup(self, place: int, described: VehicleConfig, seed: int) -> Setup:
        vehicle = self.vehicles[place]
        start = vehicle.group.sense(vehicle.row)
        return Setup(
            sysid=described.sysid,
            plane=self.plane,
            start=start,
            local_origin_ned_m=_local_origin(
                start.position_ned_m, np.random.default_rng([seed, described.sysid])
            ),
            ready_after_s=described.ready_after_s,
            traffic=lambda: self._traffic(place),
        )

    def _traffic(self, place: int) -> Iterable[Contact]:
        positions = self.positions()
        away = positions - positions[place]
        near = (away * away).sum(axis=1) <= self._range_m**2
        near[place] = False
        velocities = self.velocities()
        for i in np.nonzero(near)[0].tolist():
            yield self.vehicles[i].sysid, _vector(positions[i]), _vector(velocities[i])


def _groups(config: SimConfig, starts: list[Vector3]) -> tuple[dict[str, Group], list[int]]:
    """The groups by how they move, and each vehicle's row in its own."""
    members: dict[str, list[int]] = {}
    rows = []
    for i, vehicle in enumerate(config.vehicles):
        mine = members.setdefault(vehicle.motion, [])
        rows.append(len(mine))
        mine.append(i)
    groups = {}
    for motion, places in members.items():
        heading = np.radians([config.vehicles[i].heading_deg for i in places])
        groups[motion] = Group(_RESPONSE[motion], np.array([starts[i] for i in places]), heading)
    return groups, rows


def _local_origin(start: Vector3, rng: np.random.Generator) -> Vector3:
    """Where a vehicle's own frame has its zero: 3 to 30 m from where it stands, as after a real
    power-up elsewhere."""
    bearing = rng.uniform(0.0, 2.0 * math.pi)
    distance = rng.uniform(3.0, 30.0)
    north, east, down = start
    offset = distance * math.cos(bearing), distance * math.sin(bearing), rng.uniform(-2.0, 2.0)
    return north + offset[0], east + offset[1], down + offset[2]


def _vector(row: Array) -> Vector3:
    north, east, down = row.tolist()
    return north, east, down
