"""A member of the mesh that speaks as another, on an open mesh and on the virtual clock."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace

from swarm_ctl.core.model.messages import AgentState, Payload
from swarm_ctl.mesh import keys
from swarm_ctl.mesh.keys import Qos
from swarm_ctl.mesh.memory_transport import MemoryTransport
from swarm_ctl.mesh.payloads import decode, encode
from swarm_ctl.mesh.transport import Inlet, Transport
from swarm_ctl.mission.compile.loader import LoadedMission
from tests.scenarios.swarm import VirtualSwarm, landing_fast

Forge = Callable[[AgentState], AgentState]


class Attacked:
    """A swarm, and a forger that hears all agents and speaks to any as any."""

    def __init__(self, mission: LoadedMission) -> None:
        self._transports: dict[int, MemoryTransport] = {}
        self._forged: list[tuple[frozenset[int], frozenset[int], Forge, int]] = []
        self.swarm = landing_fast(VirtualSwarm(mission, mesh=self._tap))

    def _tap(self, inner: Transport, agent: int) -> Transport:
        assert isinstance(inner, MemoryTransport)
        self._transports[agent] = inner
        return _Tapped(inner, agent, self)

    def forge(self, speaks_as: Iterable[int], to: Iterable[int], word: Forge, times: int) -> None:
        """From now on, after each honest state of these agents come `times` forged ones, to some
        agents alone; 0: no more."""
        self._forged = [(frozenset(speaks_as), frozenset(to), word, times)] if times else []

    def say(self, channel: str, agent: int, to: Iterable[int], payload: Payload) -> None:
        """One message under the key of `agent`."""
        for other in to:
            key = f"swarm/test/agent/{agent}/{channel}"
            for inlet in self._transports[other].inlets(key):
                inlet.put(self.swarm.now, key, encode(payload))

    def heard(self, agent: int, data: bytes) -> None:
        """An honest state goes out."""
        for speaks_as, to, word, times in self._forged:
            state = decode(AgentState, data)
            for k in range(1, times + 1) if agent in speaks_as else ():
                later = replace(state, seq=state.seq + k, time_s=state.time_s + 0.001 * k)
                self.say("state", agent, to - {agent}, word(later))

    def said(self) -> str:
        """All that the agents have said."""
        return "\n".join(f"{event.agent}: {event.text}" for event in self.swarm.events)


class _Tapped(Transport):
    """What the forger hears of one agent."""

    def __init__(self, inner: MemoryTransport, agent: int, forger: Attacked) -> None:
        self._inner, self._agent, self._forger = inner, agent, forger

    def publish(self, key: str, data: bytes, qos: Qos) -> None:
        self._inner.publish(key, data, qos)
        if key.endswith(f"/{keys.STATE.name}"):
            self._forger.heard(self._agent, data)

    def subscribe(self, key_expression: str, *, timed: bool = False) -> Inlet:
        return self._inner.subscribe(key_expression, timed=timed)

    def close(self) -> None:
        self._inner.close()
