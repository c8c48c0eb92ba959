"""An operator's commands as one agent takes them: acknowledged once and for all, refused with a
reason, never repeated.

A command that asks for something in the air (`hold`, `form`, `move`) overrides the mission: the
current step waits, and its time-out with it, until `resume` or `next`. The newest command counts,
by the sender's time, so that no order of arrival makes two agents differ.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from swarm_ctl.core.agent.progress import Progress
from swarm_ctl.core.agent.return_to_launch import highest_m
from swarm_ctl.core.law.formation import smallest_distance
from swarm_ctl.core.model.messages import (
    ABOUT,
    ENDING,
    Ack,
    AgentState,
    Command,
    CommandKind,
    Departure,
    Phase,
)
from swarm_ctl.core.model.plan import MOST_UP_M, Plan, Point
from swarm_ctl.core.model.steps.hold import HoldStep
from swarm_ctl.core.model.steps.step import Step
from swarm_ctl.core.model.text import agents_named, printable
from swarm_ctl.core.safety.fence import outside
from swarm_ctl.core.safety.surroundings import Surroundings
from swarm_ctl.core.swarm import gain_update
from swarm_ctl.core.swarm.in_plan import InPlan
from swarm_ctl.core.swarm.snapshot import PeerSnapshot

KINDS: Final = tuple(kind for kind in CommandKind if kind is not CommandKind.APPLY)
"""What an operator can command."""
_ANSWERS_KEPT: Final = 256
_LONGEST_REASON: Final = 500
"""Characters, whatever a command brings along; answers are kept, and sent."""
_FOREVER_S: Final = 1e9
_OVER: Final = (Phase.YIELD, Phase.ENDED)
_ON_START: Final = (Phase.CONNECT, Phase.PREPARE, Phase.ARM, Phase.TAKEOFF)
_STILL: Final = (CommandKind.KILL, CommandKind.RESUME, *ABOUT)
"""What an agent that no longer flies its vehicle still obeys."""
_AT_ANY_TIME: Final = (*ENDING, *ABOUT)
"""What counts although a newer command is in force."""


@dataclass(frozen=True, slots=True)
class Override:
    """What is flown instead of the mission's step until the operator commands `resume` or
    `next`."""

    kind: str
    step: Step
    """`hold` is a step as well: one without an end."""
    tag: int
    """`Command.tag`: agents with different ones do not lead each other."""
    leg: int
    """Where the mission's own step was, to go on from there."""


@dataclass(frozen=True, slots=True)
class AgentSituation:
    """Where the agent is: what a command is judged by."""

    plan: Plan
    group: str
    members: tuple[int, ...]
    """Of the own group."""
    agent: int
    phase: Phase
    airborne: bool
    progress: Progress
    formed: bool
    """A form step has begun: there is a shape to keep."""
    override: Override | None
    peers: PeerSnapshot
    not_given_back: str = "its vehicle is not given back"
    """Why an agent that yielded cannot take its vehicle again, or ''."""
    held: bool = False
    """It is held until `resume`, because other agents have left the formation."""
    lands: bool = False
    """What stops its mission lands it; it may brake first."""

    @property
    def phase_name(self) -> str:
        """`land`."""
        return self.phase.name.lower()


class CommandHandler:
    """Answers commands and remembers what they asked for."""

    def __init__(self, plan: Plan, agent_id: int, plan_hash: int, speedup: float = 1.0) -> None:
        self._id = agent_id
        self._origins = CommandOrigins(agent_id, speedup)
        self._all = {agent.id for agent in plan.agents}
        self._hash = plan_hash
        self._in_plan = InPlan(plan)
        self._answers: dict[str, Ack] = {}
        self._newest_s = -math.inf
        self.override: Override | None = None
        self._before: Override | None = None
        """What `override` took the place of."""
        self.ordered: CommandKind | None = None
        """`LAND`, `RETURN` or `KILL` once commanded; these end the mission."""
        self.left: Departure | None = None
        """Such an order that was not given to all agents."""
        self.launched = False
        """It waits on the ground no more."""
        self.expelled: set[int] = set()
        """The agents that the operator has expelled; the own id: the others do not listen. A
        process that is started again has to be told: law and zones it takes up from half of those
        that it hears, so one of two peers could expel the other with a lie."""
        self._expelled_by: int | None = None
        """The tag of the command that expelled this agent before it flew, for its hold."""
        self.gain_update = gain_update.GainUpdate(plan, agent_id, plan_hash)

    @property
    def sent_to(self) -> tuple[Point, float] | None:
        """The place that this agent was sent to alone [m], and how fast it flies there [m/s]."""
        sends = self.override.step.sends if self.override is not None else None
        place_m = sends.place_m(self._id) if sends is not None else None
        return None if sends is None or place_m is None else (place_m, sends.speed_mps)

    def come_back(self) -> None:
        """To the others, without an order to join them."""
        self.override = None

    @property
    def tag(self) -> int:
        """`Command.tag` of the command that is flown instead of the mission's step; 0: none."""
        return self.override.tag if self.override is not None else 0

    def answer(self, command: Command, situation: AgentSituation, leg: int) -> tuple[Ack, bool]:
        """The answer, and whether something is to be done now (False: seen before, or refused).

        `leg`: how far the mission's step has come, in waypoints.
        """
        known = self._answers.get(command.id)
        if known is not None:
            return known, False
        reason = self._origins.refusal(command, situation.peers.now_s)
        reason = printable(reason or self._refusal(command, situation), _LONGEST_REASON)
        obeyed = not reason and not _done(command, situation)
        if obeyed:
            self._obey(command, situation, leg)
        ack = Ack(self._id, command.id, not reason, reason)
        self._answers[command.id] = ack
        if len(self._answers) > _ANSWERS_KEPT:
            del self._answers[next(iter(self._answers))]
        return ack, obeyed

    def _refusal(self, command: Command, situation: AgentSituation) -> str:
        if command.agents and self._id not in command.agents:
            return f"not meant for agent {self._id}"
        check = _CHECKS.get(command.kind)
        if check is None and command.kind not in gain_update.KINDS:
            return f"unknown command {command.kind!r}; allowed: {', '.join(KINDS)}"
        if situation.phase in _OVER and command.kind not in _STILL:
            return f"agent {self._id} no longer flies its vehicle"
        unknown = self._in_plan.unknown(command)
        if unknown:
            return unknown
        if command.plan_hash not in (0, self._hash):
            return f"it was made for the plan {command.plan_hash:016x}, ours is {self._hash:016x}"
        # a change of law or zones is for all that fly: a refusal would keep it from the others
        if self._id in self.expelled and check is not None and command.kind not in _AT_ANY_TIME:
            return f"agent {self._id} is expelled; allowed now: readmit, land, return, kill"
        if check is None:
            why = self.gain_update.refusal(command, situation.peers)
            early = situation.phase in _ON_START
            return why or (self._over_start(command, situation.plan) if early else "")
        if command.kind not in _AT_ANY_TIME and command.time_s < self._newest_s:
            return "a newer command is in force"
        return check(command, situation)

    def _over_start(self, command: Command, plan: Plan) -> str:
        """The zone that the vehicle would be in that stands on its start or climbs over it; ''."""
        zones = command.tuning.zones if command.tuning else None
        if not zones:
            return ""
        around = Surroundings(zones, None, plan.response, plan.limits.speed_mps)
        start = complex(*plan.agent(self._id).start) * plan.unit_m
        for wall, margins in around.near(start, 0.0, highest_m(plan, self._id)):
            if wall.gap < margins.keep:
                name, keep = around.name(wall.about), margins.keep
                where = f"in {name}" if wall.gap < 0.0 else f"{wall.gap:.1f} m from {name}"
                allowed = f"a zone at least {keep:.1f} m from the starts until all have taken off"
                return f"agent {self._id} would take off {where}; allowed: {allowed}"
        return ""

    def _obey(self, command: Command, situation: AgentSituation, leg: int) -> None:
        if command.kind in ENDING:
            self.ordered = CommandKind(command.kind)
            if command.agents and not self._all.issubset(command.agents):
                self.left = Departure(self.ordered, situation.peers.now_s)
            return
        if command.kind in gain_update.KINDS:
            self.gain_update.obey(command)
            return
        if command.kind == CommandKind.LAUNCH:
            self.launched = True
            return
        if command.kind in ABOUT and not self._obey_about(command, situation):
            return
        self._newest_s = command.time_s
        self._before = self.override
        leg = self.override.leg if self.override else leg
        if command.kind in (CommandKind.RESUME, CommandKind.NEXT, CommandKind.READMIT):
            self.override = None
        elif command.kind in (CommandKind.HOLD, CommandKind.EXPEL):
            forever = HoldStep(_FOREVER_S, _FOREVER_S)
            self.override = Override(command.kind, forever, command.tag, leg)
        elif command.step is not None:
            self.override = Override(command.kind, command.step, command.tag, leg)

    def _obey_about(self, command: Command, situation: AgentSituation) -> bool:
        """Note who is expelled; whether this agent is to stop for that, or to go on."""
        meant = self._id in command.about
        if command.kind == CommandKind.EXPEL:
            self.expelled.update(command.about)
            holds = meant and not _check_flying(command, situation)
            if meant and not holds:
                self._expelled_by = command.tag
            return holds
        self.expelled.difference_update(command.about)
        self._expelled_by = None if meant else self._expelled_by
        return meant and self.override is not None and self.override.kind == CommandKind.EXPEL

    def hold_expelled(self, leg: int) -> bool:
        """Hold, now that this agent flies, which was expelled before; whether it was."""
        if self._expelled_by is None or self.override is not None:
            return False
        forever = HoldStep(_FOREVER_S, _FOREVER_S)
        self.override = Override(CommandKind.EXPEL, forever, self._expelled_by, leg)
        self._expelled_by = None
        return True

    def drop_alone(self) -> bool:
        """Drop a shape or a move that no other agent flies, for what was flown before; whether
        there was one."""
        override = self.override
        if override is None or override.kind not in _TOGETHER:
            return False
        self.override, self._before = self._before, None
        return True


def _done(command: Command, situation: AgentSituation) -> bool:
    """What is done already: a `next`, as the swarm is past the step that it was meant to end; a
    `resume` to all, as this agent flies its mission and others are held."""
    if command.kind == CommandKind.RESUME:
        waits = situation.held or situation.override is not None
        return not waits and situation.phase is not Phase.YIELD
    return command.kind == CommandKind.NEXT and 0 < command.at_step < situation.progress.step


# --- why a command cannot be obeyed: '' where it can ---

_TOGETHER: Final = (CommandKind.FORM, CommandKind.MOVE, CommandKind.FOLLOW)
_WAY_DOWN: Final = "allowed now: land, kill"
_HELD: Final = (Phase.HOLD, Phase.YIELD)


def _check_kill(_: Command, situation: AgentSituation) -> str:
    return f"agent {situation.agent} has ended" if situation.phase is Phase.ENDED else ""


def _check_land(_: Command, __: AgentSituation) -> str:
    return ""


def _check_return(_: Command, situation: AgentSituation) -> str:
    if situation.phase is Phase.LAND or situation.lands:
        return f"agent {situation.agent} is landing already"
    return "" if situation.airborne else f"agent {situation.agent} is not in the air"


def _check_about(command: Command, situation: AgentSituation) -> str:
    if situation.phase in (Phase.CONNECT, Phase.PREPARE):
        return "no agent flies yet; on the ground, revoke its key (swarm-ctl trust revoke)"
    known = [agent.id for agent in situation.plan.agents]
    unknown = [i for i in command.about if i not in known]
    if not command.about or unknown or len(command.about) >= len(known):
        allowed = f"some of {', '.join(map(str, known))}, not all"
        return f"it is about agents {list(command.about)}; allowed: {allowed}"
    return ""


def _check_flying(_: Command, situation: AgentSituation) -> str:
    agent, phase = f"agent {situation.agent}", situation.phase
    if not situation.airborne or phase in (Phase.ARM, Phase.TAKEOFF):
        return f"{agent} is not flying yet (phase {situation.phase_name}); {_WAY_DOWN}"
    if situation.progress.goes_down or phase in (Phase.LAND, Phase.RETURN):
        return f"{agent} is on its way down (phase {situation.phase_name}); {_WAY_DOWN}"
    if phase is Phase.HOLD and situation.override is None:
        resume = "resume, " if situation.held else ""
        return f"{agent} is held by a policy; allowed now: {resume}land, return, kill"
    return ""


def _waits(peer: AgentState) -> bool:
    """A `resume` is for it: it flies a command, is held, or is away; on its way back, too, so that
    who hears the order later than it did says the same."""
    return bool(peer.override) or peer.left is CommandKind.GOTO or peer.phase in _HELD


def _check_resume(command: Command, situation: AgentSituation) -> str:
    if situation.phase is Phase.YIELD:
        return situation.not_given_back
    if situation.phase is Phase.ENDED:
        return f"agent {situation.agent} has ended"
    if situation.held:
        return ""
    if situation.override is None:
        peers = situation.peers.fresh() if situation.phase is Phase.FLY else ()
        if not command.agents and any(map(_waits, peers)):
            return ""
        return f"agent {situation.agent} is not held; there is nothing to resume"
    return _check_flying(command, situation)


def _not_for_group(command: Command, situation: AgentSituation) -> str:
    """To whom a command has to be given that is not for all of the own group; ''."""
    if not command.agents or set(command.agents).issuperset(situation.members):
        return ""
    if len(situation.members) == len(situation.plan.agents):
        return "give it to all agents"
    return f"give it to group {situation.group}, {agents_named(situation.members)}"


def _check_form(command: Command, situation: AgentSituation) -> str:
    step, plan = command.step.new_shape if command.step else None, situation.plan
    if step is None:
        return "the command has no shape"
    wider = _not_for_group(command, situation)
    if wider:
        return f"a shape is for a whole group; {wider}"
    if len(step.slots) != len(situation.members):
        return f"{step.shape} has {len(step.slots)} slots for {len(situation.members)} agents"
    if not all(math.isfinite(x) for slot in step.slots for x in slot):
        return "a slot is not finite"
    if step.ups_m and (plan.wake is None or len(step.ups_m) != len(step.slots)):
        return "a shape with heights; allowed: one of a mission whose shapes have some"
    if not all(abs(up_m) <= MOST_UP_M for up_m in step.ups_m):  # NaN is not
        return f"a slot is over {MOST_UP_M:g} m above or below the flight height"
    apart, r_out = smallest_distance(step.slots, step.ups_m, plan.slot_layer_m), plan.law.r_out
    if apart <= r_out:
        return (
            f"slots of {step.shape} are {apart:.3g} units apart; allowed: more than r_out {r_out:g}"
        )
    return _check_flying(command, situation)


def _check_move(command: Command, situation: AgentSituation) -> str:
    path = command.step.path if command.step else None
    if path is None or not path.way_m:
        return "the command has no point to go to"
    apart = _not_for_group(command, situation)
    if apart:
        return f"the formation moves as a whole; {apart}"
    if not situation.formed:
        return "there is no formation to move yet"
    limit = situation.plan.limits.speed_mps
    if not 0 < path.speed_mps <= limit:
        return f"{path.speed_mps:g} m/s; allowed: above 0, at most {limit:g} m/s"
    for point in path.way_m:
        reason = outside(situation.plan.fence, point, 0.0)
        if reason:
            return f"({point[0]:.0f}, {point[1]:.0f}) m: {reason}"
    return _check_flying(command, situation)


def _check_follow(command: Command, situation: AgentSituation) -> str:
    step, plan = command.step.follows if command.step else None, situation.plan
    if step is None:
        return "the command has no target"
    apart = _not_for_group(command, situation)
    if apart:
        return f"the formation follows as a whole; {apart}"
    if not situation.formed:
        return "there is no formation yet that could follow"
    if step.target not in [target.name for target in plan.targets]:
        return f"the mission has no target {step.target!r}"
    if not all(map(math.isfinite, step.offset_m)):
        return "the offset is not finite"
    limit = plan.limits.speed_mps
    if not 0 < step.speed_mps <= limit:
        return f"{step.speed_mps:g} m/s; allowed: above 0, at most {limit:g} m/s"
    return _check_flying(command, situation)


def _check_launch(_: Command, situation: AgentSituation) -> str:
    agent, progress = f"agent {situation.agent}", situation.progress
    if not situation.plan.agent(situation.agent).waits:
        return f"{agent} does not wait on the ground: it takes off with the others"
    if progress.step or situation.phase not in (Phase.CONNECT, Phase.PREPARE):
        return f"{agent} has been launched (phase {situation.phase_name})"
    steps = [p.state.step for p in situation.peers.peers if p.state and p.state.airborne]
    if not any(steps):
        return "no agent flies yet that it could join; allowed after the take-off"
    if any(progress.steps[min(step, len(progress.steps)) - 1].goes_down for step in steps if step):
        return "the others are on their way down"
    return ""


def _check_goto(command: Command, situation: AgentSituation) -> str:
    step, plan = command.step.sends if command.step else None, situation.plan
    place = step.place_m(situation.agent) if step is not None else None
    if step is None or place is None:
        return "the command has no place for this agent"
    if not command.agents or len(command.agents) == len(plan.agents):
        return "it is for some agents alone; `move` is for all"
    limit = plan.limits.speed_mps
    if not 0 < step.speed_mps <= limit:
        return f"{step.speed_mps:g} m/s; allowed: above 0, at most {limit:g} m/s"
    if not all(map(math.isfinite, place)):
        return "the place is not finite"
    reason = outside(plan.fence, place, 0.0)
    if reason:
        return f"({place[0]:.0f}, {place[1]:.0f}) m: {reason}"
    return _check_flying(command, situation)


_CHECKS: Final[dict[str, Callable[[Command, AgentSituation], str]]] = {
    CommandKind.HOLD: _check_flying,
    CommandKind.RESUME: _check_resume,
    CommandKind.NEXT: _check_flying,
    CommandKind.FORM: _check_form,
    CommandKind.MOVE: _check_move,
    CommandKind.FOLLOW: _check_follow,
    CommandKind.GOTO: _check_goto,
    CommandKind.LAUNCH: _check_launch,
    CommandKind.LAND: _check_land,
    CommandKind.RETURN: _check_return,
    CommandKind.KILL: _check_kill,
    CommandKind.EXPEL: _check_about,
    CommandKind.READMIT: _check_about,
}


FRESH_COMMAND_S: Final = 15.0
"""A command is repeated for 10 s at most, and clocks are told apart by seconds. At `--speedup 4` it
is 60 s of mission time: the sender repeats by the wall clock."""
_STATIONS_KEPT: Final = 64
_NUMBERS_KEPT: Final = 64


class CommandOrigins:
    """Whether a command is new: by its sender's clock, and by its sender's own count of commands.

    A command that was recorded and is sent again is old, or its number was used. A sender that
    repeats a command until all have answered repeats its id and number, too: `CommandHandler`
    answers that one as before. Numbers may come out of order, because one command may wait for an
    answer while the next one is sent.
    """

    def __init__(self, own_id: int, speedup: float) -> None:
        self._own = own_id
        self._fresh_s = FRESH_COMMAND_S * max(1.0, speedup)
        self._numbers: dict[str, list[int]] = {}
        """By station, the newest ones, sorted."""

    def refusal(self, command: Command, now: float) -> str:
        """Why the command is not new; '' where it is, and then its number is used."""
        old_s = now - command.time_s - dict(command.ahead_s).get(self._own, 0.0)
        if not abs(old_s) <= self._fresh_s:
            when = f"{old_s:.0f} s old" if old_s > 0 else f"from {-old_s:.0f} s ahead"
            return f"it is {when}, by its sender's clock; allowed: {self._fresh_s:g} s"
        used = self._numbers.pop(command.station, [])
        self._numbers[command.station] = used  # the newest station last
        if len(self._numbers) > _STATIONS_KEPT:
            del self._numbers[next(iter(self._numbers))]
        too_low = command.number <= 0 or (len(used) == _NUMBERS_KEPT and command.number < used[0])
        if too_low or command.number in used:
            what = f"number {command.number} of {command.station or 'its sender'}"
            return f"{what} was used by another command"
        used.append(command.number)
        used.sort()
        del used[:-_NUMBERS_KEPT]
        return ""
