"""An operator's order as the mesh's command: what `form` and `move` want is decided here, once for all agents."""

from __future__ import annotations

import uuid
from pathlib import Path

from swarm_ctl.core.plan import FormStep, MoveStep, Point
from swarm_ctl.core.state import Command
from swarm_ctl.errors import InputError
from swarm_ctl.mission import commands
from swarm_ctl.station.orders import Order
from swarm_ctl.station.view import SwarmView


def compose(order: Order, view: SwarmView, mission: Path) -> Command:
    """The command for `order`, the swarm being as it is; InputError says what is missing. `mission`: of the shapes."""
    step = _step(order, view, mission)
    made_for = view.plan_hash if step is not None else 0
    at_step = view.step if order.kind == "next" else 0
    return Command(uuid.uuid4().hex, order.kind, order.agents, view.time_s, step, made_for, at_step)


def _step(order: Order, view: SwarmView, mission: Path) -> FormStep | MoveStep | None:
    if order.kind == "form":
        return commands.form(mission, view.plan, order.arguments[0], _stop_points(view))
    if order.kind == "move":
        north, east, *speed = map(float, order.arguments)
        return commands.move(view.plan, (north, east), speed[0] if speed else None)
    return None


def _stop_points(view: SwarmView) -> dict[int, Point]:
    """Where everybody would come to rest: who is nearest to which slot is told by that."""
    silent = [str(agent.id) for agent in view.agents if agent.in_plan and (agent.state is None or agent.lost)]
    if silent:
        raise InputError(f"form: agent {', '.join(silent)} is not heard; nothing was sent")
    return {agent.id: agent.state.stop_point_m for agent in view.agents if agent.state is not None}
