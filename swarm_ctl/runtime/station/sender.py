"""An operator's command from outside: joins the mesh of a run, sends until all have answered, tells
who said what."""

from __future__ import annotations

import os
import uuid
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import TracebackType
from typing import Final, Self

from swarm_ctl.commands import build
from swarm_ctl.commands.parse import Order
from swarm_ctl.core.agent.command_handler import KINDS
from swarm_ctl.core.model.messages import Ack, AgentState, Command
from swarm_ctl.core.model.plan import FormStep, MoveStep, Point
from swarm_ctl.core.swarm.gain_update import GainUpdateRound
from swarm_ctl.errors import InputError, StartError
from swarm_ctl.mesh import keys
from swarm_ctl.mesh.node import Node
from swarm_ctl.mesh.zenoh_transport import ZenohTransport
from swarm_ctl.report.folder.manifest import Manifest, read_manifest
from swarm_ctl.runtime import clock as wall
from swarm_ctl.runtime.clock import Clock
from swarm_ctl.runtime.station.composing import compose
from swarm_ctl.station.picture.model import Model

_HEAR_WALL_S: Final = 3.0
"""To hear the first states after joining; agents that say nothing for so long have ended or
hang."""
_ANSWER_WALL_S: Final = 5.0
_REPEAT_WALL_S: Final = 0.5
_POLL_WALL_S: Final = 0.02
_OLD_S: Final = 5.0


@dataclass(frozen=True, slots=True)
class Answers:
    """What became of a command. `silent` are agents that were meant and did not answer."""

    command: Command
    acks: dict[int, Ack]
    silent: tuple[int, ...]
    failed: str = ""
    """Why it was dropped although some had accepted it."""

    @property
    def accepted(self) -> bool:
        """By everybody who was meant."""
        return (
            not self.failed and not self.silent and all(ack.accepted for ack in self.acks.values())
        )


class Sender:
    """A member of a run's mesh that speaks for an operator. Close it, or use it in a `with`."""

    def __init__(self, folder: Path) -> None:
        self.manifest: Manifest = read_manifest(folder)
        self._clock = Clock(self.manifest.epoch_s, self.manifest.speedup)
        transport = ZenohTransport(
            [], self.manifest.whole_mesh, self._clock.now, self._clock.speedup
        )
        self._node = Node(
            transport, self.manifest.swarm, f"send-{os.getpid()}-{uuid.uuid4().hex[:6]}"
        )
        self._node.listen(keys.ACK, keys.STATE, keys.STATUS)
        self._states: dict[int, AgentState] = {}
        self._model = Model(
            self.manifest.plan, speedup=self._clock.speedup, since_s=self._clock.now()
        )

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        value: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def close(self) -> None:
        """Leave the mesh."""
        self._node.close()

    def hear(self) -> dict[int, AgentState]:
        """The newest state of every agent that can be heard; waits a little for those of the
        plan."""
        wanted = {agent.id for agent in self.manifest.plan.agents}
        until = wall.wall_s() + _HEAR_WALL_S
        self._states.clear()
        self._listen()
        while not wanted <= self._states.keys() and wall.wall_s() < until:
            wall.pause(_POLL_WALL_S)
            self._listen()
        if not self._states:
            raise StartError(f"no agent of {self.manifest.swarm} can be heard; is the run over?")
        return dict(self._states)

    def newest(self) -> dict[int, AgentState]:
        """The newest state of every agent heard in the last seconds; does not wait."""
        self._listen()
        now = self._clock.now()
        return {i: state for i, state in self._states.items() if now - state.time_s < _OLD_S}

    def send(
        self, kind: str, agents: Sequence[int] = (), step: FormStep | MoveStep | None = None
    ) -> Answers:
        """Send a command until everybody who is meant has answered, for at most five seconds of the
        wall clock."""
        if kind not in KINDS:
            raise InputError(f"unknown command {kind!r}; allowed: {', '.join(KINDS)}")
        plan = self.manifest.plan
        known = tuple(agent.id for agent in plan.agents)
        for agent in agents:
            if agent not in known:
                raise InputError(
                    f"there is no agent {agent}; allowed: {', '.join(map(str, known))}"
                )
        states = self.hear()
        made_for = plan.hash() if step is not None else 0
        at_step = max(state.step for state in states.values()) if kind == "next" else 0
        command = Command(
            uuid.uuid4().hex, kind, tuple(agents), self._clock.now(), step, made_for, at_step
        )
        return self._wait(command, tuple(agents) or known)

    def form(self, shape: str) -> Answers:
        """Form a shape of the mission's file; who takes which slot is decided here, once."""
        points = self._points(shape)
        return self.send(
            "form", step=build.form(Path(self.manifest.mission), self.manifest.plan, shape, points)
        )

    def move(self, to_m: Point, *, by: bool = False, speed_mps: float | None = None) -> Answers:
        """Take the formation's centre to a point (north, east of the origin, metres), or by so
        much."""
        if by:
            points = list(self._points("move").values())
            centre = (
                sum(p[0] for p in points) / len(points),
                sum(p[1] for p in points) / len(points),
            )
            to_m = (centre[0] + to_m[0], centre[1] + to_m[1])
        return self.send("move", step=build.move(self.manifest.plan, to_m, speed_mps))

    def tune(self, values: Sequence[str]) -> Answers:
        """Change the law of all agents at one time, or of none (`core/swarm/gain_update.py`):
        `h=0.04`, ..., or `plan`.

        `Answers.failed` says why nothing has changed.
        """
        self.hear()
        until = (
            wall.wall_s() + _HEAR_WALL_S
        )  # each agent's law comes with its status, twice a second
        while (
            not all(self._model.view(0.0).agent(i).status for i in self._states)
            and wall.wall_s() < until
        ):
            wall.pause(_POLL_WALL_S)
            self._listen()
        view = self._model.view(self._clock.now())
        command = compose(Order("tune", tuple(values)), view, Path(self.manifest.mission))
        change = GainUpdateRound(command)
        asked = self._wait(command, command.agents, change)
        if change.applied is None:
            return replace(asked, failed=change.failed)
        return self._wait(change.applied, command.agents)

    def _points(self, what: str) -> dict[int, Point]:
        """Where everybody is now; InputError where somebody is not heard."""
        points = {i: state.stop_point_m for i, state in self.hear().items()}
        missing = [agent.id for agent in self.manifest.plan.agents if agent.id not in points]
        if missing:
            raise InputError(
                f"{what}: agent {', '.join(map(str, missing))} is not heard; nothing was sent"
            )
        return points

    def _wait(
        self, command: Command, meant: tuple[int, ...], change: GainUpdateRound | None = None
    ) -> Answers:
        """Until all have answered, or the change is decided."""
        acks: dict[int, Ack] = {}
        until, due = wall.wall_s() + _ANSWER_WALL_S, 0.0
        while (
            len(acks) < len(meant) if change is None else not change.over
        ) and wall.wall_s() < until:
            if wall.wall_s() >= due:
                due = wall.wall_s() + _REPEAT_WALL_S
                self._node.send(keys.COMMAND, command)
            wall.pause(_POLL_WALL_S)
            for ack, _ in self._node.take(keys.ACK):
                if ack.command == command.id and ack.agent in meant:
                    acks[ack.agent] = ack
                if change is not None:
                    change.hear(ack)
            if change is not None:
                change.decide(self._clock.now())
            self._listen()
        return Answers(command, acks, tuple(agent for agent in meant if agent not in acks))

    def _listen(self) -> None:
        for state, received_s in self._node.take(keys.STATE):
            self._states[state.agent] = state
            self._model.fold(state, received_s)
        for status, received_s in self._node.take(keys.STATUS):
            self._model.fold(status, received_s)
