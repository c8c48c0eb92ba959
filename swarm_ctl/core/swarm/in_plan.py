"""What a message may name of the plan: steps, waypoints, agents, places; and figures that can be
reckoned with.

The mesh's payloads know no plan. So what a peer says is held against it here, before it is an index
anywhere: by agents (`core/swarm/plausibility.py`, `core/agent/command_handler.py`), by stations and
replays (`station/picture/model.py`) and by reports (`report/folder/`).
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import fields, is_dataclass, replace
from functools import lru_cache
from typing import Any, Final

from swarm_ctl.core.model.messages import (
    NO_EXCHANGE,
    AgentState,
    AgentStatus,
    Command,
    Payload,
    ReturnStage,
    SigmaReport,
)
from swarm_ctl.core.model.plan import Plan
from swarm_ctl.core.model.route import Routes
from swarm_ctl.core.swarm.snapshot import TRAFFIC

_MOST: Final = 1e12
"""Of a figure: seconds since 1970 are 2e9, and squares do not overflow."""
_MOST_WHOLE: Final = 2**64
_MOST_LEGS: Final = 255
"""With zones that were added in flight a way may have so many corners: states tell no more."""
_STAGES: Final = max(ReturnStage)


class InPlan:
    """What messages of one plan's swarm can name."""

    def __init__(self, plan: Plan) -> None:
        self._hash = plan.hash()
        routes = Routes(plan).of
        legs = {route: [len(step.way_m) for step in route.steps] for route in {*routes.values()}}
        self._legs = {agent: legs[route] for agent, route in routes.items()}
        """By agent, of each of its steps: how many waypoints can be passed."""
        self._routes = routes
        self._members = {
            agent: [len(route.group(k).agents) for k in range(len(route.steps) + 1)]
            for agent, route in routes.items()
        }
        """By agent, of the group that flies each of its steps."""
        self._ids = frozenset(self._legs)
        self._most_steps = max(map(len, self._legs.values()), default=0)

    def own_mission(self, state: AgentState) -> AgentState:
        """The same, without what it says of a mission where that is not this plan's: of an agent
        that the plan has not, or of one that flies another plan."""
        if state.plan_hash == self._hash and state.agent in self._ids:
            return state
        return replace(
            state, step=0, done=False, frame=None, override=0, exchange=NO_EXCHANGE, stage=0
        )

    def in_own_terms(self, payload: Payload) -> Payload:
        """`own_mission` of any payload; of a sigma report the pairs of agents: an aircraft or a
        target that an agent keeps clear of is none."""
        if isinstance(payload, AgentState):
            return self.own_mission(payload)
        if isinstance(payload, SigmaReport) and any(pair.peer == TRAFFIC for pair in payload.pairs):
            agents = tuple(pair for pair in payload.pairs if pair.peer != TRAFFIC)
            return replace(payload, pairs=agents)
        if isinstance(payload, AgentStatus) and payload.agent not in self._ids:
            return replace(
                payload,
                step=0,
                done=False,
                steps=(),
                roles=(),
                links={},
                doubted={},
                neighbours=(),
                without=(),
                nearest_agent=None,
            )
        return payload

    def unknown(self, payload: Payload) -> str:
        """What of this message names what the plan has not, in words; '' where it is all there."""
        if isinstance(payload, AgentState):
            return self.of_state(payload)
        odd = _odd_figure(payload)
        if odd:
            return odd
        match payload:
            case AgentStatus():
                return self._of_status(payload)
            case SigmaReport():
                return self._strange(pair.peer for pair in payload.pairs)
            case Command() if not 0 <= payload.at_step <= self._most_steps:
                return f"it names step {payload.at_step}; {_has(self._most_steps)}"
        return ""

    def of_state(self, state: AgentState) -> str:
        """`unknown` of a state: asked for each one that is heard, so without a search."""
        legs = self._legs.get(state.agent, ())
        if not 0 <= state.step <= len(legs):
            return f"it is in step {state.step}; {_has(len(legs))}"
        if not 0 <= state.stage <= _STAGES:
            return f"its way back is at stage {state.stage}; allowed: 0 to {_STAGES}"
        if state.exchange is not NO_EXCHANGE:
            said = state.exchange
            members = self._members[state.agent][state.step] if legs else 0
            odd = said.beyond(members)
            if odd is not None:
                return f"it names place {odd} in the plan; allowed: 0 to {members - 1}"
        frame = state.frame
        if frame is not None and frame.leg and not state.override and state.step:
            has = legs[state.step - 1]
            most = max(has, legs[state.step - 2] if state.step > 1 else 0)
            most = _MOST_LEGS if most and state.gains_tag else most
            if not 0 <= frame.leg <= most:
                return f"its formation has passed {frame.leg} waypoints; the step has {has}"
        figures: tuple[float, ...] = (
            *(state.time_s, state.response_s, state.doubt_s),
            *state.position_ned_m,
            *state.velocity_ned_mps,
            *state.stop_point_m,
            *state.setpoint_mps,
        )
        if frame is not None:
            figures += (*frame.point_m, frame.angle_rad, frame.scale, frame.rate)
        # one length for all: it is no less than the largest, and most are finite and small
        return "" if math.hypot(*figures) < _MOST else _odd_figure(state)

    def _of_status(self, status: AgentStatus) -> str:
        route = self._routes.get(status.agent)
        steps = len(route.steps) if route is not None else 0
        members = max((len(group.agents) for group in route.groups), default=0) if route else 0
        if not 0 <= status.step <= steps:
            return f"it is in step {status.step}; {_has(steps)}"
        if len(status.steps) > steps + 1:
            return f"it tells of {len(status.steps)} steps; {_has(steps)}"
        said = (*(place for _, place in status.roles), *_places_of(status.closings))
        places = [place for place in said if not 0 <= place < members]
        if places:
            return f"it names place {places[0]} in the plan; allowed: 0 to {members - 1}"
        if any(not 0 <= fewer < max(members, 1) for _, fewer, _ in status.closings):
            return f"its shape has more places fewer than the {members} of the plan"
        nearest = () if status.nearest_agent is None else (status.nearest_agent,)
        named = (*nearest, *status.neighbours, *status.links, *status.doubted, *status.without)
        return self._strange((*named, *(i for i in status.safety.kept_from if i)))

    def _strange(self, agents: Iterable[int]) -> str:
        odd = sorted(set(agents) - self._ids)
        return f"it names agent {odd[0]}, which the plan has not" if odd else ""


def _places_of(closings: Iterable[tuple[float, int, int]]) -> Iterable[int]:
    """Those that closed shapes name."""
    return (place for _, fewer, place in closings if fewer)


def _has(steps: int) -> str:
    return f"the plan has {steps} steps"


def _odd_figure(payload: object) -> str:
    for name, value in _figures(payload):
        most = _MOST if isinstance(value, float) else _MOST_WHOLE
        if not -most <= value <= most:
            return f"its {name} is {value:.3g}; allowed: up to {most:.0g}"
    return ""


def _figures(payload: object) -> Iterable[tuple[str, float]]:
    """All numbers in a payload, with the name of the field that has them."""
    left: list[tuple[str, Any]] = [("", payload)]
    for name, value in left:  # it grows meanwhile
        if isinstance(value, (float, int)):
            yield name, value
        elif isinstance(value, (tuple, list)):
            left += [(name, one) for one in value]
        elif isinstance(value, dict):
            left += [(name, one) for pair in value.items() for one in pair]
        else:
            kind: Any = type(value)
            left += [(field, getattr(value, field)) for field in _fields_of(kind)]


@lru_cache(64)
def _fields_of(kind: type[Any]) -> tuple[str, ...]:
    """Of a dataclass; none of any other type."""
    return tuple(field.name for field in fields(kind)) if is_dataclass(kind) else ()
