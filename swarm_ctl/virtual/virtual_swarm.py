"""A whole swarm in one process on a virtual clock: real agents, drivers and simulator.

All parts of a run but its processes, sockets and zenoh; bytes are carried in memory. The same seed
gives the same trace.
"""

from __future__ import annotations

import hashlib
import itertools
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from swarm_ctl.core.agent.agent import Agent
from swarm_ctl.core.kernel.boundary import FOLLOW_TICKS
from swarm_ctl.core.model.messages import AgentState, Command, Event, Phase, StationBeacon
from swarm_ctl.core.model.plan import Plan
from swarm_ctl.engine.agent.shell import AgentShell, listen, vehicle_link
from swarm_ctl.engine.collector import collected_rarely
from swarm_ctl.engine.launch.sim_config import simulator_config
from swarm_ctl.engine.vehicle_memory import Remembering, VehicleMemory
from swarm_ctl.law_loader import own_law_of
from swarm_ctl.mavlink.signing import UNITS_S, LinkSigning
from swarm_ctl.mavlink.wires import MemoryWire, memory_wires
from swarm_ctl.mesh import keys
from swarm_ctl.mesh.memory_transport import MemoryHub, MemoryTransport
from swarm_ctl.mesh.node import Node
from swarm_ctl.mesh.transport import Transport
from swarm_ctl.mission.compile.loader import LoadedMission
from swarm_ctl.virtual.account import Account
from swarm_sim.config import SimConfig, VehicleConfig
from swarm_sim.network.hub import Hub
from swarm_sim.network.signing import VehicleSigning as VehicleSigning
from swarm_sim.world.world import STEP_S

_PORT = 1000
_AGENT = ("agent", 1)


class VirtualAgent(AgentShell):
    """One agent with its links. It hears a peer, in lockstep, so many ticks after the decision."""

    follow_ticks = 0
    alive = True
    successor = False
    """Started for the vehicle of one that was killed."""
    frozen = False
    state: AgentState | None = None
    """As it was told last."""
    near: frozenset[int] = frozenset()
    """Its near peers in a large swarm."""
    heard: frozenset[int] = frozenset()
    """Those whose states it hears."""
    decided: tuple[frozenset[int], ...] = ()
    """The near peers, in the last ticks."""
    goals: list[str]

    def follow(self, near: frozenset[int] | None) -> None:
        if near is not None:
            self.near = near
        self.decided = (*self.decided, self.near)[-self.follow_ticks - 1 :]
        heard = frozenset.intersection(*self.decided)
        if heard != self.heard:
            self.heard = heard
            super().follow(heard)


def _side_by_side(turns: Sequence[Iterator[None]]) -> None:
    """To their ends, part by part: a part's code stays in the processor's caches for all of them.
    Where none hears what another says in the same tick, it is as if one came after the other."""
    left = list(turns)
    while left:
        left = [turn for turn in left if next(turn, _END) is not _END]


_END: Final = object()


class VirtualSwarm:
    """Flies a mission tick by tick; between ticks, tests read its parts and break them.

    `mesh` makes each agent's transport of the plain one and the agent's id; `clocks` has the agents
    whose clock is not the swarm's; `memory` is the folder where the vehicles' own parameters are
    remembered, None: nowhere. `lockstep`: as the processes of a run in lockstep do it, where what
    is published in a tick is heard in the next one; else an agent hears at once. `signed_from`:
    links are signed, by `key_of`, from this stamp on.
    """

    def __init__(
        self,
        mission: LoadedMission,
        seed: int = 1,
        *,
        mesh: Callable[[Transport, int], Transport] = lambda transport, _: transport,
        clocks: Mapping[int, Callable[[float], float]] | None = None,
        memory: Path | None = None,
        lockstep: bool = False,
        signed_from: int | None = None,
    ) -> None:
        self._lockstep = lockstep
        self._signed_from = signed_from
        self._memory = VehicleMemory(memory) if memory else None
        self._wrap, self._clocks = mesh, dict(clocks or {})
        self.plan: Plan = mission.plan
        self._plan_hash = self.plan.hash()
        self.now = 0.0
        self.events: list[Event] = []
        count = len(mission.plan.agents)
        self._closest_m2 = np.full((count, count), np.inf)
        """Squares, by two places in the plan."""
        self.station_alive = True
        self.account: Account | None = None
        """Who keeps what happens, if it is to be judged."""
        self.after_tick: Callable[[], None] | None = None
        """Who has a turn after the agents, in each tick."""
        self.told_to_end = ""
        self._ticks = 0
        self.mesh = MemoryHub(self._time_s, held=lockstep)
        self._station = Node(MemoryTransport(self.mesh), "test", "station")
        self._station.listen(keys.EVENT, keys.STATUS, keys.ACK)
        self.acks: list[Any] = []
        self._numbers: dict[str, int] = {}
        self._far: list[MemoryWire] = []
        self.members: dict[int, VirtualAgent] = {}
        self.simulator_alive = True
        self.hub = Hub(configuration(mission, seed), 0.0, self._transmit, self._vehicle_signing)
        self._mission = mission
        for agent in mission.plan.agents:
            self._far.append(self._add(agent.id, self.plan))

    def _add(self, agent_id: int, plan: Plan) -> MemoryWire:
        entry = self._mission.fleet.agent(agent_id)
        near, far = memory_wires()
        node = Node(self._wrap(MemoryTransport(self.mesh), agent_id), "test", agent_id)
        clock = self._clocks.get(agent_id, float)
        listen(node, plan)
        signing = self._link_signing(entry.sysid)
        link = vehicle_link(entry, near, signing, remembers=self._memory is not None)
        remembering = Remembering(self._memory, f"vehicle:{agent_id}", "test")
        expects, response = self._lockstep, entry.response
        ids = {planned.id for planned in plan.agents}
        agent = Agent(
            plan,
            agent_id,
            clock(self.now),
            expect_station=expects,
            vehicle=response,
            # in lockstep mission time has no pace: no command is old
            speedup=math.inf if self._lockstep else 1.0,
            same_clock=() if agent_id in self._clocks else ids - self._clocks.keys(),
            own_law=own_law_of(plan.law),
        )
        member = VirtualAgent(agent, link, node, remembering, clock)
        member.follow_ticks, member.goals = FOLLOW_TICKS if self._lockstep else 0, []
        self.members[agent_id] = member
        return far

    def _link_signing(self, sysid: int) -> LinkSigning | None:
        return None if self._signed_from is None else LinkSigning(key_of(sysid), self._stamp())

    def _vehicle_signing(self, vehicle: VehicleConfig) -> VehicleSigning:
        key = None if self._signed_from is None else key_of(vehicle.sysid)
        return VehicleSigning(key, self._stamp)

    def _stamp(self) -> int:
        return (self._signed_from or 0) + round(self.now * UNITS_S)

    def _transmit(self, link: int, data: bytes, to: Any) -> None:
        if to == _AGENT and link < len(self._far):
            self._far[link].write(data)

    # --- time ---

    def _time_s(self) -> float:
        return self.now

    def tick(self) -> None:
        """The world up to the next control tick, then one step of each agent."""
        self._ticks += 1
        # The keeper of lockstep does not add up roundings.
        exact = self._ticks * self.plan.tick_s
        self.now = exact if self._lockstep else self.now + self.plan.tick_s
        if self.simulator_alive:
            self._run_world()
        self.mesh.deliver()
        phase = round(self.now / self.plan.tick_s) % 5
        if self.station_alive and phase == int(self._lockstep):
            self._station.send(keys.BEACON, StationBeacon("station", self.now, self._plan_hash))
        turns = [self._turn(m) for m in self.members.values() if m.alive and not m.frozen]
        for together in [turns] if self._lockstep else [[turn] for turn in turns]:
            _side_by_side(together)
        events = [event for event, _ in self._station.take(keys.EVENT)]
        statuses = [status for status, _ in self._station.take(keys.STATUS)]
        self.events += events
        self.acks += [ack for ack, _ in self._station.take(keys.ACK)]
        if self.account is not None:
            self.account.hear(statuses, events, self.now)
        if self.after_tick is not None:
            self.after_tick()

    def _run_world(self) -> None:
        for index, far in enumerate(self._far):
            while (data := far.read()) is not None:
                self.hub.receive(index, data, _AGENT)
                if self.account is not None:
                    self.account.told(index, data)
        while self.hub.world.next_s <= self.now + STEP_S / 2:
            self.hub.step()
            self._watch_distances()

    def _watch_distances(self) -> None:
        world = self.hub.world
        if world.flying:
            square = world.pairs.square
            if self.plan.wake is not None:
                down = np.asarray(world.positions())[:, 2]
                apart = np.abs(np.subtract.outer(down, down)) >= self.plan.layer_m
                square = np.where(apart, np.inf, square)
            np.minimum(self._closest_m2, square, out=self._closest_m2)

    def _turn(self, member: VirtualAgent) -> Iterator[None]:
        """One agent's tick, with a halt after each part of it."""
        actions = yield from member.turn(self.now, self.told_to_end)
        name = type(actions.goal).__name__
        if member.goals[-1:] != [name]:
            member.goals.append(name)
        if actions.state is not None:
            member.state = actions.state
        if member.ended is not None:
            member.alive = False
            member.node.close()
            if self.account is not None and member.status is not None and not member.successor:
                self.account.ended(member.status.agent, member.status)

    def fly(self, until_s: float = 600.0) -> None:
        """Tick until every live agent has ended, at most to `until_s`."""
        with collected_rarely():
            while self.now < until_s and self._any_flies():
                self.tick()

    def _any_flies(self) -> bool:
        return any(m.alive and not m.frozen for m in self.members.values())

    def wait(self, condition: Any, until_s: float = 300.0) -> None:
        """Tick until `condition(self)` holds; AssertionError after `until_s`."""
        while not condition(self):
            if self.now >= until_s:
                raise AssertionError(f"not reached by {until_s} s")
            self.tick()

    # --- for tests ---

    def kill(self, agent_id: int) -> None:
        """End the agent without a last message."""
        self.members[agent_id].alive = False
        self.members[agent_id].node.close()

    def restart(
        self, agent_id: int, plan: Plan | None = None, clock: Callable[[float], float] | None = None
    ) -> None:
        """Start a new agent for a dead one's vehicle, with another plan or clock if given."""
        self._clocks[agent_id] = clock or self._clocks.get(agent_id, float)
        index = [agent.id for agent in self.plan.agents].index(agent_id)
        self._far[index] = self._add(agent_id, plan or self.plan)
        self.members[agent_id].successor = True

    def command(
        self, kind: str, agents: tuple[int, ...] = (), name: str = "c1", **more: Any
    ) -> None:
        """Send an operator's command; `more`: its step, plan_hash, at_step."""
        self.send(Command(name, kind, agents, self.now, **more))

    def send(self, command: Command) -> None:
        """Send this command, with a number of its own."""
        number = self._numbers.setdefault(command.id, len(self._numbers) + 1)
        command = replace(command, number=number)
        self._station.send(keys.COMMAND, command)
        if self.account is not None:
            self.account.sent(command, self.now)

    def run(self, seconds: float) -> None:
        """Tick for `seconds`."""
        until = self.now + seconds
        while self.now < until:
            self.tick()

    def positions(self) -> dict[int, tuple[float, float]]:
        """True (north, east) of every vehicle [m]."""
        points = np.asarray(self.hub.world.positions())[:, :2].tolist()
        ids = [agent.id for agent in self.plan.agents]
        return {i: (north, east) for i, (north, east) in zip(ids, points, strict=True)}

    def centre(self) -> tuple[float, float]:
        """True centre of all vehicles [m]."""
        points = list(self.positions().values())
        return sum(p[0] for p in points) / len(points), sum(p[1] for p in points) / len(points)

    def in_step(self, step: int) -> bool:
        """Whether every live agent is in this step."""
        live = [member for member in self.members.values() if member.alive]
        return all(m.status is not None and m.status.step == step for m in live)

    def phases(self) -> set[Phase]:
        """The phases of the live agents."""
        return {m.status.phase for m in self.members.values() if m.alive and m.status is not None}

    def outcomes(self) -> dict[int, str]:
        """By agent, for those that have ended."""
        return {i: m.ended.outcome for i, m in self.members.items() if m.ended is not None}

    @property
    def minimum(self) -> dict[tuple[int, int], float]:
        """Smallest true horizontal distance in the air so far [m], by pair of places in the plan;
        empty before a vehicle was in the air."""
        pairs = itertools.combinations(range(len(self._closest_m2)), 2)
        found = {(i, j): math.sqrt(self._closest_m2[i, j]) for i, j in pairs}
        return {pair: distance for pair, distance in found.items() if distance < np.inf}

    @property
    def closest_m(self) -> float:
        """Smallest true horizontal distance in the air so far [m]; infinite before."""
        return min(self.minimum.values(), default=math.inf)

    @property
    def all_down(self) -> bool:
        """Whether every vehicle stands disarmed on the ground."""
        return bool(self.hub.world.parked())


def key_of(sysid: int) -> bytes:
    """The signing key of a vehicle."""
    return hashlib.sha256(bytes([sysid])).digest()


def configuration(mission: LoadedMission, seed: int) -> SimConfig:
    """What the simulator is told."""
    vehicles = [
        replace(entry, endpoint=f"udpin:127.0.0.1:{_PORT + entry.sysid}")
        for entry in mission.fleet.agents
    ]
    settings = simulator_config(mission.plan, vehicles, mission.file.simulation)
    return SimConfig.model_validate(settings | {"epoch_s": 0.0, "seed": seed})
