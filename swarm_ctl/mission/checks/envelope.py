"""The envelope: the missions in which the safety filter was studied, as a table.

Outside of it a mission flies with a warning; far outside it is refused.
docs/understand/safety-evidence.md#the-envelope quotes the table, and a test holds the two together.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Final

from swarm_ctl.core.kernel.constraints import margins_of
from swarm_ctl.core.law.formation import smallest_distance
from swarm_ctl.core.model.plan import Plan
from swarm_ctl.mission.input.document import ROUNDING, Findings, Mistake, Place
from swarm_ctl.mission.mission_file import MissionFile


@dataclass(frozen=True, slots=True)
class StudiedRange:
    """One quantity of a plan, and the values that were studied."""

    place: Place
    """The field of the mission file that decides it."""
    name: str
    of: Callable[[Plan], float]
    low: float
    high: float
    refused: tuple[float, float] = (-math.inf, math.inf)
    """A plan below the first or above the second is refused."""
    enough: Callable[[Plan, float], str] = lambda _plan, _most: ""
    """In the field's own words, what keeps the quantity at this most."""

    @property
    def studied(self) -> str:
        """In words."""
        if math.isinf(self.high):
            return f"{self.low:g} and more"
        return f"{self.low:g} to {self.high:g}"

    @property
    def accepted(self) -> str:
        """In words; '' where none is refused."""
        least, most = self.refused
        parts = [f"at least {least:g}"] if math.isfinite(least) else []
        parts += [f"at most {most:g}"] if math.isfinite(most) else []
        return " and ".join(parts)


def room_m(plan: Plan) -> float:
    """From r_out to r_in [m]."""
    return (plan.law.r_out - plan.law.r_in) * plan.unit_m


def most_gusts_mps(plan: Plan) -> float:
    """The deviation of gusts [m/s] up to which vehicles stay apart. They come nearer to each other
    than D by what a gust moves them before they answer."""
    law, unit_m = plan.law, plan.unit_m
    margins = margins_of(law, plan.response, plan.limits.speed_mps, unit_m)
    return _GUSTS * (margins.keep_out - law.r_in * unit_m)


def _closest_slots(plan: Plan) -> float:
    """Of all shapes that are formed; infinite for one agent."""
    shapes = [at.after for at in plan.all_steps() if at.after.formed]
    return min(
        (smallest_distance(each.offsets, each.ups_m, plan.slot_layer_m) for each in shapes),
        default=math.inf,
    )


def _speed_mps(plan: Plan, most: float) -> str:
    """Rounded down: what is said to be enough is."""
    speed_mps = math.sqrt(most * plan.response.acceleration_mps2 * room_m(plan))
    return f"; a speed_mps of {math.floor(speed_mps * 100) / 100:g} is enough"


def with_usual_speed(mission: MissionFile, plan: Plan) -> MissionFile:
    """The mission, its default speed limit lowered to what was studied for the radii of its plan.
    One that the mission sets, or that its steps need, stays, and is warned of."""
    vehicle, chosen = mission.vehicle, mission.vehicle.limits.model_fields_set
    most_mps = math.sqrt(_STUDIED * plan.response.acceleration_mps2 * room_m(plan))
    usual_mps = max(0.1, math.floor(10 * most_mps) / 10)
    paths = [at.step.path for at in plan.all_steps()]
    needed = [path.speed_mps if path else 0.0 for path in paths]
    if "speed_mps" in chosen or not max(needed) <= usual_mps < plan.limits.speed_mps:
        return mission
    limits = vehicle.limits.model_copy(update={"speed_mps": usual_mps})
    return mission.model_copy(update={"vehicle": vehicle.model_copy(update={"limits": limits})})


_STUDIED: Final = 1.8
"""Of the speed's row: speed_mps^2 / (acceleration_mps2 * (r_out - r_in))."""
_GUSTS: Final = 0.75
"""[1/s] Of what the keep-out spares (`tests/scenarios/test_gusts.py`)."""
PX4_ROOM_M: Final = 2.0
"""[m] From r_in to r_out, where a PX4 flies: in up to 1.7 m drawn PX4s that change sides came under
r_in; in 1.2 m so did real ones, in 3 of 6 flights with 2 m/s of wind, put in by hand."""
_RESPONSE: Final = ("vehicle", "response")
ENVELOPE: Final = (
    StudiedRange(("agents",), "number of agents", lambda p: len(p.agents), 1, 100),
    StudiedRange(
        ("vehicle", "limits", "speed_mps"),
        "speed_mps^2 / (acceleration_mps2 * (r_out - r_in))",
        lambda p: p.limits.speed_mps**2 / (p.response.acceleration_mps2 * room_m(p)),
        *(0, _STUDIED, (-math.inf, 12), _speed_mps),
    ),
    StudiedRange(
        (*_RESPONSE, "acceleration_mps2"),
        "acceleration_mps2 [m/s^2]",
        lambda p: p.response.acceleration_mps2,
        *(2, 5, (1, math.inf)),
    ),
    StudiedRange(
        (*_RESPONSE, "dead_time_s"),
        "dead time [s]",
        lambda p: p.response.dead_time_s,
        *(0, 0.6, (-math.inf, 1.2)),
    ),
    StudiedRange(
        (*_RESPONSE, "lag_s"), "lag [s]", lambda p: p.response.lag_s, *(0.15, 0.8, (-math.inf, 1.6))
    ),
    StudiedRange((*_RESPONSE, "doubt_s"), "doubt_s [s]", lambda p: p.response.doubt_s, 0.05, 0.5),
    StudiedRange(
        ("law", "r_in"),
        "r_in / (r_out - r_in)",
        lambda p: p.law.r_in / (p.law.r_out - p.law.r_in),
        *(0, 1, (-math.inf, 2)),
    ),
    StudiedRange(
        ("steps",),
        "smallest distance of slots / r_out",
        lambda p: _closest_slots(p) / p.law.r_out,
        *(1.26, math.inf),
    ),
    StudiedRange(("law", "h"), "kappa * h [1/s]", lambda p: p.kappa * p.law.h, 0, 4),
    StudiedRange(("tick_s",), "tick_s [s]", lambda p: p.tick_s, 0, 0.1, (-math.inf, 0.2)),
)
"""The row of the speed is twice the braking distance in the room from r_out to r_in. To 1.8 no
pair came under r_in; at 2 to 10.3 up to 2 in 100 missions had one; beyond 12 nothing is known
(docs/understand/safety-evidence.md#the-envelope). The others refuse at twice, or half, of what
was studied; the tick, where a vehicle at 5 m/s flies a metre between two."""


def outside(plan: Plan) -> Findings:
    """A warning for each quantity that was not studied; `allowed` is empty."""
    for each in ENVELOPE:
        found = each.of(plan)
        if not each.low - ROUNDING <= found <= each.high + ROUNDING:
            what = f"{each.name} is {found:.3g}, outside the studied {each.studied}"
            unknown = f"{what}: how close vehicles come is not known there"
            yield Mistake(each.place, f"{unknown}{each.enough(plan, each.high)}", "")


def refused(plan: Plan) -> Iterator[Mistake]:
    """What is so far outside that the mission may not fly."""
    for each in ENVELOPE:
        least, most = each.refused
        found = each.of(plan)
        if not least - ROUNDING <= found <= most + ROUNDING:
            what = f"{each.name} is {found:.3g}, far outside the studied {each.studied}"
            yield Mistake(each.place, what, f"{each.accepted}{each.enough(plan, most)}")
