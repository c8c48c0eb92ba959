"""`form`."""

from __future__ import annotations

import math
from typing import ClassVar, Final, Literal

import numpy as np
from pydantic import Field

from swarm_ctl import slot_assignment
from swarm_ctl.core.law import graph
from swarm_ctl.core.law.formation import smallest_distance
from swarm_ctl.core.model.plan import Compensation, Plan, PlannedStep, Point
from swarm_ctl.core.model.planned_formation import PlannedFormation
from swarm_ctl.core.model.steps.form import FormStep
from swarm_ctl.mission.geometry.shapes import slots_of, ups_of
from swarm_ctl.mission.input.document import Findings, Mistake, Place, bad_links, named_parts
from swarm_ctl.mission.input.near_matches import did_you_mean
from swarm_ctl.mission.input.units import said
from swarm_ctl.mission.sections.section import Links, Name, Timeout
from swarm_ctl.mission.steps.step_kind import Checks, Mission, StepKind, TimedSection

_GAPS: Final = 0.25
"""So many of the agents may leave a shape that closes."""
LEAST_HEIGHT_M: Final = 1.0
"""Of a slot: as of a take-off."""


class FormSection(TimedSection):
    """Fly into a shape and wait until it stands."""

    shape: Name
    """A name from `shapes`."""
    slots: Literal["nearest", "fixed"] = "nearest"
    """nearest: slots are assigned with the least total squared distance; fixed: the agent with the
    k-th lowest id takes the k-th slot."""
    exchange: bool | None = None
    """Two agents that block each other may exchange their slots. Default: true with nearest slots
    and stop points, else false."""
    on_gap: Literal["hole", "close"] = "hole"
    """Where agents leave or are lost. hole: their slots stay free; close: the others form the shape
    of so many fewer, up to a quarter of them. Who comes back opens it again."""
    layers: int | None = Field(default=None, ge=2, le=20)
    """Deals the slots to so many heights: the k-th slot to the layer `k modulo layers`. The lowest
    layer is at the flight height, or the shape's own `up_m` above it."""
    layer_spacing_m: float | None = Field(default=None, ge=0.5, le=60)
    """From each of these layers to the next. Default: the least at which vehicles in different
    layers count as apart by height, `wake.layer_m` and what two vehicles may err and climb."""
    tolerance_m: float = Field(default=0.5, ge=0.05, le=50)
    """The largest deviation from the shape at which it counts as formed."""
    settle_s: float = Field(default=5.0, ge=0, le=600)
    """How long the deviation must stay below `tolerance_m`."""
    timeout_s: Timeout = 120.0
    neighbours: Literal["keep", "rechoose"] | Links = "keep"
    """The neighbours of each agent from this step on. keep: as before; rechoose: the agents within
    `r` in the shape before this step; or a list of links, [id, id]."""

    def in_layers(self, ups_m: list[float], least_m: float) -> list[float]:
        """The heights of the shape's slots, dealt to the step's layers, `least_m` from each to the
        next where the step does not say."""
        layers, spacing_m = self.layers or 1, self.layer_spacing_m or least_m
        return [up_m + k % layers * spacing_m for k, up_m in enumerate(ups_m)]

    @property
    def shape_formed(self) -> str | None:
        return self.shape


def _known_shape(written: FormSection, place: Place, mission: Mission) -> Findings:
    known = sorted(mission.shapes)
    if written.shape not in mission.shapes:
        hint = did_you_mean(written.shape, known)
        allowed = f"one of {', '.join(known)}" if known else "a shape from the section shapes"
        yield Mistake((*place, "shape"), f"there is no shape {written.shape!r}{hint}", allowed)


def _layers(written: FormSection, place: Place, _mission: Mission) -> Findings:
    if written.layers is None and written.layer_spacing_m is not None:
        what, allowed = "there is one layer", "layers: 2 or more, or no layer_spacing_m"
        yield Mistake((*place, "layer_spacing_m"), what, allowed)


def _gaps(written: FormSection, place: Place, mission: Mission) -> Findings:
    shape = mission.shapes.get(written.shape)
    if written.on_gap == "hole" or shape is None:
        return
    where = (*place, "on_gap")
    if getattr(shape, "count", 0) is not None:
        what = f"{written.shape} has slots for one number of agents alone"
        yield Mistake(where, what, "hole, or a shape by a rule and without a count, e.g. a ring")
    if written.layers or any(ups_of(shape, len(mission.agents))):
        yield Mistake(where, "a shape with heights keeps its slots", "hole")


def _heights(at: PlannedStep, place: Place) -> Findings:
    heights, fence = at.after.heights_m, at.plan.fence
    if not at.after.ups_m:
        return
    if min(heights) < LEAST_HEIGHT_M:
        what = f"a slot is {min(heights):g} m above the ground"
        yield Mistake((*place, "shape"), what, f"{LEAST_HEIGHT_M:g} m or more, by up_m or takeoff")
    if fence is not None and max(heights) > fence.height_m:
        what = f"a slot is {max(heights):g} m high, above the geofence"
        yield Mistake((*place, "shape"), what, f"at most fence.height_m = {fence.height_m:g}")


def _links(written: FormSection, place: Place, mission: Mission) -> Findings:
    ids = sorted(agent.id for agent in mission.agents)
    yield from bad_links((*place, "neighbours"), written.neighbours, ids)


class Form(StepKind[FormSection, FormStep]):
    """Into a shape, by the law alone."""

    section = FormSection
    checks: ClassVar[Checks] = (
        ("shapes", _known_shape),
        ("agents", _links),
        ("", _layers),
        ("shapes agents", _gaps),
    )

    def planned(self, written: FormSection, mission: Mission, before: PlannedFormation) -> FormStep:
        ids = sorted(agent.id for agent in mission.agents)
        shape = mission.shapes[written.shape]
        slots, ups_m = slots_of(shape, len(ids)), self._ups_m(written, mission, len(ids))
        if written.slots == "nearest" and ups_m:
            now, heights = (np.array(m) / mission.unit_m for m in (before.heights_m, ups_m))
            slots, ups = slot_assignment.nearest_with_heights(before.offsets, slots, now, heights)
            ups_m = tuple(round(up * mission.unit_m, 6) for up in ups)
        elif written.slots == "nearest":
            slots = slot_assignment.nearest(before.offsets, slots)
        links: dict[int, tuple[int, ...]] | None = None
        if written.neighbours == "rechoose":
            places = dict(zip(ids, before.offsets, strict=True))
            links = graph.neighbours(places, mission.law.r)
        elif written.neighbours != "keep":
            links = graph.of_links(ids, written.neighbours)
        exchange = written.exchange
        if exchange is None:
            flies_stop_points = mission.law.compensation is Compensation.STOP_POINT
            exchange = written.slots == "nearest" and flies_stop_points
        return FormStep(
            shape=written.shape,
            slots=slot_assignment.rounded(slots),
            tolerance_m=written.tolerance_m,
            settle_s=written.settle_s,
            timeout_s=written.timeout_s,
            neighbours=None if links is None else tuple(links[i] for i in ids),
            on_timeout=written.on_timeout,
            exchange=exchange,
            ups_m=ups_m,
            closed=self._closed(written, mission, len(ids)),
        )

    @staticmethod
    def _closed(
        written: FormSection, mission: Mission, agents: int
    ) -> tuple[tuple[Point, ...], ...]:
        """The shape of one agent less, of two less, up to a quarter of them."""
        if written.on_gap == "hole":
            return ()
        shape, least = mission.shapes[written.shape], max(1, agents - math.ceil(_GAPS * agents))
        return tuple(
            slot_assignment.rounded(slots_of(shape, count))
            for count in range(agents - 1, least - 1, -1)
        )

    @staticmethod
    def _ups_m(written: FormSection, mission: Mission, agents: int) -> tuple[float, ...]:
        """Of each slot, above the flight height; (): all are at it."""
        ups_m = ups_of(mission.shapes[written.shape], agents)
        ups_m = written.in_layers(ups_m, mission.wake.spacing_m(mission.vehicle.limits))
        return tuple(ups_m) if any(ups_m) else ()

    def words(self, step: FormStep, plan: Plan) -> str:
        return f"{step.title}, {step.tolerance_m:g} m"

    def needed_s(self, written: FormSection, mission: Mission) -> float:
        return written.settle_s

    def wrong(self, step: FormStep, at: PlannedStep, place: Place, mission: Mission) -> Findings:
        """Neighbours that are chosen anew are connected, all heights lie in the air, and a shape
        that closes keeps its agents apart."""
        yield from _heights(at, place)
        for slots in step.closed:
            apart = smallest_distance(slots, (), math.inf)
            if apart <= at.plan.law.r_out:
                far = f"{said(apart * at.plan.unit_m, mission)} apart"
                what = f"{step.shape} of {len(slots)} agents has slots {far}"
                yield Mistake((*place, "on_gap"), what, "hole, or a wider shape")
                return
        plan, ids = at.plan, [agent.id for agent in at.group.agents]
        chosen = dict(zip(ids, step.neighbours, strict=True)) if step.neighbours else {}
        parts = graph.components(chosen)
        if len(parts) > 1:
            needed, i, j = graph.connecting_range(dict(zip(ids, at.before.offsets, strict=True)))
            r = said(plan.law.r * plan.unit_m, mission)
            falls = f"with law.r = {r} it falls into {named_parts(parts)}"
            wide = said(needed * plan.unit_m, mission, least=True)
            allowed = f"law.r of {wide} or more (agents {i} and {j}), or neighbours: keep"
            what = f"the shape before is not connected: {falls}"
            yield Mistake((*place, "neighbours"), what, allowed)
