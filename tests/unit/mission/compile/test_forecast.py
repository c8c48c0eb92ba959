"""The forecast of form steps agrees with closed forms and with flights; each begins where the one
before ended."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path

import pytest

from swarm_ctl.core.model.plan import Compensation, Limits, Plan, Response, Safety
from swarm_ctl.core.model.steps.form import FormStep
from swarm_ctl.mission.compile.forecast import FormForecast, forecast, forecast_forms
from swarm_ctl.mission.compile.loader import load, loads
from tests.unit.mission.example import without_section
from tests.unit.plans import steps_of

HEXAGON = Path(__file__).parents[4] / "missions" / "hexagon.yaml"

PAIR = """\
version: 1
name: pair
origin: {lat_deg: 47.4, lon_deg: 8.5, alt_m: 0}
unit_m: 5
law: {r: 10, r_out: 1, r_in: 0.5}
agents:
  - {id: 1, start: [0, 0]}
  - {id: 2, start: [0, 8]}
shapes:
  line: {kind: line, spacing: 2}
steps:
  - takeoff: {height_m: 5}
  - form: {shape: line, tolerance_m: 0.5, settle_s: 0}
  - land
"""


def forms_of(plan: Plan) -> list[FormForecast]:
    """Of its only group."""
    (group,) = plan.groups
    return forecast_forms(plan, group)


def points(plan: Plan) -> Plan:
    """The law alone, flown by vehicles that answer at once."""
    at_once = Response(dead_time_s=0.0, lag_s=1e-6, acceleration_mps2=1e6, doubt_s=0.0)
    bare = Safety(filter=False, guard=False, release=False, align=False)
    return dataclasses.replace(
        plan,
        law=dataclasses.replace(plan.law, h=0.01),
        limits=Limits(speed_mps=1000),
        response=at_once,
        safety=bare,
    )


def test_two_agents_meet_as_the_closed_form_says() -> None:
    """Each one's error halves the difference by h per iteration: (1 - 2 h)^k * 15 m < 0.5 m."""
    plan = points(loads(PAIR).plan)
    (found,) = forms_of(plan)
    iterations = math.ceil(math.log(0.5 / 15) / math.log(1 - 2 * plan.law.h))
    assert found.formed_s == pytest.approx(iterations * plan.tick_s, abs=2 * plan.tick_s)
    assert found.smallest_m == pytest.approx(10, abs=1.0)
    assert found.smallest_pair == (1, 2)
    assert found.longest_link_m == pytest.approx(40)


def test_the_filter_flies_along() -> None:
    """Two that change places keep apart, as they do in flight; without the filter they do not."""
    text = PAIR.replace("{kind: line, spacing: 2}", "{kind: offsets, offsets: [[0, 8], [0, 0]]}")
    plan = loads(text.replace("form: {", "form: {slots: fixed, ")).plan
    apart_m = plan.law.r_in * plan.unit_m
    bare = Safety(filter=False, guard=False, release=False, align=False)
    blind = dataclasses.replace(plan, safety=bare, compensation=Compensation.NONE)
    assert forms_of(plan)[0].smallest_m > apart_m > forms_of(blind)[0].smallest_m


FLOWN = [("hexagon.yaml", 0, 8.85, 9.93), ("crossing.yaml", 1, 7.97, 8.0)]
"""Flown by simulated vehicles at 5 m/s: the time to form [s], the smallest distance [m]."""


@pytest.mark.parametrize(("name", "form", "formed_s", "smallest_m"), FLOWN)
def test_the_forecast_is_what_was_flown(
    name: str, form: int, formed_s: float, smallest_m: float
) -> None:
    """Within a fifth of the time, and a tenth of the distance."""
    plan = dataclasses.replace(load(HEXAGON.with_name(name)).plan, limits=Limits(speed_mps=5.0))
    settle_s = [step for step in steps_of(plan) if isinstance(step, FormStep)][form].settle_s
    found = forms_of(plan)[form]
    assert found.formed_s is not None
    assert found.formed_s - settle_s == pytest.approx(formed_s, rel=0.2)
    assert found.smallest_m == pytest.approx(smallest_m, rel=0.1)


def test_one_agent_is_a_formation_at_once() -> None:
    lines = [
        line
        for line in without_section("fleet").splitlines()
        if "{id: 2," not in line and "{id: 3," not in line
    ]
    text = (
        "\n".join(lines)
        .replace("count: 3", "count: 1")
        .replace("      - [0, 2]\n      - [0, 4]\n", "")
    )
    for found in forms_of(loads(text).plan):
        assert found.formed_s == pytest.approx(5.0, abs=0.06)
        assert found.smallest_pair is None
        assert found.longest_link_m == 0


MEASURED = [
    # as measured on real autopilots: height, take-off, landing [s]
    ("ardupilot", 10, 9.6, 23.0),
    ("ardupilot", 20, 13.6, 31.1),
    ("px4", 10, 13.0, 21.3),
    ("px4", 20, 19.9, 33.3),
]


def test_one_agent_climbs_to_its_slot() -> None:
    """Of a group of one: its step is over once it is there, not by its time-out."""
    text = PAIR.replace("  line: {", "  high: {kind: line, spacing: 2, up_m: 6}\n  line: {")
    alone = "  - split: {one: [form: {shape: high, settle_s: 0}]}\n  - form: {shape: line}"
    text = text.replace("  - land", f"{alone}\n  - land").replace(
        "shapes:", "groups: {one: [1]}\nshapes:"
    )
    plan = loads(text).plan
    (group,) = (group for group in plan.groups if group.name == "one")
    (form,) = forecast_forms(plan, group)
    assert form.formed_s is not None
    assert form.formed_s == pytest.approx(6 / plan.limits.climb_mps, abs=1.0)


@pytest.mark.parametrize(("kind", "height_m", "up_s", "down_s"), MEASURED)
def test_take_off_and_landing_last_as_long_as_on_real_autopilots(
    kind: str, height_m: int, up_s: float, down_s: float
) -> None:
    plan = loads(PAIR.replace("height_m: 5", f"height_m: {height_m}")).plan
    first, _, last = forecast(plan, [kind])
    assert first.expected_s == pytest.approx(up_s, rel=0.1)
    assert last.expected_s == pytest.approx(down_s, rel=0.1)
