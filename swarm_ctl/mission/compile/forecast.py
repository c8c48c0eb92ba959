"""A mission's forecast: how long each step takes, how close vehicles come, how long links get.

Form steps are flown, from the planned starts, by the law and the safety filter.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final, TypeAlias

import numpy as np
import numpy.typing as npt

from swarm_ctl.core.control.navigation import climb_rate
from swarm_ctl.core.kernel.constraints import Other, constrains, fits, kept, margins_of, tight
from swarm_ctl.core.kernel.decide import Link, Own, decided
from swarm_ctl.core.kernel.heights import apart_by_height, is_ahead, may_pass, needed_m, span
from swarm_ctl.core.kernel.law import Law, Pair
from swarm_ctl.core.kernel.program import Row
from swarm_ctl.core.kernel.receiver import Known, Me, out_of_reach
from swarm_ctl.core.kernel.response import (
    coasted,
    compared,
    model_of,
    response_s,
    steered,
    stop_point,
    unknown,
)
from swarm_ctl.core.kernel.wish import NO_RELEASE, limited, noted, pull, swirled, turned
from swarm_ctl.core.law.formation import apart_in_height, distances, formation_error
from swarm_ctl.core.model.arrays import Bools, Floats, complex_of, plane_of
from swarm_ctl.core.model.autopilots import AUTOPILOT_KINDS
from swarm_ctl.core.model.plan import HEIGHT_DOUBT_M, Compensation, GroupPlan, Plan
from swarm_ctl.core.model.steps.form import FormStep
from swarm_ctl.core.model.text import agents_named
from swarm_ctl.core.safety.own_way import OwnWay, wish_on
from swarm_ctl.core.safety.surroundings import Surroundings
from swarm_ctl.core.safety.ways import WayMap
from swarm_ctl.errors import MissionError
from swarm_ctl.law_loader import law_of
from swarm_ctl.mission.input.units import said
from swarm_ctl.mission.steps.table import kind_of, place_of

if TYPE_CHECKING:
    from swarm_ctl.mission.compile.loader import LoadedMission


Array: TypeAlias = npt.NDArray[np.float64]
Links: TypeAlias = Sequence[tuple[int, ...]]
"""N_i by agent id, in the order of the group's agents."""


@dataclass(frozen=True, slots=True)
class FormForecast:
    """What to expect of one `form` step. Lengths in metres, pairs and links by agent id."""

    shape: str
    formed_s: float | None
    """From the step's start until the shape stands, settling included; None: not before its
    time-out."""
    smallest_m: float
    smallest_pair: tuple[int, int] | None
    longest_link_m: float
    """The longest any neighbour link gets on the way; 0 where there is none."""


@dataclass(frozen=True, slots=True)
class StepForecast:
    """What to expect of a step: from when the first agent begins it until the last one is done."""

    expected_s: float | None
    """None: not before its time-out."""
    form: FormForecast | None = None
    """Of a `form` step."""
    needed_s: float | None = None
    """Of another step, also where that is over its time-out."""


def forecast(plan: Plan, autopilots: Iterable[str] = ("ardupilot",)) -> list[StepForecast]:
    """Of `Plan.all_steps`; take-off and landing as the slowest of the `autopilots` does them."""
    kinds = [AUTOPILOT_KINDS[name].up_and_down for name in sorted(set(autopilots))]
    forms = iter([form for group in plan.groups for form in forecast_forms(plan, group)])
    found: list[StepForecast] = []
    for at in plan.all_steps():
        if at.step.new_shape is not None:
            form = next(forms)
            found.append(StepForecast(form.formed_s, form))
        else:
            seconds = max(kind_of(at.step).expected_s(at.step, at, kind) for kind in kinds)
            in_time = seconds <= at.step.timeout_s
            found.append(StepForecast(seconds if in_time else None, needed_s=seconds))
    return found


def refuse_too_close(loaded: LoadedMission, forecasts: Iterable[StepForecast]) -> None:
    """Raises MissionError, with the form steps in which the forecast has a pair under r_in."""
    plan = loaded.plan
    r_in_m, problems = plan.law.r_in * plan.unit_m, []
    for at, expected in zip(plan.all_steps(), forecasts, strict=True):
        form = expected.form
        if form is None or form.smallest_pair is None or form.smallest_m >= r_in_m:
            continue
        what = f"{agents_named(form.smallest_pair)} are forecast {form.smallest_m:.2f} m apart"
        least = f"at least law.r_in = {said(r_in_m, loaded.file)}"
        allowed = f"{least}, by other starts or slots, or a lower speed"
        problems.append(loaded.document.problem(place_of(at), what, allowed))
    if problems:
        raise MissionError(tuple(problems))


def forecast_forms(plan: Plan, group: GroupPlan) -> list[FormForecast]:
    """Every `form` step of a group in order, each from where the one before ended. The other groups
    are not in its way."""
    formation = group.formations(plan.unit_m)[0]
    points, forecasts = np.array(formation.places), list[FormForecast]()
    links: Links = [agent.neighbours for agent in group.agents]
    for step in group.steps:
        before, formation = formation, step.after(formation)
        if (form := step.new_shape) is not None:
            links = form.neighbours or links
            rest = formation.height_m, before.heights_m
            points, found = _form(plan, group.ids, form, points, links, *rest)
            forecasts.append(found)
            # The law lets the centre drift; the next steps go on from there.
            north, east = (points.mean(axis=0) * plan.unit_m).tolist()
            formation = replace(formation, centre_m=(north, east))
        elif step.path is not None:
            points = np.array(formation.places)
    return forecasts


def _form(
    plan: Plan,
    ids: Sequence[int],
    step: FormStep,
    points: Array,
    links: Links,
    height_m: float,
    begin_m: Sequence[float],
) -> tuple[Array, FormForecast]:
    """The points [units] at the end of a form step that begins at `points`, and its forecast."""
    end_m = [height_m + up_m for up_m in step.ups_m or (0.0,) * len(ids)]
    climb = list(zip(begin_m, end_m, strict=True)) if plan.wake is not None else ()
    swarm = Rehearsal(plan, ids, step, points, links, height_m, climb=climb)
    slots = np.array(step.slots, dtype=np.float64)
    formed_s, since_s = None, None
    nearest, farthest = np.full(swarm.linked.shape, np.inf), 0.0
    for tick in range(round(step.timeout_s / plan.tick_s)):
        now_s, points = tick * plan.tick_s, swarm.points
        between = distances(points)
        nearest = np.where(swarm.beside, np.minimum(nearest, between), nearest)
        farthest = max(farthest, float(between[swarm.linked].max(initial=0.0)))
        formed = float(formation_error(points, slots)) * plan.unit_m < step.tolerance_m
        formed = formed and swarm.at_height
        since_s = (now_s if since_s is None else since_s) if formed else None
        if since_s is not None and now_s - since_s >= step.settle_s:
            formed_s = now_s
            break
        swarm.tick()
    np.fill_diagonal(nearest, np.inf)
    i, j = np.unravel_index(int(np.argmin(nearest)), nearest.shape)
    pair = (ids[int(min(i, j))], ids[int(max(i, j))]) if len(ids) > 1 else None
    smallest_m = float(nearest[i, j]) * plan.unit_m
    return points, FormForecast(step.shape, formed_s, smallest_m, pair, farthest * plan.unit_m)


_AT_HEIGHT_M: Final = 0.5
"""As a step counts it as done."""


class Rehearsal:
    """One form step, tick by tick, before the vehicles fly it: law, safety filter and vehicles.

    Each vehicle answers exactly as `plan.response` says, and each agent knows all states at once.
    So wind, late states, slot exchange and errors of the response are left out: flown, a step takes
    about as long (docs/understand/safety-evidence.md#the-envelope).

    Args:
        plan: what is flown.
        ids: by whom (n,).
        step: the form step.
        points: where they stand (n, 2) [units].
        links: N_i of each, by agent id.
        height_m: above the origin.
        climb: of each, the height that it begins at and the one of its slot; (): all are at one.
    """

    def __init__(
        self,
        plan: Plan,
        ids: Sequence[int],
        step: FormStep,
        points: Floats,
        links: Sequence[tuple[int, ...]],
        height_m: float,
        *,
        climb: Sequence[tuple[float, float]] = (),
    ) -> None:
        self._plan, self._unit_m, self._ids = plan, plan.unit_m, ids
        count, of = len(self._ids), plan.law
        self.linked: Bools = np.array([[j in near for j in self._ids] for near in links])
        """j in N_i (n, n)."""
        self._slots = complex_of(np.array(step.slots, dtype=np.float64)).tolist()
        self._law = law_of(of)
        self._numbers = (
            self._law.numbers(*(each.value for each in of.parameters))
            if of.own
            else Law(of.r, of.r_out, of.r_in, of.h, of.delta_l, of.delta_a)
        )
        self._memory = [[0.0] * self._law.memory for _ in self._ids]
        speed_mps, unit_m = plan.limits.speed_mps, plan.unit_m
        self._margins = margins_of(of, plan.response, speed_mps, unit_m, unit_m)
        self._model = model_of(plan.response, plan.tick_s)
        # each vehicle [m, m/s]
        self._place = (complex_of(points) * unit_m).tolist()
        self._velocity = [0j] * count
        self._setpoint = [0j] * count
        self._sent = [[0j] * self._model.remembered for _ in self._ids]
        self._estimate = [unknown(self._model)] * count
        self._release = [NO_RELEASE] * count
        slots = np.array(self._slots)
        gaps = np.abs(slots[:, None] - slots)
        self._guarded = self.linked & fits(gaps, self._margins)
        self._tight: Bools = np.asarray(tight(gaps, self._margins))
        self._pairs: list[Pair] = []
        self._rows: list[Row] = []
        self._surroundings = Surroundings(plan.zones, plan.fence, plan.response, speed_mps, unit_m)
        self._height_m = height_m
        self._heights = [begin_m for begin_m, _ in climb]
        self._goals = [goal_m for _, goal_m in climb]
        self._level = np.ones((count, count), dtype=np.bool_)
        """Two count as in one plane (n, n)."""
        self._waits = [False] * count
        """For one that is in the way of its climb."""
        maps: dict[tuple[int, ...], WayMap] = {}
        self._ways = [OwnWay(plan.zones, plan.fence, plan.tick_s, maps) for _ in self._ids]

    @property
    def points(self) -> Floats:
        """Where the vehicles are (n, 2) [units]."""
        return plane_of(np.array(self._place, dtype=np.complex128) / self._unit_m)

    @property
    def at_height(self) -> bool:
        """All are at the heights of their slots."""
        pairs = zip(self._heights, self._goals, strict=True)
        return all(abs(at_m - goal_m) < _AT_HEIGHT_M for at_m, goal_m in pairs)

    @property
    def beside(self) -> Bools:
        """Two are less than a layer apart in height (n, n)."""
        if not self._heights:
            return self._level
        return ~apart_in_height(self._heights, self._plan.layer_m)

    def tick(self) -> None:
        """Decide and fly one tick; one agent alone is in its shape wherever it is, at its
        height."""
        if len(self._place) == 1:
            if self._heights:
                self._climb(np.full((1, 1), np.inf))
            return
        unit_m, model = self._unit_m, self._model
        stops = []
        for i, (place, velocity) in enumerate(zip(self._place, self._velocity, strict=True)):
            found = compared(self._estimate[i], place, velocity, model)
            self._estimate[i] = found
            stops.append(stop_point(found, place, velocity, self._sent[i], model) / unit_m)
        plain = self._plan.compensation is Compensation.NONE
        points = [place / unit_m for place in self._place] if plain else stops
        apart = np.abs(np.subtract.outer(stops, stops))
        np.fill_diagonal(apart, np.inf)
        if self._heights:
            self._climb(apart)
        wishes = self._round_zones(points, self._terms(points))
        flown = [self._flown(i, stops, apart[i], *wishes[i]) for i in range(len(stops))]
        for i, velocity in enumerate(flown):
            setpoint = self._setpoint[i] = velocity * unit_m
            count = self._estimate[i].sent
            self._estimate[i] = steered(self._estimate[i], setpoint, self._sent[i], model)
            acting = self._sent[i][(count - model.pending) % model.remembered]
            self._place[i], self._velocity[i] = coasted(
                self._place[i], self._velocity[i], acting, 1.0, model.coast
            )

    def _climb(self, apart: Floats) -> None:
        """Which pairs count as in one plane, who waits to pass another, and the others' climb."""
        plan, margins, heights = self._plan, self._margins, self._heights
        spans = [span(*each, HEIGHT_DOUBT_M) for each in zip(heights, self._goals, strict=True)]
        r_in, climbed = plan.law.r_in, list(heights)
        for i, (at_m, goal_m) in enumerate(zip(heights, self._goals, strict=True)):
            self._waits[i] = False
            for j, other in enumerate(spans):
                over = i != j and apart_by_height(spans[i], other, plan.layer_m, 0.0, 0.0)
                self._level[i, j] = not over
                near_m = needed_m(spans[i], other, plan.layer_m, 0.0, 0.0)
                room = float(apart[i, j]) - margins.keep_out
                if not over and is_ahead(at_m, goal_m - at_m, heights[j], near_m):
                    self._waits[i] |= not may_pass(room, margins.keep_out, r_in)
            if not self._waits[i]:
                climbed[i] += climb_rate(goal_m - at_m, plan.limits) * plan.tick_s
        self._heights = climbed

    def _terms(self, points: list[complex]) -> list[tuple[complex, complex]]:
        """The law's consensus, with the mean-error feedback, and its avoidance of each agent
        [units/s]."""
        plan, count = self._plan, len(points)
        errors = [point - slot for point, slot in zip(points, self._slots, strict=True)]
        total, rate = sum(errors), self._law.rate(plan.kappa)
        wishes = []
        for error, (consensus, avoidance) in zip(errors, self._law_terms(points), strict=True):
            wish = consensus * rate
            if plan.safety.align:
                wish += pull(error, total - error, count - 1)
            wishes.append((wish, avoidance * rate))
        return wishes

    def _round_zones(
        self, points: list[complex], wishes: list[tuple[complex, complex]]
    ) -> list[tuple[complex, complex]]:
        """The same, with the consensus of those that go round a zone to their places."""
        if self._ways[0].free:
            return wishes
        errors = [point - slot for point, slot in zip(points, self._slots, strict=True)]
        mean, unit_m, plan = sum(errors) / len(errors), self._unit_m, self._plan
        gain, most = plan.kappa * plan.law.h, plan.limits.speed_mps
        heights, found = (self._height_m, self._height_m), []
        for way, own, slot, wish in zip(self._ways, points, self._slots, wishes, strict=True):
            leg = way.leg(own * unit_m, (slot + mean) * unit_m, *heights)
            bent = wish_on(leg, own * unit_m, gain, most) / unit_m
            found.append((bent, wish[1]) if leg.round else wish)
        return found

    def _law_terms(self, points: list[complex]) -> list[tuple[complex, complex]]:
        """The law's two terms of each agent, as it gives them."""
        at, found = np.array(points), []
        plan, unit_m, ids, slots = self._plan, self._unit_m, self._ids, self._slots
        reach = self._law.reach(self._numbers)
        minded = self.linked | (np.abs(at[:, None] - at) <= reach * (1.0 + 1e-9))
        np.fill_diagonal(minded, val=False)
        flies = [setpoint / unit_m for setpoint in self._setpoint]
        for i, point in enumerate(points):
            linked = self.linked[i]
            level, rows = self._level[i], []
            for j in np.flatnonzero(minded[i] & (linked | level)).tolist():
                off = 0j if level[j] else out_of_reach(points[j] - point, reach)
                rows.append(
                    Known(
                        id=ids[j],
                        at=points[j] + off,
                        slot=slots[j] + off,
                        flies=flies[j],
                        age_s=0.0,
                        neighbour=bool(linked[j]),
                        lower=i < j,
                    )
                )
            me = Me(
                id=ids[i],
                at=point,
                slot=slots[i],
                flies=flies[i],
                speed=self._margins.speed,
                tick_s=plan.tick_s,
                gain=plan.kappa * plan.law.h,
                r=plan.law.r,
                r_out=plan.law.r_out,
                r_in=plan.law.r_in,
            )
            memory = self._memory[i]
            consensus, avoidance, _ = self._law.form(me, rows, self._numbers, memory, self._pairs)
            found.append((consensus, avoidance))
        return found

    def _flown(
        self, i: int, stops: list[complex], apart: Floats, consensus: complex, avoidance: complex
    ) -> complex:
        """What one agent flies [units/s], for the law's terms."""
        safety, margins, tick_s = self._plan.safety, self._margins, self._plan.tick_s
        wish, agent = consensus + avoidance, self._ids[i]
        if self._waits[i]:  # it makes room for the one that is in the way, and does not form
            consensus = wish = avoidance + self._room_made(i, stops)
        if safety.release:
            if consensus and avoidance:
                wish = consensus + swirled(consensus, avoidance)
            wish, self._release[i] = turned(
                self._release[i], wish, consensus, agent, margins.speed, tick_s
            )
        wish = limited(wish, margins.speed)
        if safety.filter:
            others, links = self._others(i, stops, apart), self._links(i, stops, apart)
            estimate = self._estimate[i]
            own = Own(estimate.doubt_s, response_s(estimate, self._model), 0j)
            walls = self._surroundings.near(stops[i], self._height_m, self._height_m)
            near = (others, len(others), links, len(links), walls, len(walls))
            wish = decided(wish, *near, own, margins, self._rows).velocity
        if safety.release:
            self._release[i] = noted(self._release[i], consensus, wish, margins.speed, tick_s)
        return wish

    def _room_made(self, i: int, stops: list[complex]) -> complex:
        """Away from all that count as in one plane and are nearer than keep-out."""
        found, room = 0j, self._margins.keep_out
        for j in np.flatnonzero(self._level[i]).tolist():
            away = stops[i] - stops[j]
            if j != i and abs(away) < room:
                found += away / max(abs(away), 1e-9) * (room + 0.1 - abs(away))
        return found

    def _others(self, i: int, stops: list[complex], apart: Floats) -> list[Other]:
        """The aircraft that may constrain this agent, whose news is of this very tick."""
        margins, unit_m, found = self._margins, self._unit_m, []
        near = (apart < margins.keep_out + margins.reach) & self._level[i]
        for j in np.flatnonzero(near).tolist():
            setpoint, theirs_s = (
                self._setpoint[j] / unit_m,
                response_s(self._estimate[j], self._model),
            )
            known = (setpoint, 0.0, 0.0, True)
            if constrains(float(apart[j]), *known, margins.reach, margins):
                lower = self._ids[i] < self._ids[j]
                found.append(
                    Other(self._ids[j], lower, stops[i] - stops[j], *known, theirs_s, True)
                )
        return found

    def _links(self, i: int, stops: list[complex], apart: Floats) -> list[Link]:
        """The links that the shape keeps and that are long."""
        if not self._plan.safety.guard:
            return []
        margins, unit_m = self._margins, self._unit_m
        guarded = self._guarded[i] & (apart > margins.guards_from)
        if self._release[i].left_s > 0.0:
            guarded &= ~self._tight[i]
        return [
            Link(self._ids[j], stops[i] - stops[j], self._setpoint[j] / unit_m, 0j, True)
            for j in np.flatnonzero(guarded).tolist()
            if kept(float(apart[j]), margins)
        ]
