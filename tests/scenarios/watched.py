"""A ground station on the virtual clock: what it would have told an operator of the flight."""

from __future__ import annotations

from collections.abc import Callable

from swarm_ctl.engine.clock import Clock
from swarm_ctl.engine.station.ground_station import Station
from swarm_ctl.mesh.memory_transport import MemoryTransport
from swarm_ctl.mesh.node import Node
from swarm_ctl.station.picture.alarms import Level
from swarm_ctl.station.picture.journal import Journal
from swarm_ctl.station.picture.playback import LOOK_S
from swarm_ctl.station.picture.summaries import verdict
from swarm_ctl.station.picture.view import SwarmView
from tests.scenarios.swarm import VirtualSwarm


class _SwarmClock(Clock):
    """The swarm's time."""

    def __init__(self, swarm: VirtualSwarm) -> None:
        super().__init__(0.0, 1.0)
        self._swarm = swarm

    def now(self) -> float:
        return self._swarm.now


class Watch:
    """Listens to a `VirtualSwarm` and looks as often as a live station."""

    def __init__(self, swarm: VirtualSwarm) -> None:
        self.swarm = swarm
        self.journal = Journal()
        node = Node(MemoryTransport(swarm.mesh), "test", "watch")
        self._station = Station(swarm.plan, node, _SwarmClock(swarm))
        self._due_s = 0.0
        self._raised: dict[tuple[str, tuple[int, ...]], None] = {}
        self.banners: list[tuple[float, Level, str]] = []
        """(mission time, level, words) whenever the banner changes."""

    def tick(self) -> None:
        """One tick of the swarm, and a look where one is due."""
        self.swarm.tick()
        self._station.hear()
        if self.swarm.now >= self._due_s:
            self._due_s = self.swarm.now + LOOK_S
            self._look(self._station.view())

    def _look(self, view: SwarmView) -> None:
        self.journal.update(view)
        self._raised |= dict.fromkeys(alarm.key for alarm in self.journal.standing)
        level, words = verdict(view, self.journal.standing)[0]
        if not self.banners or self.banners[-1][1:] != (level, words):
            self.banners.append((view.time_s, level, words))

    def run(self, seconds: float) -> None:
        """Tick for so long."""
        until_s = self.swarm.now + seconds
        while self.swarm.now < until_s:
            self.tick()

    def fly(self, until_s: float = 1500.0) -> None:
        """Tick until every live agent has ended."""
        members = self.swarm.members.values()
        while self.swarm.now < until_s and any(m.alive and not m.frozen for m in members):
            self.tick()

    def wait(self, condition: Callable[[VirtualSwarm], bool], until_s: float = 300.0) -> None:
        """Tick until the condition holds; AssertionError after `until_s`."""
        while not condition(self.swarm):
            assert self.swarm.now < until_s, f"not reached by {until_s} s"
            self.tick()

    @property
    def raised(self) -> list[tuple[str, tuple[int, ...]]]:
        """(name, agents) of every alarm that was ever raised, in their order."""
        return list(self._raised)
