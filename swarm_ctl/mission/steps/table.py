"""All kinds of step, and the entry of a mission file that holds one of them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

from pydantic import ConfigDict, Field, create_model, model_validator

from swarm_ctl.core.model.plan import PlannedStep
from swarm_ctl.core.model.steps.step import Step
from swarm_ctl.mission.input.document import Place
from swarm_ctl.mission.sections.section import Section
from swarm_ctl.mission.steps.follow import Follow
from swarm_ctl.mission.steps.form import Form
from swarm_ctl.mission.steps.hold import Hold
from swarm_ctl.mission.steps.land import Land
from swarm_ctl.mission.steps.move import Move
from swarm_ctl.mission.steps.return_ import Return
from swarm_ctl.mission.steps.rotate import Rotate
from swarm_ctl.mission.steps.scale import Scale
from swarm_ctl.mission.steps.step_kind import AnyKind, StepSection
from swarm_ctl.mission.steps.takeoff import Takeoff

KINDS: Final[dict[str, AnyKind]] = {
    "takeoff": Takeoff(),
    "form": Form(),
    "hold": Hold(),
    "move": Move(),
    "follow": Follow(),
    "rotate": Rotate(),
    "scale": Scale(),
    "return": Return(),
    "land": Land(),
}
"""By the name of the step in mission files and plans."""
LAST: Final = tuple(sorted(name for name, kind in KINDS.items() if kind.ends))
"""The steps that end a mission."""


def kind_of(step: Step) -> AnyKind:
    """What is known of this step's kind."""
    return KINDS[step.kind]


def place_of(at: PlannedStep) -> Place:
    """Where the mission file has this step."""
    return ("steps", at.number - 1, at.step.kind)


class _Entry(Section):
    """One step of the mission: exactly one of these fields."""

    model_config = ConfigDict(json_schema_extra={"minProperties": 1, "maxProperties": 1})

    @property
    def kind(self) -> str:
        """The name of its only field; '' where it has none or several."""
        given = list(self.model_fields_set)
        return given[0] if len(given) == 1 else ""

    @property
    def body(self) -> StepSection | None:
        """The value of its only field."""
        return next((value for _, value in self if value is not None), None)

    @model_validator(mode="before")
    @classmethod
    def _bare(cls, value: Any) -> Any:
        """`- land` and `- land:` mean `- land: {}`, and likewise for `return`."""
        if value in LAST:
            return {value: {}}
        if isinstance(value, dict):
            return {kind: {} if body is None else body for kind, body in value.items()}
        return value


if TYPE_CHECKING:
    StepEntry = _Entry
else:
    StepEntry = create_model(
        "StepEntry",
        __base__=_Entry,
        __doc__=_Entry.__doc__,
        **{name: (kind.section | None, Field(default=None)) for name, kind in KINDS.items()},
    )
