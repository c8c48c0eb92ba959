"""From where an agent is in its mission to the tick's goal: each step, its end, and its time."""

import math
from dataclasses import replace
from typing import Any

import pytest

from swarm_ctl.core.agent.command_handler import CommandHandler, Override
from swarm_ctl.core.agent.step_executor import StepExecutor
from swarm_ctl.core.model.messages import CommandKind, Phase, StepOutcome
from swarm_ctl.core.model.plan import Plan, Policy
from swarm_ctl.core.model.steps.hold import HoldStep
from swarm_ctl.core.model.vehicle import (
    AirborneGoal,
    FlyGoal,
    Goal,
    LandGoal,
    ReleaseGoal,
    StandbyGoal,
)
from tests.unit.core.builders import (
    FORM,
    FORMING,
    HEIGHT_M,
    HOLD,
    LAST,
    MOVE,
    NOW,
    OWN,
    PARKED,
    STEPS,
    TAKEOFF,
    Own,
    fix,
    peer,
    plan,
)
from tests.unit.plans import steps_of

PREPARE = 0
UNFLOWN: dict[str, Any] = {"was_armed": False, "had_control": False, "arming_s": -math.inf}
"""Of a vehicle that has not been asked to arm yet."""


class Flight(Own):
    """The executor of agent 1, with the real parts around it."""

    def __init__(self, step: int, of: Plan | None = None, **changes: Any) -> None:
        super().__init__(of, step, **changes)
        if step >= FORM:
            self.group.begin_form(FORMING)
        of = self.plan
        self.orders = CommandHandler(of, OWN, of.hash())
        self.executor = StepExecutor(
            self.vehicle,
            self.group,
            self.interruption,
            self.log,
            self.preflight,
            self.orders,
            self.landing,
            self.takeover,
            self.steering.setpoints,
        )

    def at(self, later_s: float = 0.0, *peers: Any, **seen: Any) -> Goal:
        """The goal of one tick, `later_s` after NOW; the two peers are in the own step, in slot."""
        step = max(self.progress.step, TAKEOFF)
        others = peers or (peer(2, step=step), peer(3, step=step))
        one = self.tick(*others, now=NOW + later_s, **seen)
        own_m = self.controller.stop_point_m
        self.group.measure(one, own_m, airborne=self.vehicle.was_armed)
        return self.act(one, self.executor.decide(one, own_m))

    def through(self, seconds: float, **seen: Any) -> bool:
        """Tick for so long; whether the step is done by then."""
        for k in range(round(seconds / 0.05) + 1):
            self.at(0.05 * k, **seen)
        return self.progress.done


# --- each step's goal ---

GOALS: list[tuple[str, int, dict[str, Any], dict[str, Any], type[Goal], Phase]] = [
    ("never heard", PREPARE, UNFLOWN, PARKED | {"heartbeat_s": -math.inf}, StandbyGoal,
     Phase.CONNECT),
    ("on the ground", PREPARE, UNFLOWN, PARKED, StandbyGoal, Phase.PREPARE),
    ("not armed yet", TAKEOFF, {}, PARKED, AirborneGoal, Phase.ARM),
    ("armed, no position", TAKEOFF, {}, {"fix": None}, AirborneGoal, Phase.ARM),
    ("climbing", TAKEOFF, {}, {"fix": fix(height_m=3.0)}, AirborneGoal, Phase.TAKEOFF),
    ("up", TAKEOFF, {}, {}, FlyGoal, Phase.TAKEOFF),
    ("forming", FORM, {}, {}, FlyGoal, Phase.FLY),
    ("holding", HOLD, {}, {}, FlyGoal, Phase.FLY),
    ("moving", MOVE, {}, {}, FlyGoal, Phase.FLY),
    ("landing", LAST, {}, {}, LandGoal, Phase.LAND),
    ("ended", HOLD, {"ended_s": NOW - 1.0}, {}, ReleaseGoal, Phase.ENDED),
]  # fmt: skip


@pytest.mark.parametrize(
    ("step", "own", "seen", "goal", "phase"),
    [row[1:] for row in GOALS],
    ids=[row[0] for row in GOALS],
)
def test_goal_and_phase(
    step: int, own: dict[str, Any], seen: dict[str, Any], goal: type[Goal], phase: Phase
) -> None:
    """Each step asks for its own kind of goal, and shows its phase."""
    flight = Flight(step, **own)
    assert isinstance(flight.at(**seen), goal)
    assert flight.phase is phase


# --- prepare ---

READY: list[tuple[str, dict[str, Any], bool, str]] = [
    ("healthy", {}, True, "waiting for the others"),
    ("not healthy", {"healthy": False, "health_reason": "no GPS"}, False, "no GPS"),
    ("armed by another", {"armed": True}, False, "armed already"),
]


@pytest.mark.parametrize(("seen", "done", "why"), [r[1:] for r in READY], ids=[r[0] for r in READY])
def test_prepare_is_done_when_nothing_is_refused(
    seen: dict[str, Any], done: bool, why: str
) -> None:
    """The step is done for a healthy vehicle alone, and the reason says what is waited for."""
    flight = Flight(PREPARE, **UNFLOWN)
    flight.at(**{**PARKED, **seen})
    assert flight.progress.done is done
    assert why in flight.reason


def test_health_lost_while_waiting_undoes_prepare() -> None:
    """An agent that was ready and is not any more keeps its peers on the ground."""
    flight = Flight(PREPARE, **UNFLOWN)
    flight.at(**PARKED)
    flight.at(0.05, **PARKED, healthy=False, health_reason="no GPS")
    assert not flight.progress.done


# --- take-off ---


@pytest.mark.parametrize(
    ("seen", "done"),
    [
        ({}, True),
        ({"controlled": False}, False),
        ({"fix": fix(height_m=HEIGHT_M - 0.51)}, False),
        ({"fix": fix(height_m=HEIGHT_M - 0.49)}, True),
    ],
    ids=["up", "up in another mode", "0.51 m short", "0.49 m short"],
)
def test_take_off_ends_at_its_height_under_control(seen: dict[str, Any], done: bool) -> None:
    """Half a metre below the height, and in the mode that follows setpoints."""
    flight = Flight(TAKEOFF)
    flight.at(**seen)
    assert flight.progress.done is done


CLIMBS = {"climbs_by_setpoints": True, "on_ground": False}


@pytest.mark.parametrize(
    ("seen", "steered"),
    [
        (CLIMBS, True),
        (CLIMBS | {"on_ground": True}, False),
        (CLIMBS | {"climbs_by_setpoints": False}, False),
        (CLIMBS | {"controlled": False}, False),
    ],
    ids=["in the air", "on the ground", "by the autopilot", "in another mode"],
)
def test_a_climb_by_setpoints_comes_back_over_its_start(
    seen: dict[str, Any], steered: bool
) -> None:
    """Blown off by a metre, it is told to fly back, where the climb is flown by setpoints."""
    flight = Flight(TAKEOFF)
    flight.at(**seen, fix=fix(height_m=0.0))
    goal = flight.at(0.05, **seen, fix=fix(0.0, 1.0, height_m=3.0))
    assert isinstance(goal, AirborneGoal)
    assert (goal.velocity_mps[1] < -0.5) is steered


def test_what_the_vehicle_says_is_the_reason_it_does_not_arm() -> None:
    """A STATUSTEXT is kept as the reason until a newer one comes."""
    flight = Flight(TAKEOFF, **UNFLOWN)
    flight.at(**PARKED)
    assert flight.reason == "waiting for the vehicle to arm"
    flight.at(0.05, **PARKED, texts=("PreArm: compass",))
    flight.at(0.1, **PARKED)
    assert flight.reason == "PreArm: compass"


# --- the end of a step ---


def test_a_hold_lasts_as_long_as_planned_without_its_pauses() -> None:
    """30 s from its start; time in which the mission was paused does not count."""
    held = STEPS[HOLD - 1]
    assert isinstance(held, HoldStep)
    flight = Flight(HOLD)
    progress = flight.progress
    progress.started_s, progress.paused_s = NOW - held.duration_s - 0.9, 1.0
    flight.at()
    assert not progress.done
    flight.at(0.15)
    assert progress.done


def test_a_shape_is_done_when_it_has_stood_for_its_settling_time() -> None:
    """All agents in their slots: done after `settle_s`, not before."""
    assert not Flight(FORM).through(FORMING.settle_s - 0.1)
    assert Flight(FORM).through(FORMING.settle_s + 0.1)


def test_late_states_neither_count_for_settling_nor_undo_it() -> None:
    """While a peer's state is late the shape is not judged: settling takes longer by that time."""
    flight = Flight(FORM)
    flight.through(1.0)
    for k in range(20):
        flight.at(1.05 + 0.05 * k, peer(2, 0.9, step=FORM), peer(3, step=FORM))
    flight.at(2.1)
    assert not flight.progress.done
    flight.at(3.15)
    assert flight.progress.done


def test_a_peer_out_of_its_slot_starts_settling_anew() -> None:
    """Half a second out of the shape costs the time that it had stood for."""
    flight = Flight(FORM)
    flight.through(1.5)
    away = peer(2, step=FORM, position_ned_m=(5.0, 10.0, -HEIGHT_M), stop_point_m=(5.0, 10.0))
    for k in range(10):
        flight.at(1.55 + 0.05 * k, away, peer(3, step=FORM))
    flight.at(2.6)
    flight.at(4.4)
    assert not flight.progress.done
    flight.at(4.8)
    assert flight.progress.done


@pytest.mark.parametrize("policy", [Policy.CONTINUE, Policy.LAND])
def test_a_late_step_ends_only_where_the_mission_goes_on(policy: Policy) -> None:
    """`on_timeout: continue` ends the step as timed out; any other policy is a failsafe's work."""
    shape = replace(FORMING, on_timeout=policy)
    steps = (STEPS[0], shape, *STEPS[2:], steps_of(plan())[-1])
    flight = Flight(FORM, plan(steps=steps))
    away = peer(2, step=FORM, position_ned_m=(9.0, 10.0, -HEIGHT_M), stop_point_m=(9.0, 10.0))
    flight.at(FORMING.timeout_s + 0.1, away, peer(3, step=FORM))
    result = flight.progress.results[-1].result
    assert flight.progress.done is (policy is Policy.CONTINUE)
    assert (result is StepOutcome.TIMEOUT) is (policy is Policy.CONTINUE)


# --- an order in place of the step ---


def test_an_override_neither_ends_nor_judges_the_mission_step() -> None:
    """While an order is flown, the mission's hold does not end."""
    flight = Flight(HOLD)
    flight.progress.started_s = NOW - 1000.0
    hold = HoldStep(math.inf, math.inf)
    flight.orders.override = Override(CommandKind.HOLD, hold, 7, 0)
    assert isinstance(flight.at(), FlyGoal)
    assert not flight.progress.done
    assert flight.orders.tag == 7
    assert CommandKind.HOLD in flight.reason


def test_without_a_fresh_position_the_setpoint_is_zero() -> None:
    """No law without knowing where one is."""
    goal = Flight(MOVE).at(fix=None)
    assert isinstance(goal, FlyGoal)
    assert goal.velocity_ned_mps == (0.0, 0.0, 0.0)
