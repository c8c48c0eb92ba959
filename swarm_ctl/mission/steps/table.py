"""All kinds of step, and the entry of a mission file that holds one of them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any, Final

from pydantic import ConfigDict, Field, create_model, model_validator

from swarm_ctl.core.model.plan import PlannedStep
from swarm_ctl.core.model.steps.step import Step
from swarm_ctl.mission.input.document import Place
from swarm_ctl.mission.sections.section import Name, Section
from swarm_ctl.mission.steps.barrier import GroupBarrier
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
    "barrier": GroupBarrier(),
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
    """Where the mission file has this step; that it joins the others, where its split begins."""
    groups, entry = at.plan.groups, 0
    apart = {group.before for group in groups if [g.before for g in groups].count(group.before) > 1}
    for before in sorted({group.before for group in groups if group.before < at.group.before}):
        parts = [group for group in groups if group.before == before]
        entry += 1 if before in apart and before else len(parts[0].steps)
    k = at.number - at.group.before - 1
    if at.group.before not in apart or not at.group.before:
        return ("steps", entry + k, at.step.kind)
    if at.step.joins:
        return ("steps", entry, "split", at.group.name)
    return ("steps", entry, "split", at.group.name, k, at.step.kind)


class WrittenStep(Section):
    """One step: exactly one of these fields."""

    model_config = ConfigDict(json_schema_extra={"minProperties": 1, "maxProperties": 1})

    @property
    def kind(self) -> str:
        """The name of its only field; '' where it has none or several."""
        given = list(self.model_fields_set)
        return given[0] if len(given) == 1 else ""

    @property
    def body(self) -> StepSection | None:
        """The value of its only field, where that is a step."""
        return next((value for _, value in self if isinstance(value, StepSection)), None)

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
    GroupStep = WrittenStep

    class StepEntry(WrittenStep):
        split: dict[str, tuple[WrittenStep, ...]] | None = None
else:
    GroupStep = create_model(
        "GroupStep",
        __base__=WrittenStep,
        __doc__=WrittenStep.__doc__,
        **{name: (kind.section | None, Field(default=None)) for name, kind in KINDS.items()},
    )

    _Split = Annotated[
        dict[Name, Annotated[tuple[GroupStep, ...], Field(min_length=1, max_length=1000)]],
        Field(min_length=1, max_length=250),
    ]
    _SPLIT = """The steps of each group, by its name: they fly them side by side. At the end of the
    split all groups wait for each other, and go on as one; the others wait from its beginning. A
    group that returns or lands flies on no more."""
    StepEntry = create_model(
        "StepEntry",
        __base__=GroupStep,
        __doc__="One step of the mission, or a split: exactly one of these fields.",
        split=(_Split | None, Field(default=None, description=" ".join(_SPLIT.split()))),
    )
