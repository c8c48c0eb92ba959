"""An operator's order as the mesh's command: what `form` and `move` want is decided here, once for
all agents."""

from __future__ import annotations

import uuid
from pathlib import Path

from swarm_ctl.commands import build
from swarm_ctl.commands.parse import Order, tuned
from swarm_ctl.core.model.messages import Command, Tuning
from swarm_ctl.core.model.plan import FormStep, MoveStep, Point
from swarm_ctl.core.model.text import agents_named
from swarm_ctl.core.swarm.gain_update import LEAD_S, limits, planned
from swarm_ctl.errors import InputError
from swarm_ctl.station.picture.view import SwarmView


def compose(order: Order, view: SwarmView, mission: Path) -> Command:
    """The command for `order`, the swarm being as it is; InputError says what is missing. Shapes
    are in `mission`."""
    if order.kind == "tune":
        return _tune(order, view)
    step = _step(order, view, mission)
    made_for = view.plan_hash if step is not None else 0
    at_step = view.step if order.kind == "next" else 0
    return Command(uuid.uuid4().hex, order.kind, order.agents, view.time_s, step, made_for, at_step)


def _tune(order: Order, view: SwarmView) -> Command:
    """For everybody who flies a vehicle: whoever of them can't, or is not heard, prevents it."""
    unheard = [agent.id for agent in view.agents if agent.in_plan and agent.state is None]
    if unheard:
        raise InputError(f"tune: {agents_named(unheard)} is not heard; nothing was sent")
    asked = sorted(agent.id for agents in view.laws.values() for agent in agents if agent.in_plan)
    if not asked:
        raise InputError("tune: no agent flies any more; nothing was sent")
    statuses = [
        status
        for i in asked
        if (status := view.agent(i).status) is not None and status.gains is not None
    ]
    laws = {status.gains for status in statuses}
    names = set(limits(view.plan))
    whole = "plan" in order.arguments or names <= {
        word.partition("=")[0] for word in order.arguments
    }
    if len(laws) != 1 and not whole:
        what = "agents fly different laws" if laws else "no agent has told its law yet"
        raise InputError(
            f"tune: {what}; name all of {', '.join(sorted(names))}, or say `tune plan`"
        )
    gains = tuned(order.arguments, next(iter(laws), None) or planned(view.plan), view.plan)
    at_s = view.time_s + LEAD_S * max(1.0, view.speedup)
    ahead_s = tuple((i, ahead) for i in asked if (ahead := view.agent(i).link.clock_ahead_s))
    tuning = Tuning(gains, at_s, ahead_s)
    return Command(
        uuid.uuid4().hex, "tune", tuple(asked), view.time_s, plan_hash=view.plan_hash, tuning=tuning
    )


def _step(order: Order, view: SwarmView, mission: Path) -> FormStep | MoveStep | None:
    if order.kind == "form":
        return build.form(mission, view.plan, order.arguments[0], _stop_points(view))
    if order.kind == "move":
        north, east, *speed = map(float, order.arguments)
        return build.move(view.plan, (north, east), speed[0] if speed else None)
    return None


def _stop_points(view: SwarmView) -> dict[int, Point]:
    """Where everybody would come to rest: who is nearest to which slot is told by that."""
    silent = [
        str(agent.id)
        for agent in view.agents
        if agent.in_plan and (agent.state is None or agent.lost)
    ]
    if silent:
        raise InputError(f"form: agent {', '.join(silent)} is not heard; nothing was sent")
    return {agent.id: agent.state.stop_point_m for agent in view.agents if agent.state is not None}
