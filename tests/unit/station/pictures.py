"""Moments of a flight worth looking at."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from typing import Final

from swarm_ctl.core.model.causes import Cause, FailsafeAction
from swarm_ctl.core.model.messages import NO_EXCHANGE, Ack, Command, Event, Phase
from swarm_ctl.core.model.targets import TargetPlan
from swarm_ctl.station.picture.model import Model
from swarm_ctl.station.picture.view import SwarmView, TargetView
from tests.unit.plans import REST, SCOUTS, SWEEPERS, groups_mission
from tests.unit.station.swarm import flying_model, grouped_model, hexagon_plan, state_of, status_of

PLAN: Final = hexagon_plan()


@cache
def waiting() -> SwarmView:
    """Five agents wait for their vehicles, one has not been heard yet."""
    model = Model(PLAN)
    for agent in (1, 2, 3, 4, 5):
        reason = "PreArm: GPS 1: Bad fix" if agent < 5 else "no heartbeat yet"
        phase = Phase.PREPARE if agent < 5 else Phase.CONNECT
        mode = "STABILIZE" if agent < 5 else ""
        told = status_of(
            PLAN,
            agent,
            2.0,
            phase=phase,
            step=0,
            mode=mode,
            reason=reason,
            armed=False,
            airborne=False,
        )
        model.fold(told, 2.05)
    return model.view(2.1)


@cache
def well() -> SwarmView:
    """On the way into the hexagon, one pair in the avoidance region."""
    model = flying_model(PLAN)
    for agent in PLAN.agents:
        model.fold(Event(agent.id, 22.0, "info", "step 2: form hexagon"), 22.0)
    model.fold(Event(3, 24.0, "warning", "vehicle: EKF variance high"), 24.1)
    return model.view(30.0)


@cache
def lost() -> SwarmView:
    """Agent 3 has fallen silent, the others brake to land; the operator commands to land."""
    model = flying_model(PLAN)
    for agent in (1, 2, 4, 5, 6):
        for k in range(80):
            told = state_of(PLAN, agent, 30.0 + 0.05 * k, seq=1200 + k, phase=Phase.HOLD)
            model.fold(told, 30.01 + 0.05 * k)
        reason = "agent 3 has not been heard for 3 s"
        lands = {"action": FailsafeAction.LAND, "cause": Cause.PEER, "reason": reason}
        status = status_of(PLAN, agent, 33.9, phase=Phase.HOLD, station_age_s=3.1, **lands)
        model.fold(status, 33.9)
        model.fold(Event(agent, 33.0, "error", f"land: {reason}"), 33.1)
    model.fold(Command("c1", "land", (), 33.5), 33.5)
    for agent in (1, 2, 4, 5):
        model.fold(Ack(agent, "c1", True, ""), 33.6)
    model.fold(Ack(6, "c1", False, "agent 6 no longer flies its vehicle"), 33.6)
    return model.view(34.0)


@cache
def following() -> SwarmView:
    """In three layers about a boat; of a van nothing is heard any more."""
    model = flying_model(PLAN)
    for agent in PLAN.agents:
        height_m = 6.0 + 7.0 * (agent.id % 3)
        north, east = agent.start[0] * PLAN.unit_m, agent.start[1] * PLAN.unit_m
        place = {"position_ned_m": (north, east, -height_m - 0.2), "goal_height_m": height_m}
        model.fold(state_of(PLAN, agent.id, 30.0, seq=1200, **place), 30.0)
    boat = TargetView("boat", (52.0, 68.0), 0.4, "boat.1", up_m=0.3, off_m=1.24)
    van = TargetView("van", (34.0, 52.0), 6.2, "van.1", fresh=False)
    plan = replace(PLAN, targets=(TargetPlan("boat"), TargetPlan("van"), TargetPlan("car")))
    return replace(model.view(30.0), plan=plan, targets=(boat, van))


@cache
def groups() -> SwarmView:
    """The scouts wait at the ridge for the sweepers, who come; the rest wait for all."""
    told = {**dict.fromkeys(SCOUTS, (5, True)), **dict.fromkeys(SWEEPERS, (4, False))}
    told |= dict.fromkeys(REST, (3, True))
    model = grouped_model(told, 50.0)
    plan, turn = groups_mission().plan, replace(NO_EXCHANGE, role=-1)
    for agent, (step, done) in told.items():
        group = plan.group_of(agent, step)
        k, place = step - group.before, group.ids.index(agent)
        ways = zip(
            *(f.places_m() for f in group.formations(plan.unit_m)[k - 1 : k + 1]), strict=True
        )
        (north, east), (to_north, to_east) = [*ways][place]
        for j in range(200):
            share = 1.0 if done else 0.003 * j
            at = north + share * (to_north - north), east + share * (to_east - east), -10.0
            told_at = 50.0 + 0.05 * j
            state = {"step": step, "done": done, "position_ned_m": at, "exchange": turn}
            model.fold(state_of(plan, agent, told_at, 2 + j, **state), told_at)
    for agent in (*SCOUTS, *SWEEPERS):
        model.fold(Event(agent, 22.0, "info", "step 4: move"), 22.0)
    return model.view(59.9)


@cache
def ended() -> SwarmView:
    """All down."""
    model = flying_model(PLAN)
    for agent in PLAN.agents:
        down = {"phase": Phase.ENDED, "step": 4, "done": True, "airborne": False}
        model.fold(state_of(PLAN, agent.id, 90.0, seq=2400, **down), 90.0)
        model.fold(
            status_of(PLAN, agent.id, 90.0, outcome="completed", mode="LAND", armed=False, **down),
            90.0,
        )
    return model.view(95.0)


@cache
def crowd() -> SwarmView:
    """32 agents, more than the screen has lines."""
    return flying_model(hexagon_plan(32)).view(30.0)


PICTURES: Final[dict[str, Callable[[], SwarmView]]] = {
    "waiting": waiting,
    "well": well,
    "lost": lost,
    "following": following,
    "groups": groups,
    "ended": ended,
    "crowd": crowd,
}
