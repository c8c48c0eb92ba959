"""What each kind of step says of itself, so that no other module asks which kind it is."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from typing import TYPE_CHECKING, ClassVar, Final, NamedTuple, Self

from swarm_ctl.core.model.geometry import Point
from swarm_ctl.core.model.planned_formation import STILL, Frame, Motion, PlannedFormation
from swarm_ctl.core.model.policies import Policy

if TYPE_CHECKING:
    from swarm_ctl.core.model.steps.follow import FollowStep
    from swarm_ctl.core.model.steps.form import FormStep
    from swarm_ctl.core.model.steps.goto import GotoStep
    from swarm_ctl.core.model.steps.move import MoveStep

_ARRIVED_M: Final = 0.02


class Settling(NamedTuple):
    """The formation stands when it is so good, for so long."""

    tolerance_m: float
    settle_s: float


class Step(ABC):
    """One kind of step; the defaults are those of a step that keeps all as it is."""

    __slots__ = ()
    kind: str
    """Its name on screens, in results and in a plan's JSON."""
    timeout_s: float
    on_timeout: Policy
    """What is done when it takes too long; with `continue` all agents go on to the next step, as
    their time is over, too."""

    flies_formation: ClassVar[bool] = True
    """The vehicles fly by the law."""
    lands_in_place: ClassVar[bool] = False
    goes_home: ClassVar[bool] = False
    """Each vehicle flies to its own start, and lands there."""
    spins: ClassVar[bool] = False
    """The formation turns or grows, so that its places move against each other."""

    @property
    def title(self) -> str:
        """In the mission file's own words: `form hexagon`."""
        return self.kind

    @property
    def goes_down(self) -> bool:
        """The mission ends with it, and each vehicle comes down."""
        return self.lands_in_place or self.goes_home

    @property
    def climbs_to_m(self) -> float | None:
        """The height of a take-off; None: it is none."""
        return None

    @property
    def new_shape(self) -> FormStep | None:
        """The step itself, where it forms a shape; None: it keeps the one before."""
        return None

    @property
    def exchanges(self) -> bool:
        """Agents may begin to exchange their slots in it."""
        return False

    @property
    def path(self) -> Path | None:
        """The step itself, where it leads the formation on a way."""
        return None

    @property
    def file(self) -> MoveStep | None:
        """The step itself, where the agents follow each other in file."""
        return None

    @property
    def follows(self) -> FollowStep | None:
        """The step itself, where a target leads the formation."""
        return None

    @property
    def sends(self) -> GotoStep | None:
        """The step itself, where it sends agents away from the others."""
        return None

    @property
    def joins(self) -> bool:
        """It is where groups become one."""
        return False

    @property
    def barrier(self) -> str:
        """Its name, where groups wait for each other in it; '': only its own agents do."""
        return ""

    @property
    def frame_mps(self) -> float:
        """The most that the formation's frame moves in it."""
        return 0.0

    @property
    def way_m(self) -> tuple[Point, ...]:
        """The centre's waypoints; (): the centre stays."""
        return ()

    def on_way(self, way_m: tuple[Point, ...]) -> Self:
        """The same step with other waypoints of the centre, where it has some."""
        return self

    @property
    def lasts_s(self) -> float | None:
        """It is over after so long; None: something else ends it."""
        return None

    @property
    def settling(self) -> Settling | None:
        """How well the formation has to stand for the step to be over."""
        return None

    def after(self, formation: PlannedFormation) -> PlannedFormation:
        """The formation when the step is done."""
        return formation

    def poses(self, before: PlannedFormation) -> list[PlannedFormation]:
        """The formation at the corners of its way; none: it stays."""
        return []

    def ways_m(self, before: PlannedFormation) -> list[tuple[Point, ...]]:
        """The way of each agent, as corners in the common frame; empty: all stay."""
        return list(zip(*(pose.places_m() for pose in self.poses(before)), strict=True))

    def along(self, start: Frame, frame: Frame, radius_m: float) -> tuple[float, float]:
        """How far [m] a frame has come from `start` on the step's way, and how far it is beside it,
        both by its outermost place."""
        apart, turned_m, grown_m = strayed(start, frame, radius_m)
        return 0.0, apart + turned_m + grown_m


class Path(Step):
    """A step that leads the formation's frame on a way.

    `radius_m` is the outermost slot's distance from the centre at scale 1.
    """

    __slots__ = ()
    speed_mps: float
    """Of the outermost slot."""
    tolerance_m: float
    settle_s: float

    @property
    def path(self) -> Path | None:
        return self

    @property
    def frame_mps(self) -> float:
        return self.speed_mps

    @property
    def settling(self) -> Settling | None:
        return Settling(self.tolerance_m, self.settle_s)

    @abstractmethod
    def legs_m(self, before: PlannedFormation) -> list[float]:
        """How far the outermost agent goes, leg by leg."""

    @abstractmethod
    def left_m(self, frame: Frame, radius_m: float) -> float:
        """How far the outermost agent still has to go on this leg [m]; 0 after the last leg."""

    @abstractmethod
    def _moved(self, frame: Frame, share: float) -> Frame:
        """The frame after this share of what is left of its leg."""

    @abstractmethod
    def _motion(self, frame: Frame, speed_mps: float, radius_m: float) -> Motion:
        """Where the frame goes on, its outermost slot at this speed."""

    def goes_on(self, frame: Frame, radius_m: float) -> bool:
        """Whether something is left of the frame's leg."""
        return self.left_m(frame, radius_m) >= _ARRIVED_M

    def arrived(self, frame: Frame, radius_m: float) -> bool:
        """Whether the frame is at the end of the step."""
        return self.left_m(frame, radius_m) < _ARRIVED_M

    def advanced(self, frame: Frame, dt_s: float, radius_m: float) -> Frame:
        """The frame `dt_s` later at its own rate; it never passes the end of its leg."""
        left = self.left_m(frame, radius_m)
        go = frame.rate * self.speed_mps * dt_s
        return self._moved(frame, 1.0 if left <= max(go, _ARRIVED_M) else go / left)

    def motion(self, frame: Frame, radius_m: float) -> Motion:
        """How the frame moves at its own rate."""
        if frame.rate == 0.0 or not self.goes_on(frame, radius_m):
            return STILL
        return self._motion(frame, frame.rate * self.speed_mps, radius_m)


def strayed(start: Frame, frame: Frame, radius_m: float) -> tuple[float, float, float]:
    """How far a frame is from another [m]: its centre, and the outermost place by its turn and by
    its growth."""
    return (
        math.dist(start.point_m, frame.point_m),
        abs(frame.angle_rad - start.angle_rad) * radius_m * max(frame.scale, start.scale),
        abs(frame.scale - start.scale) * radius_m,
    )


def between(a: float, value: float, b: float) -> float:
    """The value, or the end that it is beyond."""
    return max(min(a, b), min(max(a, b), value))
