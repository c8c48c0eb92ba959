"""The steps of a mission: a section for each kind, and the entry that holds one of them."""

from __future__ import annotations

from typing import Annotated, Any, Literal, TypeAlias

from pydantic import ConfigDict, Field, model_validator

from swarm_ctl.core.model.plan import Policy
from swarm_ctl.mission.sections.section import Action, Links, Name, NorthEast, Section, Timeout


class _TimedSection(Section):
    on_timeout: Action = Policy.LAND
    """What to do after `timeout_s`: land, return, hold, or continue with the next step."""


class TakeoffSection(_TimedSection):
    """Set the autopilot's mode, arm and climb."""

    height_m: float = Field(ge=1, le=120)
    """Above each vehicle's own take-off point."""
    timeout_s: Timeout | None = None
    """Default: 30 s more than twice the climb at vehicle.limits.climb_mps."""


class FormSection(_TimedSection):
    """Fly into a shape and wait until it stands."""

    shape: Name
    """A name from `shapes`."""
    slots: Literal["nearest", "fixed"] = "nearest"
    """nearest: slots are assigned with the least total squared distance; fixed: the agent with the
    k-th lowest id takes the k-th slot."""
    exchange: bool | None = None
    """Two agents that block each other may exchange their slots. Default: true with nearest slots
    and stop points, else false."""
    tolerance_m: float = Field(default=0.5, ge=0.05, le=50)
    """The largest deviation from the shape at which it counts as formed."""
    settle_s: float = Field(default=5.0, ge=0, le=600)
    """How long the deviation must stay below `tolerance_m`."""
    timeout_s: Timeout = 120.0
    neighbours: Literal["keep", "rechoose"] | Links = "keep"
    """The neighbours of each agent from this step on. keep: as before; rechoose: the agents within
    `r` in the shape before this step; or a list of links, [id, id]."""


class _TravelSection(_TimedSection):
    speed_mps: float | None = Field(default=None, ge=0.1, le=20)
    """Of the fastest agent. Default: half of vehicle.limits.speed_mps."""
    tolerance_m: float = Field(default=0.5, ge=0.05, le=50)
    """The largest deviation from the shape, and of the pinned agent from its place, at which the
    formation counts as arrived."""
    settle_s: float = Field(default=2.0, ge=0, le=600)
    """How long the deviations must stay below `tolerance_m`."""
    timeout_s: Timeout | None = None
    """Default: 30 s and settle_s more than twice the time at speed_mps."""


class MoveSection(_TravelSection):
    """Move the formation's centre along a path and keep the shape. Give `to`, `along` or `by`."""

    to: NorthEast | None = None
    """Where the centre goes: [north, east] of the origin."""
    along: Annotated[tuple[NorthEast, ...], Field(min_length=1, max_length=200)] | None = None
    """Waypoints of the centre, each as `to`."""
    by: NorthEast | None = None
    """How far the centre goes: [north, east] of where it is planned to be."""


class RotateSection(_TravelSection):
    """Turn the formation about its centre and keep the shape."""

    angle_deg: float = Field(ge=-3600, le=3600)
    """Clockwise as seen from above."""


class ScaleSection(_TravelSection):
    """Widen or narrow the formation about its centre."""

    factor: float = Field(ge=0.05, le=20)
    """Relative to the shape's present size."""


class ReturnSection(_TimedSection):
    """Return to the starts, all at once, in three layers of height; land there and disarm."""

    timeout_s: Timeout | None = None
    """Default: long enough for the number of agents, the height and the ways to the starts."""


class HoldSection(_TimedSection):
    """Keep the formation for a while."""

    duration_s: float = Field(gt=0, le=3600)
    timeout_s: Annotated[float, Field(gt=0, le=7200)] | None = None
    """Default: 30 s more than the duration."""


class LandSection(Section):
    """Stop, land in place and disarm."""

    timeout_s: Timeout | None = None
    """Default: long enough for the height."""


StepBody: TypeAlias = (
    TakeoffSection
    | FormSection
    | HoldSection
    | MoveSection
    | RotateSection
    | ScaleSection
    | ReturnSection
    | LandSection
)


class StepEntry(Section):
    """One step of the mission: exactly one of these fields."""

    model_config = ConfigDict(json_schema_extra={"minProperties": 1, "maxProperties": 1})

    takeoff: TakeoffSection | None = None
    form: FormSection | None = None
    hold: HoldSection | None = None
    move: MoveSection | None = None
    rotate: RotateSection | None = None
    scale: ScaleSection | None = None
    return_: ReturnSection | None = Field(default=None, alias="return")
    land: LandSection | None = None

    @property
    def kind(self) -> str:
        """The name of its only field, as in the file; '' where it has none or several."""
        given = [name.rstrip("_") for name in self.model_fields_set]
        return given[0] if len(given) == 1 else ""

    @property
    def body(self) -> StepBody | None:
        """The value of its only field."""
        return next((value for _, value in self if value is not None), None)

    @classmethod
    def kinds(cls) -> list[str]:
        """The names of all fields, as in the file."""
        return [name.rstrip("_") for name in cls.model_fields]

    @model_validator(mode="before")
    @classmethod
    def _bare(cls, value: Any) -> Any:
        """`- land` and `- land:` mean `- land: {}`, and likewise for `return`."""
        if value in ("land", "return"):
            return {value: {}}
        if isinstance(value, dict):
            return {kind: {} if body is None else body for kind, body in value.items()}
        return value
