"""The steps of each agent from its first to its last, over the groups that it flies in, and for
whom it waits after each of them."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import Final

from swarm_ctl.core.model.plan import GroupPlan, Plan, Policy
from swarm_ctl.core.model.steps.table import AnyStep


class Route:
    """The way of the agents that fly in the same groups. Its steps count from 1 through all of
    them; 0 is preparation."""

    def __init__(self, groups: Sequence[GroupPlan]) -> None:
        self.groups: Final = tuple(groups)
        self.steps: Final[tuple[AnyStep, ...]] = tuple(
            step for group in groups for step in group.steps
        )
        self._groups = groups[0], *(group for group in groups for _ in group.steps)
        self.names: Final = tuple(group.name for group in self._groups)
        """Of the group, by the number of the step."""

    def group(self, number: int) -> GroupPlan:
        """That flies this step; beyond the last one, that flew the last."""
        return self._groups[min(max(number, 0), len(self.steps))]

    def step_name(self, number: int) -> str:
        """As `GroupPlan.step_name`."""
        return self.group(number).step_name(number)

    @cached_property
    def barriers(self) -> dict[str, int]:
        """By name, the number of the first step that is it."""
        found = [(step.barrier, k) for k, step in enumerate(self.steps, 1) if step.barrier]
        return dict(reversed(found))


class Routes:
    """Of all agents of a plan."""

    def __init__(self, plan: Plan) -> None:
        groups = plan.groups
        of_agent = {
            agent.id: tuple(k for k, group in enumerate(groups) if agent.id in group.members)
            for agent in plan.agents
        }
        routes = {way: Route([groups[k] for k in way]) for way in {*of_agent.values()}}
        self.of: Final[Mapping[int, Route]] = {i: routes[way] for i, way in of_agent.items()}
        """By agent."""
        self._awaited: dict[tuple[int, int], Mapping[int, int]] = {}
        """By agent and step: asked for several times a tick."""

    def awaited(self, agent: int, number: int) -> Mapping[int, int]:
        """Whom this agent waits for after the step of this number, itself among them: by agent, the
        number of the step that has to be done. They are its group's; at a barrier, all that have it
        on their way."""
        known = self._awaited.get((agent, number))
        if known is None:
            name = self.of[agent].steps[number - 1].barrier if number else ""
            known = waits = dict.fromkeys(self.of[agent].group(number).ids, number)
            if name:
                there = ((i, route.barriers.get(name)) for i, route in self.of.items())
                waits |= {i: k for i, k in there if k is not None and i not in waits}
            self._awaited[agent, number] = known
        return known

    def late(self, agent: int, number: int, told: Mapping[int, tuple[int, bool]]) -> list[int]:
        """Who keeps this agent from going on after its step of this number, by the progress (step,
        done) that each of those tells for whom it waits."""
        waits = self.awaited(agent, number)
        return [other for other, progress in told.items() if progress < (waits[other], True)]

    def proven(self, agent: int, other: int, number: int) -> int:
        """The furthest step that this agent must be in, because the other one is in the step of
        this number; a step that goes on when its time is over proves nothing of other groups."""
        route, way = self.of[agent], self.of[other]
        if agent in way.group(number).members:
            return number
        passed = [
            self.awaited(other, k).get(agent, -1) + 1
            for k in range(number)
            if k == 0
            or way.steps[k - 1].on_timeout is not Policy.CONTINUE
            or agent in way.group(k).members
        ]
        return min(max(passed, default=0), len(route.steps))


def flight_s(plan: Plan, seconds: Sequence[float]) -> float:
    """How long the whole flight takes, each of `Plan.all_steps` so long [s]: a group begins when
    all of its agents have come."""
    times, ends_s, here_s = iter(seconds), list[float](), dict[int, float]()
    for group in plan.groups:
        begins_s = max(here_s.get(agent, 0.0) for agent in group.ids)
        ends_s.append(begins_s + sum(itertools.islice(times, len(group.steps))))
        here_s |= dict.fromkeys(group.ids, ends_s[-1])
    return max(ends_s)
