"""The way of a formation, planned again when zones change in flight.

A mission's way is planned before the flight. From when other zones are in force, each agent works
out the same way anew, from the planned start of the step on, so that all count its corners alike;
and the frame goes on from where it is, to the first corner that is still before it. One that flies
together, and for which no way is wide enough, keeps its old one, and each agent goes round by
itself (`own_way.py`). One in file goes on in file.
"""

from __future__ import annotations

import math
from dataclasses import replace

from swarm_ctl.core.model.geometry import Point
from swarm_ctl.core.model.plan import Plan
from swarm_ctl.core.model.planned_formation import Frame, PlannedFormation
from swarm_ctl.core.model.steps.step import Step
from swarm_ctl.core.model.zones import Zone
from swarm_ctl.core.safety.among_zones import AmongZones


class Detour:
    """What one agent knows of the way of the step that it flies."""

    def __init__(self, plan: Plan) -> None:
        self._plan = plan
        self._flown: dict[int, tuple[Step, tuple[Zone, ...], Step]] = {}
        """By the step's identity: the step, the zones, and as it was flown with them last."""
        self._joined: int | None = None
        """The law's tag of the peer whose frame was taken over; None: the frame is the own one."""
        self._hemmed: tuple[Step, int] | None = None
        """The step, and the leg of it on which a zone that came lies on the formation."""

    def hemmed(self, step: Step, frame: Frame | None) -> bool:
        """A zone came over the formation, or beside it: its shape is not flown until the frame is
        out, at the next corner, and each agent goes round by itself."""
        return frame is not None and self._hemmed == (step, frame.leg)

    def join(self, law_tag: int) -> None:
        """The frame that comes next is a peer's: it counts the corners as they are with its law and
        zones, which this agent may have to take up first."""
        self._joined = law_tag

    def flown(
        self,
        step: Step,
        before: PlannedFormation,
        zones: tuple[Zone, ...],
        frame: Frame | None,
        law_tag: int = 0,
    ) -> tuple[Step, Frame | None]:
        """The step as it is flown with these zones in force, and where the frame stands in it.

        Args:
            step: the mission's, or a command's.
            before: where the formation stands when it begins, the same for all agents.
            zones: in force.
            frame: now, in the step as it was flown last.
            law_tag: of the update that the zones came with; 0: they are the plan's.
        """
        counted = self._joined is not None
        if self._joined == law_tag:
            self._joined = None
        known = self._flown.get(id(step))
        if known is not None and known[1] is zones:
            return known[2], frame
        if known is None and (zones is self._plan.zones or not step.way_m):
            return step, frame
        flown, was = self._among(step, before, zones), step if known is None else known[2]
        self._flown[id(step)] = step, zones, flown
        if frame is not None and flown is not was and not counted:
            among = AmongZones.of(replace(self._plan, zones=zones), before.span_m)
            # in file the frame goes ahead by itself
            goes = before if step.file is None else replace(before, slots=((0.0, 0.0),))
            leg, free = _leg(frame, was.way_m, flown.way_m, goes, among)
            frame = replace(frame, leg=leg, rate=0.0)
            self._hemmed = None if free or step.file is not None else (flown, leg)
        return flown, frame

    def _among(self, step: Step, before: PlannedFormation, zones: tuple[Zone, ...]) -> Step:
        if zones == self._plan.zones:
            return step
        among = AmongZones.of(replace(self._plan, zones=zones), before.span_m)
        if step.file is not None:
            single = among.single(before.centre_m, step.way_m)
            return step if single in (None, step.way_m) else step.on_way(single)
        way_m, opens_m = among.round(before, step.way_m)
        return step if opens_m is not None or way_m == step.way_m else step.on_way(way_m)


def _leg(
    frame: Frame,
    old_m: tuple[Point, ...],
    new_m: tuple[Point, ...],
    before: PlannedFormation,
    among: AmongZones,
) -> tuple[int, bool]:
    """On which leg of the new way a frame goes on that is on a leg of the old one, and whether all
    fly straight there: to the farthest corner, up to the next waypoint that both have, to which
    they do; where there is none, to the nearest of those after the last that both have and that is
    passed."""
    passed = [new_m.index(at) for at in old_m[: frame.leg] if at in new_m]
    ahead = [new_m.index(at) for at in old_m[frame.leg :] if at in new_m]
    first, last = max(passed, default=-1) + 1, min(ahead, default=len(new_m))
    now = replace(before, angle_rad=frame.angle_rad, scale=frame.scale)
    for k in range(min(last, len(new_m) - 1), first - 1, -1):
        ways = zip(now.places_m(frame.point_m), now.places_m(new_m[k]), strict=True)
        if not any(among.cut(way) for way in ways):
            return k, True
    ahead_m = {
        k: math.dist(frame.point_m, new_m[k]) for k in range(first, min(last + 1, len(new_m)))
    }
    return (min(ahead_m, key=lambda k: ahead_m[k]), False) if ahead_m else (len(new_m), True)
