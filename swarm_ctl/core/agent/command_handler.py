"""An operator's commands as one agent takes them: acknowledged once and for all, refused with a
reason, never repeated.

A command that asks for something in the air (`hold`, `form`, `move`) overrides the mission: the
current step waits, its time-out too, until `resume` or `next`. The newest command counts, by the
sender's time, so that no order of arrival makes two agents differ.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from swarm_ctl.core.agent.progress import Progress
from swarm_ctl.core.law.formation import smallest_distance
from swarm_ctl.core.model.messages import Ack, Command, Phase
from swarm_ctl.core.model.plan import FormStep, HoldStep, LandStep, MoveStep, Plan, ReturnStep, Step
from swarm_ctl.core.safety.fence import outside
from swarm_ctl.core.swarm import gain_update
from swarm_ctl.core.swarm.peers import Peers

KINDS: Final = ("hold", "resume", "next", "form", "move", "tune", "land", "return", "kill")
_ANSWERS_KEPT: Final = 256
_FOREVER_S: Final = 1e9
_OVER: Final = (Phase.YIELD, Phase.ENDED)


@dataclass(frozen=True, slots=True)
class Override:
    """What is flown instead of the mission's step until the operator says `resume` or `next`."""

    kind: str
    step: Step
    """`hold` is a step as well: one without an end."""
    tag: int
    """`Command.tag`: agents with different ones do not lead each other."""
    leg: int
    """Where the mission's own step was, to go on from."""


@dataclass(frozen=True, slots=True)
class Seat:
    """What a command is judged by: where the agent is."""

    plan: Plan
    agent: int
    phase: Phase
    airborne: bool
    progress: Progress
    formed: bool
    """A form step has been begun: there is a shape to keep."""
    override: Override | None
    now: float
    peers: Peers


class CommandHandler:
    """Answers commands and remembers what they asked for."""

    def __init__(self, plan: Plan, agent_id: int, plan_hash: int) -> None:
        self._plan = plan
        self._id = agent_id
        self._hash = plan_hash
        self._answers: dict[str, Ack] = {}
        self._newest_s = -math.inf
        self.override: Override | None = None
        self.wants = ""
        """`land`, `return` or `kill` once asked for; these end the mission."""
        self.tuner = gain_update.GainUpdate(plan, agent_id, plan_hash)

    def answer(self, command: Command, seat: Seat, leg: int) -> tuple[Ack, bool]:
        """The answer, and whether something is to be done now (False: seen before, or refused)."""
        known = self._answers.get(command.id)
        if known is not None:
            return known, False
        reason = self._refusal(command, seat)
        if not reason and not _past(command, seat):
            self._obey(command, leg)
        ack = Ack(self._id, command.id, not reason, reason)
        self._answers[command.id] = ack
        if len(self._answers) > _ANSWERS_KEPT:
            del self._answers[next(iter(self._answers))]
        return ack, not reason and not _past(command, seat)

    def _refusal(self, command: Command, seat: Seat) -> str:
        if command.agents and self._id not in command.agents:
            return f"not meant for agent {self._id}"
        check = _CHECKS.get(command.kind)
        if check is None and command.kind not in gain_update.KINDS:
            return f"unknown command {command.kind!r}; allowed: {', '.join(KINDS)}"
        if seat.phase in _OVER and command.kind != "kill":
            return f"agent {self._id} no longer flies its vehicle"
        if command.plan_hash not in (0, self._hash):
            return f"it was made for the plan {command.plan_hash:016x}, ours is {self._hash:016x}"
        if check is None:
            return self.tuner.refusal(command, seat.now, seat.peers)
        if command.kind not in _ENDING and command.time_s < self._newest_s:
            return "a newer command is in force"
        return check(command, seat)

    def _obey(self, command: Command, leg: int) -> None:
        if command.kind in _ENDING:
            self.wants = command.kind
            return
        if command.kind in gain_update.KINDS:
            self.tuner.obey(command)
            return
        self._newest_s = command.time_s
        leg = self.override.leg if self.override else leg
        if command.kind in ("resume", "next"):
            self.override = None
        elif command.kind == "hold":
            self.override = Override("hold", HoldStep(_FOREVER_S, _FOREVER_S), command.tag, leg)
        elif command.step is not None:
            self.override = Override(command.kind, command.step, command.tag, leg)


def _past(command: Command, seat: Seat) -> bool:
    """A `next` that is done already: the swarm is in a later step than the one it was meant to
    end."""
    return command.kind == "next" and 0 < command.at_step < seat.progress.step


# --- why a command can't be: '' where it can ---


def _check_kill(command: Command, seat: Seat) -> str:  # noqa: ARG001
    return f"agent {seat.agent} has ended" if seat.phase is Phase.ENDED else ""


def _check_land(command: Command, seat: Seat) -> str:  # noqa: ARG001
    return ""


def _check_return(command: Command, seat: Seat) -> str:  # noqa: ARG001
    if seat.phase is Phase.LAND:
        return f"agent {seat.agent} is landing already"
    return "" if seat.airborne else f"agent {seat.agent} is not in the air"


def _check_flying(command: Command, seat: Seat) -> str:  # noqa: ARG001
    if not seat.airborne or seat.phase in (Phase.ARM, Phase.TAKEOFF):
        return f"agent {seat.agent} is not flying yet (phase {seat.phase.name.lower()}); allowed now: land, kill"
    if seat.phase in (Phase.LAND, Phase.RETURN) or isinstance(
        seat.progress.current, LandStep | ReturnStep
    ):
        return f"agent {seat.agent} is on its way down (phase {seat.phase.name.lower()}); allowed now: land, kill"
    if seat.phase is Phase.HOLD and seat.override is None:
        return f"agent {seat.agent} is held by a policy; allowed now: land, return, kill"
    return ""


def _check_resume(command: Command, seat: Seat) -> str:
    if seat.override is None:
        return f"agent {seat.agent} is not held; there is nothing to resume"
    return _check_flying(command, seat)


def _check_form(command: Command, seat: Seat) -> str:
    if not isinstance(command.step, FormStep):
        return "the command has no shape"
    if command.agents:
        return "a shape is for the whole swarm; give it to all agents"
    plan = seat.plan
    if len(command.step.slots) != len(plan.agents):
        return f"{command.step.shape} has {len(command.step.slots)} slots for {len(plan.agents)} agents"
    if not all(math.isfinite(x) for slot in command.step.slots for x in slot):
        return "a slot is not finite"
    apart = smallest_distance(command.step.slots)
    if apart <= plan.law.r_out:
        return f"slots of {command.step.shape} are {apart:.3g} units apart; allowed: more than r_out {plan.law.r_out:g}"
    return _check_flying(command, seat)


def _check_move(command: Command, seat: Seat) -> str:
    if not isinstance(command.step, MoveStep) or not command.step.waypoints_m:
        return "the command has no point to go to"
    if command.agents:
        return "the formation moves as a whole; give it to all agents"
    if not seat.formed:
        return "there is no formation to move yet"
    limit = seat.plan.limits.speed_mps
    if not 0 < command.step.speed_mps <= limit:
        return f"{command.step.speed_mps:g} m/s; allowed: above 0, at most {limit:g} m/s"
    for point in command.step.waypoints_m:
        reason = outside(seat.plan.fence, point, 0.0)
        if reason:
            return f"({point[0]:.0f}, {point[1]:.0f}) m: {reason}"
    return _check_flying(command, seat)


_ENDING: Final = ("land", "return", "kill")
_CHECKS: Final[dict[str, Callable[[Command, Seat], str]]] = {
    "hold": _check_flying,
    "resume": _check_resume,
    "next": _check_flying,
    "form": _check_form,
    "move": _check_move,
    "land": _check_land,
    "return": _check_return,
    "kill": _check_kill,
}
