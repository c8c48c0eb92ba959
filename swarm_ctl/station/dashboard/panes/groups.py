"""The groups of a mission that splits: a line for each that flies now."""

from __future__ import annotations

from typing import Final

from swarm_ctl.core.model.text import ranges
from swarm_ctl.station.dashboard.drawing.picture import Picture
from swarm_ctl.station.dashboard.drawing.styled_line import WAITING, StyledLine, fit
from swarm_ctl.station.picture.alarms import Level
from swarm_ctl.station.picture.summaries import flown_order
from swarm_ctl.station.picture.view import GroupView, SwarmView

_LONGEST: Final = 8
"""Cells of a group's name."""


def group_lines(picture: Picture, width: int) -> list[StyledLine]:
    """Name, step, members, formation error, and for whom it waits; none in a mission that never
    splits."""
    view = picture.view
    if len(view.plan.groups) < 2:
        return []
    levels, names = picture.levels(), [short(group.name) for group in view.groups]
    steps = [f"{group.step}/{view.plan.last_step} {flown(group, view)}" for group in view.groups]
    ids = [ranges(group.agents).replace(" ", "") or "none" for group in view.groups]
    wide_name, wide_step, wide_ids = (
        max(map(len, words), default=0) for words in (names, steps, ids)
    )
    lines = []
    for group, name, step, members in zip(view.groups, names, steps, ids, strict=True):
        line = StyledLine(f" {name:{wide_name}}", f"bold {picture.group_ink(group.name)}".strip())
        line.add(f"  {step:{wide_step}}", "bold")
        line.add(f"  {members[: max(4, width // 4)]:{min(wide_ids, max(4, width // 4))}}")
        if group.error_m is not None:
            line.add(f"  error {fit(group.error_m, 5, 2)} m")
        if group.silent:
            worst = max(levels.get(agent, Level.WELL) for agent in group.silent)
            style = "bold red" if worst >= Level.ERROR else "yellow"
            line.add(f"  {ranges(group.silent)} silent", style)
        if words := waits(group, view):
            line.add(f"  {words}", "cyan")
        lines.append(line)
    return lines


def waits(group: GroupView, view: SwarmView) -> str:
    """`… 12 s for sweepers`; '' where it waits for none."""
    if not group.waits_for:
        return ""
    since = f" {group.waits_s:.0f} s" if group.waits_s is not None else ""
    return f"{WAITING}{since} for {view.whom(group.waits_for)}"


def short(name: str) -> str:
    """A name that fits into a column."""
    return name if len(name) <= _LONGEST else name[: _LONGEST - 1] + "…"


def flown(group: GroupView, view: SwarmView) -> str:
    """Its step, or, behind a colon, the order that all of it flies instead: `waits: hold`."""
    agents = [view.agent(agent) for agent in group.agents if agent not in group.silent]
    orders = {flown_order(agent, view) for agent in agents}
    order = orders.pop() if len(orders) == 1 else ""
    return f"waits: {order}" if order else group.step_name
