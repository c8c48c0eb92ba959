"""A client of a run that flies: joins its mesh, gives orders, waits for the answers."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final, Self

from swarm_ctl.commands.build import SwarmNow
from swarm_ctl.commands.parse import Order
from swarm_ctl.commands.send import SentCommand
from swarm_ctl.core.model.messages import AgentState, AgentStatus, CommandKind
from swarm_ctl.core.model.zones import Zone
from swarm_ctl.core.swarm.gain_update import ASKS
from swarm_ctl.engine import clock as wall
from swarm_ctl.engine.flying_runs import flying_run
from swarm_ctl.engine.lockstep.seat import TEST, BarrierSeat
from swarm_ctl.engine.protection import explained, operator_identity
from swarm_ctl.engine.station.ground_station import Station, swarm_now
from swarm_ctl.engine.station.swarm_mesh import SwarmMesh
from swarm_ctl.errors import StartError
from swarm_ctl.runfolder.manifest import Manifest, read_manifest
from swarm_ctl.station.picture.view import AgentView, SwarmView

_MADE_OF_ALL: Final = (CommandKind.FORM, CommandKind.MOVE, CommandKind.GOTO, *ASKS)
_HEAR_WALL_S: Final = 3.0
"""To hear the agents after joining; an agent that is silent for so long has ended or hangs."""
_REST_WALL_S: Final = 0.3
"""To hear the others after the first agent, for a command that can do without them."""
_GONE_WALL_S: Final = 2.0
"""An agent of which nothing is heard for so long after joining (forty states) is gone: its answer
is not waited for."""
_POLL_WALL_S: Final = 0.02
_OLD_S: Final = 5.0


class RunClient:
    """A member of a run's mesh that speaks for an operator. Close it, or use it in a `with`.

    `run` is a run folder or the mission of a run that flies; None: the only one that flies
    (`flying_run`). InputError where several may be meant.
    `seat`: at the barrier of a run in lockstep, which then waits for this client.
    `identity`: the folder of the operator who speaks; None: of the one who flies the run.
    `zenoh`: a user's own settings; None: those with which the run is flown.
    """

    def __init__(
        self,
        run: Path | str | None = None,
        seat: BarrierSeat | None = None,
        identity: Path | None = None,
        zenoh: Mapping[str, Any] | None = None,
    ) -> None:
        self._manifest: Manifest = read_manifest(flying_run(run))
        manifest, self._seat = self._manifest, seat
        self._identity = operator_identity(manifest.trust, identity or manifest.flown_by)
        mesh = SwarmMesh.of_run(manifest, self._identity, zenoh, seat)
        self._clock, self._node = mesh.clock, mesh.open_node("send")
        self._station = Station(manifest.plan, self._node, self._clock)
        if seat is not None:
            seat.join(TEST, manifest.swarm, self._node.name)
            self.turn()

    def turn(self) -> None:
        """Let a moment go by; at the barrier, a tick."""
        if self._seat is None:
            wall.pause(_POLL_WALL_S)
            return
        self._seat.end()
        while not self._seat.begin(_POLL_WALL_S):
            pass

    def now(self) -> float:
        """Mission time [s]."""
        return self._clock.now()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Leave the mesh."""
        self._node.close()
        if self._seat is not None:
            self._seat.close()

    def newest(self) -> dict[int, AgentState]:
        """The newest state of every agent heard in the last seconds; does not wait."""
        self._station.hear()
        since_s = self._clock.now() - _OLD_S
        return {agent.id: agent.state for agent in self._heard(since_s) if agent.state}

    def statuses(self) -> dict[int, AgentStatus]:
        """The newest status of every agent heard since joining; does not wait."""
        self._station.hear()
        return {agent.id: agent.status for agent in self._station.view().agents if agent.status}

    def view(self) -> SwarmView:
        """The swarm now, as this client has heard it since joining; does not wait."""
        self._station.hear()
        return self._station.view()

    def _now(self) -> SwarmNow:
        return swarm_now(self._station.view())

    def give(self, order: Order) -> SentCommand:
        """Send an order; its answers come while the flight goes on. InputError as `order`."""
        self._station.hear()
        return self._station.order(order)

    def order(self, order: Order) -> SentCommand:
        """Send an order until every agent that is meant has answered, or for ten seconds. Agents
        that are gone (never heard since joining) are not waited for.

        Raises:
            InputError: there can't be such a command.
            StartError: no agent is heard.
        """
        since_s, joined_s = self._clock.now(), self._waited_s()
        self._wait_for_agents(order)
        sent = self._station.order(order)
        while not sent.over:
            self.turn()
            self._station.hear()
            missed = {agent.id for agent in self._heard(since_s)}.intersection(sent.silent)
            if not missed and self._waited_s() > joined_s + _GONE_WALL_S:
                break
        # that an agent has left and ended may be heard of later than it was asked
        meant = {*self._now().meant(order), *sent.acks}
        sent.meant = tuple(agent for agent in sent.meant if agent in meant)
        return sent

    def zones(self) -> tuple[Zone, ...]:
        """Those in force, by what the agents tell. StartError where none is heard."""
        self._wait_for_agents(Order(CommandKind.ZONE))
        return self._station.view().zones

    def _wait_for_agents(self, order: Order) -> None:
        """A command that is made of where agents are, or of their law, waits for all that it is
        for; others leave as soon as the mesh is joined."""
        needs_all, since_s = order.kind in _MADE_OF_ALL, self._clock.now()
        until = self._waited_s() + _HEAR_WALL_S
        heard: list[AgentView] = []
        ready = set[int]()
        while not ready.issuperset(self._now().meant(order)) and self._waited_s() < until:
            self._station.hear()
            before, heard = heard, self._heard(since_s)
            ready = {agent.id for agent in heard if agent.status or order.kind not in ASKS}
            if heard and not before and not needs_all:
                until = min(until, self._waited_s() + _REST_WALL_S)
            self.turn()
        if not heard:
            why = explained(self._identity, self._manifest.agents_mesh) or "is the run over?"
            raise StartError(f"no agent of {self._manifest.swarm} can be heard; {why}")

    def _waited_s(self) -> float:
        """What its time-outs count by: the wall clock, at the barrier mission time."""
        return wall.wall_s() if self._seat is None else self._clock.now()

    def _heard(self, since_s: float) -> list[AgentView]:
        """The agents with a state that is not older."""
        agents = self._station.view().agents
        return [agent for agent in agents if agent.state and agent.state.time_s >= since_s]
