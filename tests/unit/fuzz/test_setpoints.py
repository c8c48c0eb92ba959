"""A filter that takes more of the room than its share is found before a pair is near."""

from __future__ import annotations

from typing import Any

import pytest

from swarm_ctl.core.agent.landing import Landing
from swarm_ctl.core.kernel import constraints, decide
from swarm_ctl.core.kernel.constraints import Margins, Other, keep_out
from swarm_ctl.core.kernel.heights import span
from swarm_ctl.core.safety import safety_filter
from swarm_ctl.fuzz.invariants.table import broken
from swarm_ctl.mission.input import yaml_file
from swarm_ctl.virtual.scenario import scenario_of
from swarm_ctl.virtual.scenario_flight import fly_scenario

FORMED = {"settle_s": 1.0, "timeout_s": 60.0, "slots": "fixed"}


def broke_in(changes: dict[str, Any], *happens: dict[str, Any]) -> str:
    """What broke in a mission of these agents, shapes and steps."""
    mission = {
        "version": 1,
        "name": "swap",
        "origin": {"lat_deg": 47.4, "lon_deg": 8.55, "alt_m": 450.0},
        "unit_m": 3.0,
        "law": {"r": 4.5, "r_out": 1.5, "r_in": 0.5},
        "tick_s": 0.1,
        "policies": {"agent_lost": "continue"},
        **changes,
    }
    scenario = {"version": 1, "mission": mission, "seed": 1, "happens": list(happens)}
    found = broken(fly_scenario(*scenario_of(yaml_file.write(scenario))))
    return "\n".join(each.text for each in found)


def swapped(*happens: dict[str, Any]) -> str:
    """What broke where four agents change places, all through the middle."""
    points = [(1.5, 1.5), (-1.5, 1.5), (-1.5, -1.5), (1.5, -1.5)]
    shapes = {
        "one": [list(point) for point in points],
        "other": [[-north, -east] for north, east in points],
    }
    changes = {
        "agents": [{"id": k, "start": list(point)} for k, point in enumerate(points, 1)],
        "shapes": {name: {"kind": "offsets", "offsets": at} for name, at in shapes.items()},
        "steps": [
            {"takeoff": {"height_m": 4.0}},
            {"form": {"shape": "one", **FORMED}},
            {"form": {"shape": "other", **FORMED}},
            "land",
        ],
    }
    return broke_in(changes, *happens)


BEHIND_ANOTHER = {
    "agents": [{"id": k, "start": [-2.0 * k, 0.0]} for k in (1, 2, 3)],
    "shapes": {"one": {"kind": "column", "spacing": 2.0}},
    "targets": {"boat": {"along": [[-4.0, 0.0], [30.0, 0.0]], "speed_mps": 2.0, "height_m": 0.0}},
    "steps": [
        {"takeoff": {"height_m": 4.0}},
        {"form": {"shape": "one", **FORMED}},
        {"follow": {"target": "boat", "duration_s": 5.0}},
        "land",
    ],
}
ABOVE_ANOTHER = {
    "agents": [{"id": 1, "start": [0.0, 0.0]}, {"id": 2, "start": [2.2, 0.0]}],
    "wake": {"rotor_distance_m": 0.16, "mass_kg": 0.25},
    "shapes": {
        "one": {"kind": "offsets", "offsets": [[-0.3, 0.0], [0.3, 0.0]], "up_m": [0.0, 7.0]},
        "other": {"kind": "offsets", "offsets": [[0.8, 0.0], [-0.8, 0.0]]},
    },
    "steps": [
        {"takeoff": {"height_m": 4.0}},
        {"form": {"shape": "one", **FORMED}},
        {"form": {"shape": "other", **FORMED}},
        "land",
    ],
}


def test_each_takes_half_of_the_room(monkeypatch: pytest.MonkeyPatch) -> None:
    lands = {"at_s": 19.0, "order": "land"}
    assert swapped(lands) == ""

    def all_of_it(other: Other, margins: Margins) -> tuple[complex, float, float]:
        return keep_out(other._replace(yields=False), margins)

    monkeypatch.setattr(decide, "keep_out", all_of_it)
    assert " took more than half of the room to agent " in swapped(lands)


def test_each_is_slow_near_others(monkeypatch: pytest.MonkeyPatch) -> None:
    holds = {"at_s": 15.0, "order": "hold @1"}, {"at_s": 19.0, "order": "land"}
    assert swapped(*holds) == ""
    monkeypatch.setattr(decide, "cap", lambda room, unsure_s, margins: margins.speed)
    assert "agent 2 was too fast for the room to others at 18.2 s" in swapped(*holds)


def test_each_makes_room_before_it_lands(monkeypatch: pytest.MonkeyPatch) -> None:
    lands = {"at_s": 16.0, "order": "land"}
    assert swapped(lands) == ""
    monkeypatch.setattr(Landing, "_crowded", lambda landing, tick: False)
    assert "agent 1 began to land at 16.3 s, 2.70 m beside agent 2, which flew" in swapped(lands)


def test_a_silent_one_may_have_flown_on(monkeypatch: pytest.MonkeyPatch) -> None:
    dies = {"at_s": 13.5, "kill": [1]}, {"at_s": 18.0, "order": "land"}
    assert swapped(*dies) == ""
    monkeypatch.setattr(constraints, "flown_s", lambda age_s, fresh, _: age_s if fresh else 0.0)
    assert " where agent 1 may have been, which was silent since 13.5 s" in swapped(*dies)


def test_one_that_is_held_up_carries_nobody_along(monkeypatch: pytest.MonkeyPatch) -> None:
    """A column begins to follow a boat: not all of it sets out at once."""
    assert broke_in(BEHIND_ANOTHER) == ""
    monkeypatch.setattr(safety_filter, "flies_with", lambda setpoint, moving: True)
    assert "agent 3 took more than half of the room to agent 2 at 12.4 s" in broke_in(
        BEHIND_ANOTHER
    )


def test_a_vehicle_is_on_all_of_its_way_in_height(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two above each other change places, and heights."""
    assert broke_in(ABOVE_ANOTHER) == ""
    monkeypatch.setattr(safety_filter, "span", lambda now_m, _, off_m: span(now_m, now_m, off_m))
    assert "agent 1 took more than half of the room to agent 2 at 20.5 s" in broke_in(ABOVE_ANOTHER)
