"""Flies a step flight: carries bytes between one vehicle's link and
`core/identification/step_flight.py`, tick by tick.

If this loop stalls or its process dies nothing is sent, and the vehicle's own failsafe stops and
lands it, as with an agent's.
"""

from __future__ import annotations

import contextlib
import json
import math
import os
import socket
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

from swarm_ctl.core.identification.step_flight import StepFlight, Steps
from swarm_ctl.core.model.fleet import FleetAgent, VehicleKind
from swarm_ctl.core.model.plan import Fence, Geodetic, Limits, Response
from swarm_ctl.core.model.text import ids_of
from swarm_ctl.engine.agent.shell import vehicle_link
from swarm_ctl.engine.clock import Clock
from swarm_ctl.engine.interrupts import Interrupts
from swarm_ctl.engine.launch.ports import free_ports
from swarm_ctl.engine.launch.processes import (
    CommandChild,
    VehiclesChild,
    simulator,
    wait_all,
    wait_ready,
)
from swarm_ctl.engine.launch.sim_config import place, vehicle_config
from swarm_ctl.engine.link_keys import OPEN, LinkKeys
from swarm_ctl.engine.ticker import Ticker
from swarm_ctl.engine.vehicle_memory import Remembering, VehicleMemory, state_folder
from swarm_ctl.engine.vehicles.binaries import find
from swarm_ctl.engine.vehicles.order import ORDERS, ORDERS_JSON, Orders, VehicleOrder
from swarm_ctl.engine.vehicles.vehicles_process import READY_WALL_S
from swarm_ctl.errors import InputError, StartError
from swarm_ctl.runfolder.files import write_whole

_START_WALL_S = 20.0
_END_WALL_S = 5.0
_SPEED_MPS = Limits().speed_mps
SOMEWHERE = Geodetic(47.397742, 8.545594, 488.0)
"""Where a simulated vehicle stands that no mission gives a place."""


@dataclass(frozen=True, slots=True)
class Task:
    """The vehicles that may be measured, where their responses are written, and the bounds of their
    flights."""

    vehicles: tuple[FleetAgent, ...]
    file: Path | None = None
    tick_s: float = 0.05
    limit_mps: float = 20.0
    fence: Fence | None = None
    origin: Geodetic | None = None
    keys: LinkKeys = OPEN

    def chosen(self, named: str) -> list[FleetAgent]:
        """The vehicles that `3`, `1,2`, `1-4` or `all` name; '' is the only one there is.

        InputError with the ids there are.
        """
        if named == "all" or (not named and len(self.vehicles) == 1):
            return list(self.vehicles)
        known = {vehicle.id: vehicle for vehicle in self.vehicles}
        ids = ids_of(named, "--id")
        missing = [i for i in ids if i not in known]
        if not ids or missing:
            wrong = f"--id {missing[0]} is not in the fleet" if missing else "--id is missing"
            raise InputError(
                f"{wrong}; allowed: {', '.join(map(str, known))}, several of them, or all"
            )
        return [known[i] for i in ids]

    def steps(self, speed: float | None, height: float, box: float | None) -> Steps:
        """What to fly, in m/s and metres; None: the fastest and the smallest there can be.

        InputError for a speed over the limit, or a box that the steps leave.
        """
        fastest = min(_SPEED_MPS, self.limit_mps) if speed is None else speed
        if fastest > self.limit_mps:
            raise InputError(
                f"--speed {fastest:g}: over the limit; allowed: up to {self.limit_mps:g} m/s"
            )
        least = Steps(fastest, height).least_box_m
        if box is not None and box < least:
            raise InputError(
                f"--box {box:g}: steps of {fastest:g} m/s lead farther;"
                f" allowed: {least:g} m and more"
            )
        return Steps(fastest, height, math.ceil(least) if box is None else box)


def task_of(
    mission: Path | None, fleet: Path | None, identity: Path | None = None, *, dry_run: bool
) -> Task:
    """The vehicles of a mission or of a fleet file, and the keys of their links; `identity`: those
    of one agent.

    InputError where there are none, or where their file can't be written and this is no `dry_run`.
    """
    # Here and not above: they read YAML, which a vehicle without a fleet does without.
    from swarm_ctl.mission.compile.loader import load
    from swarm_ctl.mission.fleet import fleet_file

    if mission is not None:
        loaded = load(mission, fleet=fleet)
        plan, file = loaded.plan, fleet or fleet_file.file_of(mission)
        # A simulated vehicle stands anywhere, so the mission's geofence says nothing about it.
        simulated = all(agent.endpoint is None for agent in loaded.fleet.agents)
        fence = None if simulated else plan.fence
        limit_mps = plan.limits.speed_mps
        keys = LinkKeys.of(loaded.fleet, identity)
        task = Task(
            vehicles=loaded.fleet.agents,
            file=file,
            tick_s=plan.tick_s,
            limit_mps=limit_mps,
            fence=fence,
            origin=plan.origin,
            keys=keys,
        )
    elif fleet is not None:
        read = fleet_file.read_fleet(fleet)
        task = Task(read.agents, fleet, keys=LinkKeys.of(read, identity))
    else:
        raise InputError("no vehicle; allowed: --fleet FILE, a mission, or --endpoint URL")
    if not dry_run:
        _refuse_unwritable(task.file, mission)
    return task


def _refuse_unwritable(file: Path | None, mission: Path | None) -> None:
    if file is None:
        raise InputError(
            f"{mission}: has no fleet to write into;"
            " allowed: --fleet FILE, a fleet section, --dry-run"
        )
    if not (os.access(file, os.W_OK) and os.access(file.resolve().parent, os.W_OK)):
        raise InputError(
            f"{file}: can't be written; allowed: a file and folder that may be, or --dry-run"
        )


def write_response(path: Path, agent: int, found: Response) -> None:
    """Write a response into a fleet file, in one move. The file is read again, because it may have
    been edited meanwhile."""
    from swarm_ctl.mission.fleet.fleet_file import with_response

    try:
        target = path.resolve()
        write_whole(target, with_response(target.read_bytes().decode("utf-8"), agent, found))
    except (OSError, InputError) as error:
        reason = (error.strerror or str(error)) if isinstance(error, OSError) else str(error)
        raise InputError(
            f"{path}: the response of agent {agent} can't be written: {reason}"
        ) from None


def fly(
    vehicle: FleetAgent,
    flight: StepFlight,
    ticker: Ticker,
    say: Callable[[str], None],
    ctrl_c: Interrupts,
    keys: LinkKeys = OPEN,
) -> bool:
    """Fly until `flight.ended`, or the second Ctrl-C; whether the vehicle is disarmed then.

    A vehicle without an endpoint is started for as long as this takes. LinkError where its
    endpoint can't be opened.
    """
    memory = None if vehicle.endpoint is None else VehicleMemory(state_folder())
    remembering = Remembering(memory, vehicle.endpoint or "", "measure")
    with _reached(vehicle, ticker.clock) as endpoint, contextlib.ExitStack() as opened:
        signing = opened.enter_context((keys if vehicle.endpoint else OPEN).signing(vehicle.id))
        alone = replace(vehicle, radio=None)  # the others behind a shared one say nothing
        link = vehicle_link(alone, endpoint, signing, remembers=memory is not None)
        opened.callback(link.close)
        while True:
            now = ticker.wait()
            link.receive(now)
            view = link.view()
            goal = flight.step(now, view, ctrl_c.first)
            link.pursue(goal, now)
            remembering.serve(link, view.own)
            for text in flight.said:
                say(text)
            flight.said.clear()
            if flight.ended is not None or ctrl_c.again:
                return not view.armed


@contextlib.contextmanager
def _reached(vehicle: FleetAgent, clock: Clock) -> Iterator[str]:
    """The vehicle's endpoint, or that of one that is started for as long as this takes."""
    if vehicle.endpoint is not None:
        yield vehicle.endpoint
        return
    start = _simulated if vehicle.vehicle is VehicleKind.SIMULATED else _autopilot
    with tempfile.TemporaryDirectory() as folder, start(vehicle, clock, Path(folder)) as endpoint:
        yield endpoint


@contextlib.contextmanager
def _simulated(vehicle: FleetAgent, clock: Clock, folder: Path) -> Iterator[str]:
    (port,) = free_ports(1, socket.SOCK_DGRAM)
    stands = vehicle_config(
        vehicle.sysid, vehicle.autopilot, f"udpin:127.0.0.1:{port}", (0.0, 0.0), SOMEWHERE
    )
    settings = {"version": 1, "origin": place(SOMEWHERE), "vehicles": [stands]}
    settings |= {"speedup": clock.speedup, "epoch_s": clock.epoch_s}
    config = folder / "sim.json"
    config.write_text(json.dumps(settings))
    with _until_down(simulator(config, folder / "simulator.log"), _START_WALL_S):
        yield f"udpout:127.0.0.1:{port}"


@contextlib.contextmanager
def _autopilot(vehicle: FleetAgent, clock: Clock, folder: Path) -> Iterator[str]:
    """ArduCopter or PX4 itself."""
    kind = vehicle.vehicle
    order = VehicleOrder(vehicle.id, vehicle.sysid, kind, find(kind), SOMEWHERE)
    (folder / ORDERS).write_bytes(ORDERS_JSON.dump_json(Orders(clock.speedup, (order,))))
    child = VehiclesChild(folder, folder / "vehicles.log")
    with _until_down(child, READY_WALL_S):
        (started,) = child.started()
        yield started.endpoint


@contextlib.contextmanager
def _until_down(child: CommandChild, wall_seconds: float) -> Iterator[None]:
    """From when the process is ready until no vehicle of it is armed."""
    try:
        if wait_ready([child], wall_seconds):
            raise StartError(f"{child.name} was not ready after {wall_seconds:g} s")
        yield
        child.let_go()
        wait_all([child], _END_WALL_S)
    finally:
        child.kill()
