"""A ground station: hears the mesh, folds it into the model, records it, sends an operator's
commands, says that it is there."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from dataclasses import replace
from typing import Any, Final, Protocol

from swarm_ctl.commands.build import AgentNow, SwarmNow, build
from swarm_ctl.commands.parse import Order
from swarm_ctl.commands.send import CommandSender, SentCommand
from swarm_ctl.core.model.messages import (
    ENDING,
    Ack,
    AgentState,
    AgentStatus,
    Command,
    CommandKind,
    Event,
    Payload,
    StationBeacon,
)
from swarm_ctl.core.model.plan import Plan
from swarm_ctl.engine.clock import Clock
from swarm_ctl.engine.station.mesh_clock import MeshClock
from swarm_ctl.engine.station.recorders import LiveRecorder
from swarm_ctl.engine.vehicle_memory import SwarmMemory
from swarm_ctl.errors import InputError
from swarm_ctl.mesh import keys
from swarm_ctl.mesh.node import Node
from swarm_ctl.recording.run_recorder import RunRecorder
from swarm_ctl.rim import Rim
from swarm_ctl.station.picture.model import Model
from swarm_ctl.station.picture.protection import LOCAL, Protection
from swarm_ctl.station.picture.view import AgentView, StationHealth, SwarmView

_CHANNELS: Final[tuple[keys.Channel[Any], ...]] = (
    keys.STATE,
    keys.SIGMA,
    keys.BEACON,
    keys.STATUS,
    keys.EVENT,
    keys.COMMAND,
    keys.ACK,
)
_OF_TARGETS: Final = (keys.TARGET, keys.SIGHTING)
"""Shown, and not recorded: agents tell what comes of them."""
_COMMANDS: Final = 1000
"""Of so many it is known that they were heard before."""
_BEACON_S: Final = 0.25
"""Twenty before an agent gives it up (5 s): with half of all messages lost one flight in 1,000;
with ten, one in 5."""


class AnyClock(Protocol):
    """Mission time, wherever it comes from."""

    speedup: float
    stepped: bool
    """In lockstep: it has no pace."""

    def now(self) -> float:
        """Mission time [s]."""


class Station:
    """One ground station on one mesh, under its node's name. `memory` gets what the agents say of
    their vehicles' own parameters."""

    def __init__(
        self,
        plan: Plan,
        node: Node,
        clock: Clock | MeshClock | AnyClock,
        recorder: RunRecorder | LiveRecorder | None = None,
        memory: SwarmMemory | None = None,
        protection: Protection = LOCAL,
    ) -> None:
        self.plan = plan
        self._node = node
        self.clock = clock
        """The mission's."""
        self._recorder = recorder
        self._memory = memory
        self._protection = protection
        self._news: list[str] = []
        self._name = str(node.name)
        self._hash = plan.hash()
        self._model = self._new_model()
        self._agents = agents = tuple(agent.id for agent in plan.agents)
        self._sender = CommandSender(self._publish, agents, clock.speedup)
        self._commands: deque[str] = deque(maxlen=_COMMANDS)
        self._beacon_due = 0.0
        self._views = Rim("the picture of the swarm")
        self._answers = Rim("an answer to a command")
        self._record_rim = Rim("the record of a message")
        self._memory_rim = Rim("the memory of the vehicles' own parameters")
        self.shows = Rim("the screen")
        """For who runs this station: what it shows on."""
        self._rims = [self._views, self._answers, self._record_rim, self._memory_rim, self.shows]
        node.listen(*_CHANNELS, agents=agents)
        if plan.targets:
            node.listen(*_OF_TARGETS, agents=agents)

    def _new_model(self) -> Model:
        clock = self.clock
        return Model(self.plan, speedup=clock.speedup, since_s=clock.now(), station=self._name)

    @property
    def name(self) -> str:
        """On the mesh."""
        return self._name

    def record(self, recorder: RunRecorder | LiveRecorder) -> None:
        """Record from now on."""
        self._recorder = recorder

    def tell_of(self, rims: Iterable[Rim]) -> None:
        """Tell what goes wrong in these, too."""
        self._rims += rims

    def tell(self, text: str) -> None:
        """Tell the operator, at the next turn."""
        self._news.append(text)

    def recall(self, past: Iterable[Event | Command | Ack]) -> None:
        """Take in what was said on the mesh before this station joined."""
        for payload in past:
            if isinstance(payload, Command):
                self._commands.append(payload.id)
            self._views.run(self._model.recall, payload)

    def states(self) -> tuple[AgentState, ...]:
        """The newest ones, of the plan's agents that are heard."""
        return self._views.run(self._model.states, self.clock.now()) or ()

    def order(self, order: Order, name: str = "") -> SentCommand:
        """Send the command for an operator's order, under this name if one is given; InputError
        where there can't be one."""
        if not self._protection.commands:
            raise InputError(f"{self._protection.who} may only watch; allowed: an operator's keys")
        now = self.clock.now()
        swarm = self._views.run(lambda: swarm_now(self._model.view(now)))
        if swarm is None:
            swarm = self._unseen(order, now)
        command = build(order, swarm)
        if name:
            command = replace(command, id=name)
        return self._sender.send(command, now, swarm.meant(order))

    def _unseen(self, order: Order, now: float) -> SwarmNow:
        """The swarm when there is no picture of it: a landing or a hold needs none."""
        if order.kind == CommandKind.NEXT and not order.at_step:
            raise InputError("next: there is no picture of the swarm, so its step is not known")
        for name in order.groups:
            if len({group.members for group in self.plan.groups if group.name == name}) > 1:
                raise InputError(
                    f"{order.kind}: there is no picture of the swarm, so who is in @{name} now is"
                    " not known; allowed: agents by their ids"
                )
        return SwarmNow(self.plan, now, 0, tuple(AgentNow(i, None) for i in self._agents))

    def _publish(self, command: Command) -> None:
        self._node.send(keys.COMMAND, command)
        self._take(command, self.clock.now())

    def turn(self) -> list[str]:
        """Hear the mesh, send what is due; what the operator is to be told."""
        if not self._clock_is_set():
            return []
        now = self.clock.now()
        if now >= self._beacon_due and self._protection.commands:
            self._beacon_due = now + _BEACON_S
            self._node.send(keys.BEACON, StationBeacon(self._name, now, self._hash))
        return self.hear()

    def hear(self) -> list[str]:
        """A turn without a beacon, which agents don't take for a station's."""
        if not self._clock_is_set():
            return []
        for channel in _CHANNELS:
            for payload, received_s in self._node.take(channel):
                self._take(payload, received_s)
        for channel in _OF_TARGETS if self.plan.targets else ():
            for word, received_s in self._node.take(channel):
                self._take(word, received_s)
        ended = self._sender.turn(self.clock.now())
        told = [f"tune: nothing changes; {sent.failed}" for sent in ended if sent.failed]
        told, self._news = told + self._news, []
        return told + self.troubles()

    def troubles(self) -> list[str]:
        """What of all that only shows went wrong since the last call, in words; in the record,
        too."""
        rims = (*self._rims, *(self._recorder.rims if self._recorder else ()))
        new = [trouble for rim in rims for trouble in rim.troubles()]
        recorder = self._recorder
        if recorder is None:
            return [str(trouble) for trouble in new]
        for trouble in new:
            self._record_rim.run(recorder.note, trouble, self.clock.now())
        return [str(trouble) for trouble in new]

    def _clock_is_set(self) -> bool:
        """Without a run's clock the first messages only set it: their ages mean nothing before."""
        clock = self.clock
        if not isinstance(clock, MeshClock) or clock.heard:
            return True
        told: list[AgentState | AgentStatus] = [state for state, _ in self._node.take(keys.STATE)]
        told += [status for status, _ in self._node.take(keys.STATUS)]
        ours = [each for each in told if each.agent in self._agents]
        if ours:
            newest = max(ours, key=lambda each: each.time_s)
            clock.hear(newest.agent, newest.time_s)
            self._model = self._new_model()
        return False

    def _take(self, payload: Payload, received_s: float) -> None:
        """Show and record a message; a command once, however often it is sent."""
        match payload:
            case Command() if payload.id in self._commands:
                return
            case Command():
                self._commands.append(payload.id)
            case Ack():
                self._answers.run(self._sender.hear, payload)
            case AgentStatus() if self._memory is not None:
                trouble = self._memory_rim.run(self._memory.hear, payload)
                self._news += [f"agent {payload.agent}: {trouble}"] if trouble else []
            case AgentState(agent=agent) if agent in self._agents:
                if isinstance(self.clock, MeshClock):
                    self.clock.hear(agent, payload.time_s)
        self._views.run(self._model.fold, payload, received_s)
        if self._recorder:
            self._record_rim.run(self._recorder.take, payload, received_s)

    def seen(self) -> SwarmView | None:
        """The picture now; None where none can be made."""
        return self._views.run(self.view)

    def view(self) -> SwarmView:
        """The picture now. Whoever keeps the flight safe takes `seen`."""
        now, node = self.clock.now(), self._node
        health = StationHealth(node.bad_payloads, refused=node.refused(now))
        return replace(self._model.view(now), health=health, protection=self._protection)


def swarm_now(view: SwarmView) -> SwarmNow:
    """What commands are built from."""
    flying = {agent.id for agents in view.laws.values() for agent in agents}
    left = view.left
    agents = tuple(
        AgentNow(
            id=agent.id,
            stop_point_m=agent.state.stop_point_m if agent.state else None,
            lost=agent.lost,
            flies=agent.id in flying,
            gains=agent.status.gains if agent.status else None,
            zones=agent.status.zones if agent.status else None,
            clock_ahead_s=agent.link.clock_ahead_s,
            shows_ahead_s=_shows_ahead_s(agent, view.time_s),
            left=agent.id in left,
            ends=agent.state is not None and agent.state.left in ENDING,
            down=agent.state.down if agent.state is not None else agent.id in left,
            step=agent.newest.step if agent.newest is not None else None,
        )
        for agent in view.agents
        if agent.in_plan
    )
    return SwarmNow(view.plan, view.time_s, view.step, agents, view.speedup)


def _shows_ahead_s(agent: AgentView, now: float) -> float:
    if agent.state is None or agent.silence_s is None:
        return 0.0
    return agent.state.time_s - (now - agent.silence_s)
