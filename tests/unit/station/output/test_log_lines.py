"""The log of a headless run: everything once, in words."""

from __future__ import annotations

import itertools
from dataclasses import replace

import pytest

from swarm_ctl.core.model.messages import Ack, Command, Event, Phase
from swarm_ctl.station.output.log_lines import log_lines
from swarm_ctl.station.picture.model import Model
from swarm_ctl.station.picture.protection import MeshKind, Protection
from swarm_ctl.station.picture.view import SwarmView
from tests.unit.plans import REST, SCOUTS, SWEEPERS
from tests.unit.station.pictures import PICTURES
from tests.unit.station.swarm import flying_model, grouped_model, hexagon_plan, state_of, status_of

PLAN = hexagon_plan()


def _waiting(model: Model, agent: int, time_s: float, reason: str) -> None:
    model.fold(
        status_of(PLAN, agent, time_s, phase=Phase.PREPARE, step=0, reason=reason, airborne=False),
        time_s,
    )


@pytest.mark.parametrize("name", PICTURES)
def test_the_same_view_again_is_no_news(name: str) -> None:
    view = PICTURES[name]()
    assert log_lines(view, view) == []
    assert all(line.isascii() and line.isprintable() for line in log_lines(None, view))


def test_a_flight_is_told_once_step_by_step() -> None:
    model = Model(PLAN)
    views = [model.view(0.0)]
    for agent in PLAN.agents:
        _waiting(model, agent.id, 1.0, "no 3-D fix" if agent.id > 4 else "")
    views.append(model.view(1.0))
    for agent in PLAN.agents:
        model.fold(status_of(PLAN, agent.id, 8.0, phase=Phase.TAKEOFF, step=1), 8.0)
        model.fold(Event(agent.id, 8.0, "info", "step 1: takeoff"), 8.0)
    views.append(model.view(8.0))
    for agent in PLAN.agents:
        model.fold(state_of(PLAN, agent.id, 20.0), 20.0)
    model.fold(Event(2, 20.0, "warning", "vehicle: EKF\x1b[2J variance"), 20.0)
    views.append(model.view(20.0))
    told = [
        line
        for before, after in zip([None, *views], views, strict=False)
        for line in log_lines(before, after)
    ]
    assert told == [
        "[    1.0 s] agents 1-6: prepare",
        "[    1.0 s] agents 5-6: no 3-D fix",
        "[    8.0 s] step 1/4: takeoff",
        "[    8.0 s] agents 1-6: prepare -> takeoff",
        "[   20.0 s] step 2/4: form hexagon",
        "[   20.0 s] agents 1-6: takeoff -> fly",
        "[   20.0 s] agent 2: WARNING: vehicle: EKF?[2J variance",
    ]


def test_an_alarm_is_raised_once_and_cleared_once_though_its_figures_change() -> None:
    model = flying_model(PLAN)
    views = [model.view(30.0)]
    for k, charge in enumerate((19.0, 18.0, 60.0)):
        model.fold(status_of(PLAN, 4, 30.1 + 0.1 * k, battery_percent=charge), 30.1 + 0.1 * k)
        views.append(model.view(30.1 + 0.1 * k))
    told = [log_lines(a, b) for a, b in itertools.pairwise(views)]
    assert told == [
        ["[   30.1 s] WARNING: agent 4: battery at 19 %"],
        [],
        ["[   30.3 s] cleared: battery (agent 4)"],
    ]


def test_what_was_said_before_is_told_at_its_own_time() -> None:
    """Of a station that joined in flight: the first view has the run's events and commands."""
    model = flying_model(PLAN)
    for agent in PLAN.agents:
        model.recall(Event(agent.id, 3.0, "info", "ready"))
    model.recall(Command("c", "hold", (), 2.0))
    model.recall(Ack(1, "c", True, ""))
    told = log_lines(None, model.view(30.0))
    assert told[:2] == [
        "[    2.0 s] command hold: acknowledged by agent 1, waiting for agents 2-6",
        "[    3.0 s] agents 1-6: ready",
    ]
    assert all(line.startswith("[   30.0 s]") for line in told[2:])


def test_what_keeps_others_off_is_told_once() -> None:
    """Of a mesh with keys, once all agents are heard on it."""
    model = flying_model(PLAN)
    for mesh, words in (
        (
            Protection(MeshKind.TLS, "operator anna"),
            "mesh TLS 6/6, links not signed, operator anna",
        ),
        (Protection(MeshKind.OPEN), "MESH OPEN, any computer that reaches it may command"),
    ):
        view = replace(model.view(30.0), protection=mesh)
        assert sum(words in line for line in log_lines(None, view)) == 1
        assert not any("mesh" in line.lower() for line in log_lines(view, view))
    assert not any("mesh" in line.lower() for line in log_lines(None, model.view(30.0)))
    none = replace(Model(PLAN).view(0.0), protection=Protection(MeshKind.TLS, "operator anna"))
    assert not any("mesh" in line.lower() for line in log_lines(None, none))


def test_reasons_that_differ_in_the_vehicles_id_alone_are_one_line_and_told_once() -> None:
    """Six lines: `agent N: no heartbeat yet from sysid N`."""
    model = Model(PLAN)
    views = [model.view(0.0)]
    for heard in (0, 1, 3, 5):
        for agent in PLAN.agents:
            why = "" if agent.id <= heard else f"no heartbeat yet from sysid {agent.id + 10}"
            _waiting(model, agent.id, 1.0 + heard, why)
        views.append(model.view(1.0 + heard))
    lines = [line for a, b in itertools.pairwise(views) for line in log_lines(a, b)]
    told = [line.partition("] ")[2] for line in lines if "heartbeat" in line]
    assert told == ["agents 1-6: no heartbeat yet from sysid 11-16"]


def test_the_steps_of_each_group_are_told_and_for_whom_it_waits() -> None:
    """Each once, whatever the others do; not the joins that only fill a shorter group's list."""

    def seen(**steps: tuple[int, bool]) -> SwarmView:
        members = {"scouts": SCOUTS, "sweepers": SWEEPERS, "rest": REST}
        told = {agent: at for name, at in steps.items() for agent in members[name]}
        return grouped_model(told).view(60.0)

    views = [
        grouped_model(dict.fromkeys(range(1, 13), (2, True))).view(60.0),
        seen(scouts=(3, False), sweepers=(3, False), rest=(3, True)),
        seen(scouts=(4, False), sweepers=(3, False), rest=(3, True)),
        seen(scouts=(5, True), sweepers=(3, True), rest=(3, True)),
        seen(scouts=(5, True), sweepers=(4, False), rest=(3, True)),
        seen(scouts=(7, True), sweepers=(8, True), rest=(4, True)),
        seen(scouts=(8, True), sweepers=(8, True), rest=(8, True)),
        grouped_model(dict.fromkeys(range(1, 13), (9, False))).view(60.0),
    ]
    said = [
        [w[12:] for w in log_lines(a, b) if "step" in w or "waits" in w]
        for a, b in itertools.pairwise(views)
    ]
    waits = "rest: done with join 1, waits for scouts, sweepers"
    assert said == [
        [
            "scouts: step 3/11: form wedge",
            "sweepers: step 3/11: form line",
            "rest: step 3/11: join 1",
            waits,
        ],
        ["scouts: step 4/11: move"],
        ["scouts: step 5/11: barrier ridge", "scouts: done with barrier ridge, waits for sweepers"],
        ["sweepers: step 4/11: move"],
        ["scouts: step 7/11: join 1", "sweepers: step 8/11: join 1"],
        [],
        ["all: step 9/11: form ring"],
    ]
