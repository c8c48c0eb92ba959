"""All kinds of step."""

from __future__ import annotations

from typing import TypeAlias

from swarm_ctl.core.model.steps.barrier import BarrierStep
from swarm_ctl.core.model.steps.follow import FollowStep
from swarm_ctl.core.model.steps.form import FormStep
from swarm_ctl.core.model.steps.hold import HoldStep
from swarm_ctl.core.model.steps.land import LandStep
from swarm_ctl.core.model.steps.move import MoveStep
from swarm_ctl.core.model.steps.return_ import ReturnStep
from swarm_ctl.core.model.steps.rotate import RotateStep
from swarm_ctl.core.model.steps.scale import ScaleStep
from swarm_ctl.core.model.steps.takeoff import TakeoffStep

AnyStep: TypeAlias = (
    TakeoffStep
    | FormStep
    | HoldStep
    | MoveStep
    | FollowStep
    | RotateStep
    | ScaleStep
    | BarrierStep
    | ReturnStep
    | LandStep
)
"""What a plan's JSON may have."""
