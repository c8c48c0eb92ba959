"""Two groups in one swarm, built in Python: each with its steps, barrier, shape, frame and graph;
they keep clear of each other, and wait for none of the other."""

from __future__ import annotations

import math
from dataclasses import replace

from swarm_ctl.mesh import keys
from swarm_ctl.mesh.memory_transport import MemoryTransport
from swarm_ctl.mesh.node import Node
from swarm_ctl.mission.compile.forecast import forecast
from swarm_ctl.mission.compile.loader import LoadedMission, loads
from swarm_ctl.mission.compile.plan_file import plan_from_json, plan_to_json
from swarm_ctl.station.picture.model import Model
from swarm_ctl.virtual.scenario import Scenario
from swarm_ctl.virtual.scenario_flight import ScenarioFlight

TEXT = """\
version: 1
name: two-groups
origin: {lat_deg: -35.36, lon_deg: 149.16, alt_m: 584}
unit_m: 1
tick_s: 0.1
law: {r: 20, r_out: 6, r_in: 2.5}
agents:
  - {id: 1, start: [0, 0]}
  - {id: 2, start: [0, 9]}
  - {id: 3, start: [0, 18]}
  - {id: 4, start: [20, 0]}
  - {id: 5, start: [20, 9]}
  - {id: 6, start: [20, 18]}
shapes:
  row: {kind: line, spacing: 9}
  wedge: {kind: wedge, spacing: 9}
steps:
  - takeoff: {height_m: 4}
"""
SEARCH = """\
  - form: {shape: row, slots: fixed, settle_s: 1}
  - move: {by: [-20, 0]}
  - land: {}
"""
WATCH = """\
  - form: {shape: wedge, slots: fixed, settle_s: 1}
  - hold: {duration_s: 20}
  - land: {}
"""


ONE, OTHER = (1, 2, 3), (4, 5, 6)


def mission(steps: str, ids: tuple[int, ...]) -> LoadedMission:
    lines = [
        line
        for line in TEXT.splitlines(keepends=True)
        if "start:" not in line or any(f"id: {i}," in line for i in ids)
    ]
    return loads("".join(lines) + steps)


def two_groups() -> LoadedMission:
    """Three agents search, three watch."""
    parts = {"search": mission(SEARCH, ONE), "watch": mission(WATCH, OTHER)}
    groups = [replace(part.plan.groups[0], name=name) for name, part in parts.items()]
    whole = mission(SEARCH, ONE + OTHER)
    return replace(whole, plan=replace(whole.plan, groups=tuple(groups)))


def test_a_station_and_the_verdict_go_by_each_groups_own_steps() -> None:
    """Each agent's step has its group's name for it, each shape its group's error; the summary has
    the steps of both."""
    whole = two_groups()
    scenario = Scenario(version=1, mission=TEXT)
    flight = ScenarioFlight(scenario, whole)
    model, node = Model(whole.plan), Node(MemoryTransport(flight.swarm.mesh), "test", "watcher")
    node.listen(keys.STATE, keys.STATUS, agents=[agent.id for agent in whole.plan.agents])
    worst_m = math.inf

    def watch(_: ScenarioFlight) -> None:
        nonlocal worst_m
        for channel in (keys.STATE, keys.STATUS):
            for payload, _at in node.take(channel):
                model.fold(payload, flight.swarm.now)
        view = model.view(flight.swarm.now)
        names = {agent.id: view.step_name(agent) for agent in view.agents}
        if names[1] == "move" and names[4] == "hold":
            worst_m = min(worst_m, view.error_m or math.inf)
            assert {(e.a in ONE, e.b in ONE) for e in view.edges} == {(True, True), (False, False)}

    summary = flight.fly(watch).summary
    assert worst_m < 0.5
    assert summary.outcome == "completed", summary.reason
    assert [step.name for step in summary.steps] == [
        *("prepare", "takeoff", "form row", "move", "land"),
        *("prepare", "takeoff", "form wedge", "hold", "land"),
    ]
    assert {step.result for step in summary.steps} == {"done"}
    assert summary.formation_error_m is not None
    assert summary.formation_error_m < 0.5
    shapes = [step.form.shape if step.form else "" for step in forecast(whole.plan)]
    assert shapes == ["", "row", "", "", "", "wedge", "", ""]
    again = plan_from_json(plan_to_json(whole.plan, whole.fleet))
    assert again.plan == whole.plan
