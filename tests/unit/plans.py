"""Plans of one group, as most missions make them, and of several."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any, Final

from swarm_ctl.core.model.plan import Plan
from swarm_ctl.core.model.steps.table import AnyStep
from swarm_ctl.mission.compile.loader import LoadedMission, load

SCOUTS: Final = (1, 2, 3, 4)
SWEEPERS: Final = (5, 6, 7, 8, 9, 10)
REST: Final = (11, 12)


@cache
def groups_mission() -> LoadedMission:
    """The ready mission `groups`: steps 1-2 of all, 3-8 of scouts, sweepers and the rest side by
    side, then those of all again."""
    return load(Path(__file__).parents[2] / "missions" / "groups.yaml")


def steps_of(plan: Plan) -> tuple[AnyStep, ...]:
    """Of its only group."""
    (group,) = plan.groups
    return group.steps


def with_group(plan: Plan, **changes: Any) -> Plan:
    """The plan, its only group with other `steps` or `agents`."""
    (group,) = plan.groups
    return replace(plan, groups=(replace(group, **changes),))
