"""`barrier`."""

from __future__ import annotations

from swarm_ctl.core.model.planned_formation import PlannedFormation
from swarm_ctl.core.model.steps.barrier import BarrierStep
from swarm_ctl.mission.sections.section import Name, Timeout
from swarm_ctl.mission.steps.step_kind import Mission, StepKind, TimedSection


class BarrierSection(TimedSection):
    """Wait for the other groups of this split that have a barrier of the same name."""

    name: Name
    timeout_s: Timeout = 300.0


class GroupBarrier(StepKind[BarrierSection, BarrierStep]):
    """Where groups wait for each other, in a split or at its end."""

    section = BarrierSection

    def planned(
        self, written: BarrierSection, mission: Mission, before: PlannedFormation
    ) -> BarrierStep:
        return BarrierStep(written.name, written.timeout_s, written.on_timeout)
