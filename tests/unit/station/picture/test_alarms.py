"""Alarms: every row of the table is raised by its cause, and by nothing else."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import pytest

from swarm_ctl.core.model.messages import LinkReport, Phase, SigmaReport, TickReport
from swarm_ctl.core.swarm.gain_update import planned
from swarm_ctl.station.picture.alarms import RULES, Level, alarms
from swarm_ctl.station.picture.model import Model
from swarm_ctl.station.picture.summaries import gather_alarms, verdict
from swarm_ctl.station.picture.view import SwarmView
from tests.unit.station.swarm import flying_model, hexagon_plan, report_of, state_of, status_of

PLAN = hexagon_plan()


def _state(agent: int, **changes: object) -> SwarmView:
    model = flying_model(PLAN, 30.0)
    model.fold(state_of(PLAN, agent, 30.0, seq=1200, **changes), 30.0)
    return model.view(30.0)


def _status(agent: int, **changes: object) -> SwarmView:
    model = flying_model(PLAN, 30.0)
    model.fold(status_of(PLAN, agent, 30.0, **changes), 30.0)
    return model.view(30.0)


def _sigma(status: str = "paper", **changes: object) -> SwarmView:
    model = flying_model(PLAN, 30.0)
    model.fold(
        SigmaReport(1, 30.0, (0.0, 0.0), (0.0, 0.0), (report_of(2, 1.2, status, **changes),)), 30.0
    )
    return model.view(30.0)


def _silence(seconds: float, *, but_status: bool = False) -> SwarmView:
    """Agent 4 sends no states for so long; the others do."""
    model = flying_model(PLAN, 30.0)
    now = 30.0 + seconds
    for k in range(int(seconds * 20)):
        for agent in (1, 2, 3, 5, 6):
            model.fold(state_of(PLAN, agent, 30.0 + 0.05 * k, seq=1200 + k), 30.0 + 0.05 * k)
    if but_status:
        model.fold(status_of(PLAN, 4, now), now)
    return model.view(now)


def _loss() -> SwarmView:
    model = Model(PLAN)
    for k in range(200):
        for agent in PLAN.agents:
            if agent.id != 4 or k % 3:
                model.fold(state_of(PLAN, agent.id, 20 + 0.05 * k, seq=k), 20 + 0.05 * k)
    return model.view(30.0)


def _slow() -> SwarmView:
    model = Model(PLAN)
    for k in range(100):
        for agent in PLAN.agents:
            period = 0.08 if agent.id == 4 else 0.05
            model.fold(
                state_of(PLAN, agent.id, 30 - period * (99 - k), seq=k), 30 - period * (99 - k)
            )
    return model.view(30.0)


def _other_law(for_s: float) -> SwarmView:
    """Agent 4 has flown another law for so long."""
    model = flying_model(PLAN, 30.0)
    for agent in PLAN.agents:
        model.fold(
            state_of(PLAN, agent.id, 30.0, seq=1200, gains_tag=7 if agent.id == 4 else 0), 30.0
        )
        model.fold(
            state_of(PLAN, agent.id, 30.0 + for_s, seq=1201, gains_tag=7 if agent.id == 4 else 0),
            30.0 + for_s,
        )
    gains = replace(planned(PLAN), h=0.04)
    model.fold(status_of(PLAN, 4, 30.0 + for_s, gains=gains), 30.0 + for_s)
    return model.view(30.0 + for_s)


def _stranger() -> SwarmView:
    model = flying_model(PLAN, 30.0)
    model.fold(replace(state_of(PLAN, 1, 30.0, position_ned_m=(500.0, 0.0, -10.0)), agent=42), 30.0)
    return model.view(30.0)


CASES: dict[str, tuple[Callable[[], SwarmView], tuple[int, ...]]] = {
    "too close": (lambda: _state(6, position_ned_m=(60.0, 62.4, -10.0)), (2, 6)),
    "silent": (lambda: _silence(3.1), (4,)),
    "failed": (lambda: _status(4, outcome="failed", reason="no position"), (4,)),
    "other plan": (lambda: _state(4, plan_hash=1), (4,)),
    "vehicle silent": (lambda: _status(4, heartbeat_age_s=5.1), (4,)),
    "sigma bound": (lambda: _sigma(sigma=0.2), (1, 2)),
    "mixed laws": (lambda: _other_law(1.1), (4,)),
    "taken over": (lambda: _state(4, phase=Phase.YIELD), (4,)),
    "holding": (
        lambda: _status(4, phase=Phase.HOLD, reason="agent 3 has not been heard for 3 s"),
        (4,),
    ),
    "held alone": (lambda: _state(4, override=7), (4,)),
    "never heard": (lambda: Model(PLAN, since_s=10.0).view(15.1), (1,)),
    "old state": (lambda: _silence(1.1), (4,)),
    "overspeed": (lambda: _sigma("overspeed", d=None), (1, 2)),
    "long link": (lambda: _state(6, position_ned_m=(60.0, 37.4, -10.0)), (2, 6)),
    "old link": (lambda: _status(4, links={5: LinkReport(1.1, 0.05, 1.0, 100, 3)}), (4, 5)),
    "loss": (lambda: _loss(), (4,)),
    "no station": (lambda: _status(4, station_age_s=2.6), (4,)),
    "slow ticks": (lambda: _slow(), (4,)),
    "late ticks": (lambda: _status(4, tick=TickReport(500, 0, 1.0, 10.1, 12.0)), (4,)),
    "battery": (lambda: _status(4, battery_percent=19.0), (4,)),
    "stranger": (lambda: _stranger(), (42,)),
}


def test_a_link_of_vehicles_on_the_ground_is_not_long() -> None:
    """Their agents fly the take-off step, and GPS noise alone carries a position out of r."""
    model = flying_model(PLAN, 30.0)
    far = state_of(PLAN, 6, 30.0, seq=1200, phase=Phase.TAKEOFF, position_ned_m=(60.0, 37.4, 0.0))
    model.fold(far, 30.0)
    model.fold(status_of(PLAN, 6, 29.9, phase=Phase.TAKEOFF, airborne=False), 30.0)
    assert "long link" not in {alarm.name for alarm in alarms(model.view(30.0))}


def test_every_rule_has_a_case() -> None:
    assert [rule.name for rule in RULES] == list(CASES)
    assert all(rule.reason for rule in RULES)


@pytest.mark.parametrize("name", CASES)
def test_a_cause_raises_its_alarm(name: str) -> None:
    cause, agents = CASES[name]
    found = [alarm for alarm in alarms(cause()) if alarm.name == name]
    assert found
    assert found[0].agents == agents
    assert all(str(agent) in found[0].text for agent in agents)


@pytest.mark.parametrize("name", [name for name in CASES if name not in ("never heard", "silent")])
def test_a_cause_raises_no_other_alarm(name: str) -> None:
    assert {alarm.name for alarm in alarms(CASES[name][0]())} == {name}


def test_a_silent_agent_does_not_also_have_an_old_state() -> None:
    assert {alarm.name for alarm in alarms(_silence(3.1))} == {"silent"}
    assert {alarm.name for alarm in alarms(_silence(3.1, but_status=True))} == {"old state"}


def test_all_is_well_when_all_is_well() -> None:
    view = flying_model(PLAN).view(30.0)
    assert alarms(view) == ()
    assert verdict(view, ()) == [(Level.WELL, "all well")]


@pytest.mark.parametrize(
    "nearly",
    [
        lambda: _state(6, position_ned_m=(60.0, 62.6, -10.0)),
        lambda: _silence(0.9),
        lambda: _status(4, heartbeat_age_s=2.9),
        lambda: _state(6, position_ned_m=(60.0, 37.6, -10.0)),
        lambda: _status(4, station_age_s=2.4),
        lambda: _status(4, battery_percent=20.0),
        lambda: _status(4, phase=Phase.HOLD),
        lambda: _other_law(0.9),
        lambda: _status(4, tick=TickReport(500, 0, 1.0, 9.9, 12.0)),
        lambda: _sigma("inactive", d=None, sigma_lb=0.0, sigma=0.1),
    ],
)
def test_just_inside_a_threshold_is_silence(nearly: Callable[[], SwarmView]) -> None:
    assert alarms(nearly()) == ()


@pytest.mark.parametrize(
    "changes", [{"sigma": float("nan")}, {"sigma": -0.1}, {"d": 3.0}, {"d": 2.0}]
)
def test_every_broken_sigma_is_an_error(changes: dict[str, object]) -> None:
    (alarm,) = alarms(_sigma(**changes))  # type: ignore[arg-type]
    assert (alarm.name, alarm.level) == ("sigma bound", Level.ERROR)


def test_a_mixture_of_laws_is_told_with_what_differs() -> None:
    (alarm,) = alarms(_other_law(2.0))
    assert alarm.text == "agent 4 flies another law than agents 1-3, 5-6: h 0.05 -> 0.04"


def test_a_figure_just_beyond_its_limit_can_be_told_from_it() -> None:
    (alarm,) = alarms(_state(6, position_ned_m=(60.0, 60.0 - 22.5004, -10.0)))
    assert alarm.text == "link 2-6 is 22.5004 m long, over r 22.5000 m"
    (alarm,) = alarms(_state(6, position_ned_m=(60.0, 62.499, -10.0)))
    assert alarm.text == "agents 2 and 6 are 2.499 m apart, under r_in 2.500 m"


def test_errors_come_before_warnings() -> None:
    model = flying_model(PLAN, 30.0)
    model.fold(status_of(PLAN, 1, 30.0, battery_percent=5.0), 30.0)
    model.fold(status_of(PLAN, 6, 30.0, outcome="failed", reason="x"), 30.0)
    view = model.view(30.0)
    assert [alarm.name for alarm in alarms(view)] == ["failed", "battery"]
    assert verdict(view, alarms(view)) == [
        (Level.ERROR, "agent 6 failed: x"),
        (Level.WARNING, "battery of agent 1 at 5 %"),
    ]


def test_many_alarms_of_one_kind_are_one_line() -> None:
    lines = gather_alarms(alarms(Model(PLAN).view(6.0)))
    assert lines == [(Level.WARNING, "agent 1 was never heard (and 5 more: agents 2-6)")]


def test_waiting_is_said_with_its_reason() -> None:
    model = Model(PLAN)
    assert verdict(model.view(1.0), ()) == [(Level.WAITING, "waiting for agents 1-6")]
    for agent in PLAN.agents:
        reason = "no 3-D fix" if agent.id < 5 else "no heartbeat yet"
        model.fold(status_of(PLAN, agent.id, 2.0, phase=Phase.PREPARE, step=0, reason=reason), 2.0)
    assert verdict(model.view(2.0), ()) == [
        (Level.WAITING, "agents 1-4: no 3-D fix"),
        (Level.WAITING, "agents 5-6: no heartbeat yet"),
    ]


def test_the_end_is_told_by_the_agents_own_words() -> None:
    model = Model(PLAN)
    for agent in PLAN.agents:
        model.fold(status_of(PLAN, agent.id, 90.0, phase=Phase.ENDED, outcome="completed"), 90.0)
    assert verdict(model.view(120.0), ()) == [
        (Level.WELL, "all agents have ended, and say: completed")
    ]
