"""Which agents are neighbours now, as a station can tell. Pure."""

from __future__ import annotations

from collections.abc import Mapping

from swarm_ctl.core.law.graph import edges
from swarm_ctl.core.model.messages import AgentState
from swarm_ctl.core.model.plan import GroupPlan


def edges_in_force(
    group: GroupPlan, step: int, states: Mapping[int, AgentState]
) -> tuple[tuple[int, int], ...]:
    """The pairs of neighbours in this step of a group, lower id first: the starts' graph, or the
    newest that a form step chose. That one is by slot, so it follows exchanged slots."""
    ids = group.ids
    forms = [
        form
        for s in group.steps[: max(0, step - group.before)]
        if (form := s.new_shape) is not None
    ]
    chosen = [form.neighbours for form in forms if form.neighbours is not None]
    if not chosen:
        return edges({agent.id: agent.neighbours for agent in group.agents})
    holders = {}
    for index, agent in enumerate(ids):
        role = states[agent].exchange.role if agent in states else index
        holders[ids[role if 0 <= role < len(ids) else index]] = agent
    by_slot = edges(dict(zip(ids, chosen[-1], strict=True)))
    pairs = ((holders.get(a, a), holders.get(b, b)) for a, b in by_slot)
    return tuple(sorted({(min(p), max(p)) for p in pairs if p[0] != p[1]}))
