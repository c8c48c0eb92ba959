"""From where an agent is in its mission to the tick's goal: each step, its end, and its time."""

import math
from dataclasses import replace
from typing import Any

import pytest

from swarm_ctl.core.agent.command_handler import CommandHandler
from swarm_ctl.core.agent.step_executor import StepExecutor
from swarm_ctl.core.model.messages import StepOutcome
from swarm_ctl.core.model.plan import Plan, Policy
from swarm_ctl.core.model.vehicle import AirborneGoal, Goal
from tests.unit.core.builders import (
    FORM,
    FORMING,
    HEIGHT_M,
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


# --- prepare ---


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


# --- the end of a step ---


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
