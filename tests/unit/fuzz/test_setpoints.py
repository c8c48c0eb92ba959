"""A filter that takes more of the room than its share is found before a pair is near."""

from __future__ import annotations

from typing import Any

import pytest

from swarm_ctl.core.agent.landing import Landing
from swarm_ctl.core.kernel import constraints, decide
from swarm_ctl.core.kernel.constraints import Margins, Other, keep_out
from swarm_ctl.fuzz.invariants import broken
from swarm_ctl.mission.input import yaml_file
from swarm_ctl.virtual.scenario import scenario_of
from swarm_ctl.virtual.scenario_flight import fly_scenario


def swapped(*happens: dict[str, Any]) -> str:
    """What broke where four agents change places, all through the middle."""
    points = [(1.5, 1.5), (-1.5, 1.5), (-1.5, -1.5), (1.5, -1.5)]
    shapes = {
        "one": [list(point) for point in points],
        "other": [[-north, -east] for north, east in points],
    }
    formed = {"settle_s": 1.0, "timeout_s": 60.0, "slots": "fixed"}
    mission = {
        "version": 1,
        "name": "swap",
        "origin": {"lat_deg": 47.4, "lon_deg": 8.55, "alt_m": 450.0},
        "unit_m": 3.0,
        "law": {"r": 4.5, "r_out": 1.5, "r_in": 0.5},
        "tick_s": 0.1,
        "policies": {"agent_lost": "continue"},
        "agents": [{"id": k, "start": list(point)} for k, point in enumerate(points, 1)],
        "shapes": {name: {"kind": "offsets", "offsets": at} for name, at in shapes.items()},
        "steps": [
            {"takeoff": {"height_m": 4.0}},
            {"form": {"shape": "one", **formed}},
            {"form": {"shape": "other", **formed}},
            "land",
        ],
    }
    scenario = {"version": 1, "mission": mission, "seed": 1, "happens": list(happens)}
    found = broken(fly_scenario(*scenario_of(yaml_file.write(scenario))))
    return "\n".join(each.text for each in found)


def test_each_takes_half_of_the_room(monkeypatch: pytest.MonkeyPatch) -> None:
    assert swapped() == ""

    def all_of_it(other: Other, margins: Margins) -> tuple[complex, float, float]:
        return keep_out(other._replace(yields=False), margins)

    monkeypatch.setattr(decide, "keep_out", all_of_it)
    assert " took more than half of the room to agent " in swapped()


def test_each_is_slow_near_others(monkeypatch: pytest.MonkeyPatch) -> None:
    holds = {"at_s": 15.0, "order": "hold @1"}
    assert swapped(holds) == ""
    monkeypatch.setattr(decide, "cap", lambda room, unsure_s, margins: margins.speed)
    assert "agent 2 was too fast for the room to others at 18.2 s" in swapped(holds)


def test_each_makes_room_before_it_lands(monkeypatch: pytest.MonkeyPatch) -> None:
    lands = {"at_s": 16.0, "order": "land"}
    assert swapped(lands) == ""
    monkeypatch.setattr(Landing, "_crowded", lambda landing, tick: False)
    assert "agent 1 began to land at 16.3 s, 2.70 m beside agent 2, which flew" in swapped(lands)


def test_a_silent_one_may_have_flown_on(monkeypatch: pytest.MonkeyPatch) -> None:
    dies = {"at_s": 13.5, "kill": [1]}
    assert swapped(dies) == ""
    monkeypatch.setattr(constraints, "flown_s", lambda age_s, fresh: age_s if fresh else 0.0)
    assert " where agent 1 may have been, which was silent since 13.5 s" in swapped(dies)
