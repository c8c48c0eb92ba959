"""Alarms: every row of the table is raised by its cause, and by nothing else."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest

from swarm_ctl.core.model.causes import Cause, FailsafeAction
from swarm_ctl.core.model.messages import (
    Command,
    CommandKind,
    ExchangeState,
    LinkReport,
    Outcome,
    Phase,
    Refusal,
    RefusalReason,
    SigmaReport,
    TickReport,
    VehicleLinkReport,
)
from swarm_ctl.core.model.steps.form import FormStep
from swarm_ctl.core.model.steps.move import MoveStep
from swarm_ctl.core.model.text import agents_named
from swarm_ctl.core.swarm.gain_update import planned
from swarm_ctl.station.dashboard.drawing.picture import Picture
from swarm_ctl.station.picture.alarms import RULES, Level, alarms
from swarm_ctl.station.picture.model import Model
from swarm_ctl.station.picture.summaries import gather_alarms, verdict
from swarm_ctl.station.picture.view import FollowView, LinkView, SwarmView, TargetView
from tests.unit.plans import steps_of, with_group
from tests.unit.station.swarm import flying_model, hexagon_plan, report_of, state_of, status_of

PLAN = hexagon_plan()
REFUSAL = Refusal(
    "agent 7", RefusalReason.OTHER_OWNER, "a state under agent 7's key says agent 3", 5, 29.0
)


def _state(agent: int, **changes: object) -> SwarmView:
    model = flying_model(PLAN, 30.0)
    model.fold(state_of(PLAN, agent, 30.0, seq=1200, **changes), 30.0)
    return model.view(30.0)


def _status(agent: int, **changes: object) -> SwarmView:
    model = flying_model(PLAN, 30.0)
    model.fold(status_of(PLAN, agent, 30.0, **changes), 30.0)
    return model.view(30.0)


def _broken_off(
    action: FailsafeAction, cause: Cause, reason: str, phase: Phase = Phase.LAND
) -> SwarmView:
    return _status(4, phase=phase, reason=reason, action=action, cause=cause)


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


_REFUSES = VehicleLinkReport(9, 0, None, True, "unsigned frames for vehicle 4 refused: 12 in 10 s")


def _loss() -> SwarmView:
    model = Model(PLAN)
    for k in range(200):
        for agent in PLAN.agents:
            if agent.id != 4 or k % 3:
                model.fold(state_of(PLAN, agent.id, 20 + 0.05 * k, seq=k), 20 + 0.05 * k)
    return model.view(30.0)


def _slow(*slow: int) -> SwarmView:
    model = Model(PLAN, speedup=20.0)
    for k in range(100):
        for agent in PLAN.agents:
            period = 0.08 if agent.id in slow else 0.05
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


def _follows(for_s: float, silent_s: float | None) -> SwarmView:
    """For so long a boat has been followed, and for so long was silent; None: always."""
    seen = () if silent_s is None else (TargetView("boat", (0.0, 0.0), silent_s, "boat.1"),)
    follow = FollowView("boat", (1, 2, 3, 4, 5, 6), for_s)
    return replace(flying_model(PLAN).view(30.0), targets=seen, follows=(follow,))


def _stranger() -> SwarmView:
    model = flying_model(PLAN, 30.0)
    model.fold(replace(state_of(PLAN, 1, 30.0, position_ned_m=(500.0, 0.0, -10.0)), agent=42), 30.0)
    return model.view(30.0)


CASES: dict[str, tuple[Callable[[], SwarmView], tuple[int, ...]]] = {
    "too close": (lambda: _state(6, position_ned_m=(60.0, 62.4, -10.0)), (2, 6)),
    "slow machine": (lambda: _slow(1, 2, 4, 6), (1, 2, 3, 4, 5, 6)),
    "silent": (lambda: _silence(3.1), (4,)),
    "fallen": (lambda: _broken_off(FailsafeAction.KILL, Cause.ORDER, "killed"), (4,)),
    "failed": (lambda: _broken_off(FailsafeAction.LAND, Cause.POSITION, "no position"), (4,)),
    "other plan": (lambda: _state(4, plan_hash=1), (4,)),
    "vehicle silent": (lambda: _status(4, heartbeat_age_s=5.1), (4,)),
    "not believed": (lambda: _status(4, doubted={2: "it jumped by 9.0 m in 0.05 s"}), (2,)),
    "parameters": (
        lambda: _status(
            4, vehicle_link=VehicleLinkReport(1, 0, None, unsafe="FS_GCS_ENABLE is 0, allowed: 5")
        ),
        (4,),
    ),
    "sigma bound": (lambda: _sigma(sigma=0.2), (1, 2)),
    "mixed laws": (lambda: _other_law(1.1), (4,)),
    "follows another": (
        lambda: _broken_off(FailsafeAction.LAND, Cause.PEER, "agent 3 has not been heard for 3 s"),
        (4,),
    ),
    "taken over": (lambda: _state(4, phase=Phase.YIELD), (4,)),
    "holding": (
        lambda: _broken_off(FailsafeAction.HOLD, Cause.PEER, "agent 3 not heard", Phase.HOLD),
        (4,),
    ),
    "out by order": (lambda: _broken_off(FailsafeAction.RETURN, Cause.ORDER, "called back"), (4,)),
    "held alone": (lambda: _state(4, override=7), (4,)),
    "never heard": (lambda: Model(PLAN, since_s=10.0).view(15.1), (1,)),
    "target silent": (lambda: _follows(9.0, 2.1), (1, 2, 3, 4, 5, 6)),
    "old state": (lambda: _silence(1.1), (4,)),
    "overspeed": (lambda: _sigma("overspeed", d=None), (1, 2)),
    "long link": (lambda: _state(6, position_ned_m=(60.0, 37.4, -10.0)), (2, 6)),
    "old link": (lambda: _status(4, links={5: LinkReport(1.1, 0.05, 1.0, 100, 3)}), (4, 5)),
    "loss": (lambda: _loss(), (4,)),
    "no station": (lambda: _status(4, station_age_s=2.6), (4,)),
    "slow ticks": (lambda: _slow(4), (4,)),
    "late ticks": (lambda: _status(4, tick=TickReport(500, 0, 1.0, 10.1, 12.0)), (4,)),
    "refused frames": (lambda: _status(4, vehicle_link=_REFUSES), (4,)),
    "battery": (lambda: _status(4, battery_percent=19.0), (4,)),
    "refused messages": (lambda: _status(4, refused=(REFUSAL,)), (4,)),
    "stranger": (lambda: _stranger(), (42,)),
}


def test_every_rule_has_a_case() -> None:
    assert [rule.name for rule in RULES] == list(CASES)
    assert all(rule.reason for rule in RULES)


@pytest.mark.parametrize("name", CASES)
def test_a_cause_raises_its_alarm_alone(name: str) -> None:
    cause, agents = CASES[name]
    found = alarms(cause())
    first = next(alarm for alarm in found if alarm.name == name)
    assert first.agents == agents
    assert first.text.startswith(agents_named(agents))
    assert name in ("never heard", "silent") or {alarm.name for alarm in found} == {name}


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
        lambda: _follows(9.0, 1.9),
        lambda: _follows(1.9, 9.0),
        lambda: _follows(1.9, None),
        lambda: _status(4, tick=TickReport(500, 0, 1.0, 9.9, 12.0)),
        lambda: _status(4, tick=TickReport(499, 0, 1.0, 100.0, 120.0)),
        lambda: _sigma("inactive", d=None, sigma_lb=0.0, sigma=0.1),
    ],
)
def test_just_inside_a_threshold_is_silence(nearly: Callable[[], SwarmView]) -> None:
    assert alarms(nearly()) == ()


@pytest.mark.parametrize("changes", [{"sigma": 0.0}, {"sigma": -0.1}, {"d": 3.0}, {"d": 2.0}])
def test_every_broken_sigma_is_an_error(changes: dict[str, object]) -> None:
    (alarm,) = alarms(_sigma(**changes))  # type: ignore[arg-type]
    assert (alarm.name, alarm.level) == ("sigma bound", Level.ERROR)


def test_a_machine_that_does_not_keep_up_is_told_once_for_all() -> None:
    view = _slow(1, 2, 4, 6)
    assert gather_alarms(alarms(view)) == [
        (
            Level.ERROR,
            "agents 1-6: the machine can't keep up with --speedup 20: ticks 12.5 of 20 Hz",
        )
    ]


def test_a_figure_just_beyond_its_limit_can_be_told_from_it() -> None:
    (alarm,) = alarms(_state(6, position_ned_m=(60.0, 60.0 - 22.5004, -10.0)))
    assert alarm.text == "agents 2, 6: their link is 22.5004 m long, over r 22.5000 m"
    (alarm,) = alarms(_state(6, position_ned_m=(60.0, 62.499, -10.0)))
    assert alarm.text == "agents 2, 6: 2.499 m apart, under r_in 2.500 m"


def test_measured_alarms_of_one_kind_are_one_line() -> None:
    model = flying_model(PLAN, 30.0)
    for agent in (2, 4, 5):
        model.fold(status_of(PLAN, agent, 30.0, battery_percent=10.0 + agent), 30.0)
    assert gather_alarms(alarms(model.view(30.0))) == [
        (Level.WARNING, "agent 2: battery at 12 % (and 2 more: agents 4-5)")
    ]


@pytest.mark.parametrize(
    ("changes", "level"),
    [
        ({"action": FailsafeAction.KILL, "cause": Cause.ORDER}, Level.ERROR),
        ({"action": FailsafeAction.FALL, "cause": Cause.PILOT, "phase": Phase.YIELD}, Level.ERROR),
        ({"action": FailsafeAction.LAND, "cause": Cause.FALL}, Level.ERROR),
        ({"action": FailsafeAction.RETURN, "cause": Cause.BATTERY}, Level.ERROR),
        ({"action": FailsafeAction.LAND, "cause": Cause.ORDER}, Level.WARNING),
        ({"action": FailsafeAction.RETURN, "cause": Cause.ORDER}, Level.WARNING),
        (
            {"action": FailsafeAction.YIELD, "cause": Cause.PILOT, "phase": Phase.YIELD},
            Level.WARNING,
        ),
        ({"phase": Phase.ENDED, "outcome": Outcome.ABORTED, "cause": Cause.ORDER}, Level.WARNING),
    ],
)
@pytest.mark.parametrize("braking", [False, True])
def test_a_vehicle_that_left_the_mission_is_never_under_all_well(
    changes: dict[str, Any], level: Level, *, braking: bool
) -> None:
    """Neither while it brakes before it lands."""
    brakes = {"phase": Phase.HOLD} if braking and "phase" not in changes else {}
    view = _status(4, reason="why", **(changes | brakes))
    assert verdict(view, alarms(view)) == [(level, "agent 4: why")]


def test_an_order_to_all_is_the_newest_reason() -> None:
    """Agent 2 failed before; the banner says the order, and that something worse stands."""
    model = flying_model(PLAN, 30.0)
    model.fold(
        status_of(PLAN, 2, 30.0, phase=Phase.ENDED, outcome=Outcome.FAILED, reason="pilot"), 30.0
    )
    order = {"action": FailsafeAction.LAND, "cause": Cause.ORDER, "reason": "landed"}
    for agent in (1, 3, 4, 5):
        model.fold(status_of(PLAN, agent, 30.0, **order), 30.0)
    view = model.view(30.0)
    assert verdict(view, alarms(view))[0] == (Level.ERROR, "agent 2: pilot")  # agent 6 flies on
    model.fold(status_of(PLAN, 6, 30.0, **order), 30.0)
    view = model.view(30.0)
    assert verdict(view, alarms(view)) == [
        (Level.ERROR, "agents 1, 3-6: landed"),
        (Level.ERROR, "agent 2: pilot"),
    ]


GROUND = [(Phase.TAKEOFF, 1, False), (Phase.ARM, 1, False)]
ON_THE_WAY = [(Phase.RETURN, 4, True), (Phase.LAND, 4, True), (Phase.TAKEOFF, 1, True)]


@pytest.mark.parametrize(("phase", "step", "airborne"), GROUND + ON_THE_WAY)
def test_links_and_errors_are_of_the_formation_alone(
    phase: Phase, step: int, *, airborne: bool
) -> None:
    """Agents that take off, return or land may be apart, and stand in no shape; on the ground the
    noise of GPS alone carries a position out of r."""
    model = flying_model(PLAN, 30.0)
    for agent in PLAN.agents:
        there = {"phase": phase, "step": step, "airborne": airborne}
        north, east = 90.0 * agent.id, 0.0
        place = {"position_ned_m": (north, east, -10.0)}
        model.fold(state_of(PLAN, agent.id, 30.0, seq=1200, **(there | place)), 30.0)
        model.fold(status_of(PLAN, agent.id, 30.0, **there), 30.0)
    view = model.view(30.0)
    assert alarms(view) == ()
    assert view.error_m is None
    assert {edge.length_m for edge in view.edges} == {None}


def test_vehicles_on_the_ground_are_not_too_close() -> None:
    """The noise of GPS is no approach."""
    model = flying_model(PLAN, 30.0)
    near = state_of(PLAN, 6, 30.0, 1200, phase=Phase.TAKEOFF, position_ned_m=(60.0, 62.4, 0.0))
    model.fold(near, 30.0)
    assert {alarm.name for alarm in alarms(model.view(30.0))} == {"too close"}
    model.fold(status_of(PLAN, 6, 30.0, phase=Phase.TAKEOFF, airborne=False), 30.0)
    assert alarms(model.view(30.0)) == ()


def test_a_graph_that_a_step_chose_has_its_links_measured_after_that_step() -> None:
    """While its agents come together they may be apart; and it follows exchanged slots."""
    ring = tuple(tuple(sorted({k % 6 + 1, (k - 2) % 6 + 1})) for k in range(1, 7))
    first, form, *later = steps_of(PLAN)
    assert isinstance(form, FormStep)
    plan = with_group(PLAN, steps=(first, replace(form, neighbours=ring), *later))
    model = flying_model(plan, 30.0)
    assert {(e.a, e.b) for e in model.view(30.0).edges} == {
        *((k, k + 1) for k in range(1, 6)),
        (1, 6),
    }
    assert alarms(model.view(30.0)) == ()
    for agent in plan.agents:
        role = ExchangeState(role={1: 1, 2: 0}.get(agent.id, agent.id - 1))
        model.fold(state_of(plan, agent.id, 30.0, 1200, step=3, exchange=role), 30.0)
    view = model.view(30.0)
    assert {(e.a, e.b) for e in view.edges} == {(1, 2), (1, 3), (3, 4), (4, 5), (5, 6), (2, 6)}
    assert {alarm.name for alarm in alarms(view)} == {"long link"}


def test_a_link_of_one_that_has_ended_or_is_lost_may_be_old() -> None:
    old = LinkReport(4.0, 0.05, 1.0, 100, 3)
    model = flying_model(PLAN, 30.0)
    ended = {"phase": Phase.ENDED, "outcome": Outcome.COMPLETED, "airborne": False}
    model.fold(state_of(PLAN, 5, 30.0, 1200, phase=Phase.ENDED, airborne=False), 30.0)
    model.fold(status_of(PLAN, 5, 30.0, **ended), 30.0)
    model.fold(status_of(PLAN, 4, 30.0, links={5: old}), 30.0)
    assert alarms(model.view(30.0)) == ()
    lost = replace(_silence(3.1), links=(LinkView(5, 4, old),))
    assert "old link" not in {alarm.name for alarm in alarms(lost)}


def test_in_file_links_are_as_long_as_the_file() -> None:
    """A move together with the same links is an alarm."""
    first, _, *later = steps_of(PLAN)
    for opens_m, found in ((10.0, set()), (None, {"long link"})):
        move = MoveStep(((80.0, 40.0),), 4.0, 0.5, 2.0, 60.0, opens_m=opens_m)
        plan = with_group(PLAN, steps=(first, move, *later))
        model = flying_model(plan, 30.0)
        far_m = (60.0, 37.4, -10.0)
        model.fold(state_of(plan, 6, 30.0, 1200, position_ned_m=far_m), 30.0)
        assert {alarm.name for alarm in alarms(model.view(30.0))} == found


def test_agents_that_land_because_of_another_are_no_errors() -> None:
    """One line of error, the culprit's: the others are told of in a warning."""
    model = flying_model(PLAN, 30.0)
    model.fold(
        status_of(
            PLAN, 3, 30.0, action=FailsafeAction.LAND, cause=Cause.POSITION, reason="no position"
        ),
        30.0,
    )
    for agent in (1, 2, 4, 5, 6):
        theirs = {"action": FailsafeAction.LAND, "cause": Cause.PEER, "reason": "agent 3 gave up"}
        model.fold(status_of(PLAN, agent, 30.0, **theirs), 30.0)
    found = alarms(model.view(30.0))
    assert gather_alarms(found) == [
        (Level.ERROR, "agent 3: no position"),
        (Level.WARNING, "agents 1-2, 4-6: agent 3 gave up"),
    ]
    picture = Picture(model.view(30.0), found)
    assert picture.levels() == {3: Level.ERROR}
    assert picture.innocent == {1, 2, 4, 5, 6}


@pytest.mark.parametrize(
    ("heard", "who"), [(True, "form of station-9"), (False, "of nobody whom this station heard")]
)
def test_a_command_to_some_is_told_with_its_sender(heard: bool, who: str) -> None:
    """Of a forged one that went round this station, that."""
    model = flying_model(PLAN)
    command = Command("x", "form", (4,), 30.0, station="station-9")
    if heard:
        model.fold(command, 30.0)
    model.fold(state_of(PLAN, 4, 30.02, 2000, override=command.tag), 30.03)
    (alarm,) = (each for each in alarms(model.view(30.03)) if each.name == "held alone")
    assert f"held by a command ({who})" in alarm.words


@pytest.mark.parametrize("left", [None, CommandKind.GOTO])
@pytest.mark.parametrize("phase", [Phase.LAND, Phase.ENDED])
def test_who_hangs_in_the_air_by_a_command_when_all_others_are_down_is_told(
    phase: Phase, left: CommandKind | None
) -> None:
    """All was well on the screen, with a vehicle that nobody would ever have brought down."""
    model = flying_model(PLAN)
    for agent in (1, 2, 3, 5, 6):
        model.fold(state_of(PLAN, agent, 30.02, 2000, phase=phase, airborne=False), 30.03)
    expel = Command("x", "expel", (), 30.0, station="station-9", about=(4,))
    model.fold(expel, 30.0)
    model.fold(state_of(PLAN, 4, 30.02, 2000, override=expel.tag, left=left), 30.03)
    (alarm,) = (each for each in alarms(model.view(30.03)) if each.name == "held alone")
    assert alarm.agents == (4,)
    assert alarm.words.endswith("; no other agent flies the mission")


def test_for_an_expelled_agent_nobody_is_said_to_wait() -> None:
    """The others listen to it no more; the alarm had them wait for two minutes."""
    model = flying_model(PLAN)
    for agent in (1, 2, 3, 5, 6):
        links = {4: LinkReport(None, None, None, 600, 0)}
        model.fold(status_of(PLAN, agent, 30.02, links=links), 30.03)
    model.fold(state_of(PLAN, 4, 30.02, 2000, override=7), 30.03)
    (alarm,) = (each for each in alarms(model.view(30.03)) if each.name == "held alone")
    assert alarm.words.endswith("; expelled: nobody waits")


@pytest.mark.parametrize("others", [0, 7])
@pytest.mark.parametrize("since", [{"left": CommandKind.GOTO}, {"phase": Phase.LAND}])
def test_who_was_sent_to_a_point_or_lands_holds_nobody(since: dict[str, Any], others: int) -> None:
    """The others go on without it, also those that all fly the command still."""
    model = flying_model(PLAN)
    for agent in (1, 2, 3, 5, 6):
        model.fold(state_of(PLAN, agent, 30.02, 2000, override=others), 30.03)
    model.fold(state_of(PLAN, 4, 30.02, 2000, override=7, **since), 30.03)
    assert all(each.name != "held alone" for each in alarms(model.view(30.03)))


def test_a_command_to_all_that_some_take_a_moment_later_holds_nobody_alone() -> None:
    """It stood there for a few tenths of a second after each `hold` and `resume`. A command of
    which this station has not heard is told at once."""
    model = flying_model(PLAN)
    command = Command("x", "hold", (), 30.0, station="station-9")
    model.fold(command, 30.0)

    def told(tag: int, time_s: float) -> bool:
        model.fold(state_of(PLAN, 4, time_s, round(time_s * 100), override=tag), time_s)
        return any(each.name == "held alone" for each in alarms(model.view(time_s)))

    assert not told(command.tag, 30.1)
    assert told(command.tag + 1, 30.2)
    assert told(command.tag, 31.1)
