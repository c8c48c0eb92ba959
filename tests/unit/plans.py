"""Plans of one group, as all missions make them."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from swarm_ctl.core.model.plan import Plan
from swarm_ctl.core.model.steps.table import AnyStep


def steps_of(plan: Plan) -> tuple[AnyStep, ...]:
    """Of its only group."""
    (group,) = plan.groups
    return group.steps


def with_group(plan: Plan, **changes: Any) -> Plan:
    """The plan, its only group with other `steps` or `agents`."""
    (group,) = plan.groups
    return replace(plan, groups=(replace(group, **changes),))
