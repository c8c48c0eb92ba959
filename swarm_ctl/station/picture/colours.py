"""Which colour an agent has, the same on screens, in reports and in figures: its own, or its
group's in a mission that splits."""

from __future__ import annotations

from typing import Final

from swarm_ctl.core.model.plan import EVERYONE, Plan

COLOURS: Final = (
    *("#0072B2", "#009E73", "#CC79A7", "#56B4E9", "#8C564B"),
    *("#E69F00", "#D55E00", "#7F7F7F", "#000000"),
)
"""Colour-blind readers can tell them apart (Okabe and Ito); last those that look like alarms."""
ON_DARK: Final = (*COLOURS[:-1], "#FFFFFF")
"""The same as words on a dark screen."""
ON_LIGHT: Final = (
    *("#005A8C", "#007857", "#A84A80", "#1F7DB4", "#7A4A40"),
    *("#8F6200", "#B04A00", "#6A6A6A", "#000000"),
)
"""And on a light one: darker, or they could not be read."""


def inks(plan: Plan) -> list[int]:
    """The number of each agent's colour; in a mission with groups those of a group have one."""
    names = group_names(plan)
    if not names:
        return [*range(len(plan.agents))]
    numbers = {name: k for k, name in enumerate(names)}
    return [numbers.get(name, len(names)) for name in first_groups(plan)]


def group_names(plan: Plan) -> list[str]:
    """Of the groups that fly steps of their own."""
    return list(dict.fromkeys(group.name for group in plan.groups if group.name != EVERYONE))


def first_groups(plan: Plan) -> list[str]:
    """Of each agent, the first group that it flies in beside others; '': none."""
    named = [group for group in plan.groups if group.name != EVERYONE]
    return [next((g.name for g in named if a.id in g.members), "") for a in plan.agents]
