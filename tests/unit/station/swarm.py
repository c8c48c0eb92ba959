"""Messages of a swarm, made by hand: six agents, Table II's starts, on their way into a hexagon."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

from swarm_ctl.core.law.graph import neighbours
from swarm_ctl.core.model.messages import (
    AgentState,
    AgentStatus,
    Echo,
    LinkReport,
    Outcome,
    PairReport,
    Phase,
    SigmaReport,
    StepOutcome,
    StepResult,
    TickReport,
    VehicleLinkReport,
)
from swarm_ctl.core.model.plan import (
    EVERYONE,
    AgentPlan,
    Compensation,
    Geodetic,
    GroupPlan,
    LawParameters,
    Limits,
    Plan,
    Policies,
    Response,
    Safety,
    ShapePlan,
)
from swarm_ctl.core.model.route import Routes
from swarm_ctl.core.model.steps.form import FormStep
from swarm_ctl.core.model.steps.hold import HoldStep
from swarm_ctl.core.model.steps.land import LandStep
from swarm_ctl.core.model.steps.takeoff import TakeoffStep
from swarm_ctl.core.swarm.gain_update import planned
from swarm_ctl.station.picture.model import Model
from tests.unit.plans import groups_mission

TABLE_II = {
    1: (14.0, 16.0),
    2: (12.0, 12.0),
    3: (10.0, 18.0),
    4: (6.0, 12.0),
    5: (6.0, 16.0),
    6: (14.0, 10.0),
}
HEXAGON = tuple(
    (2 * math.cos(math.radians(60 * k)), 2 * math.sin(math.radians(60 * k))) for k in range(6)
)
FORM = 2
"""The number of the form step."""


def hexagon_plan(count: int = 6) -> Plan:
    """Six agents at Table II, or any other number in a row 3 units apart."""
    starts = TABLE_II if count == 6 else {i: (3.0 * i, 0.0) for i in range(1, count + 1)}
    slots = HEXAGON if count == 6 else tuple((0.0, 2.0 * i) for i in range(count))
    graph = neighbours(starts, 4.5)
    agents = tuple(AgentPlan(i, start, graph[i]) for i, start in starts.items())
    steps = (
        TakeoffStep(10.0, 60.0),
        FormStep("hexagon", slots, 0.5, 5.0, 120.0),
        HoldStep(10.0, 60.0),
        LandStep(90.0),
    )
    return Plan(
        name="hexagon",
        origin=Geodetic(-35.36, 149.16, 584.0),
        unit_m=5.0,
        tick_s=0.05,
        kappa=20.0,
        law=LawParameters(h=0.05),
        compensation=Compensation.STOP_POINT,
        response=Response(),
        limits=Limits(),
        policies=Policies(agent_lost_after_s=3.0),
        prepare_timeout_s=60.0,
        groups=(GroupPlan(EVERYONE, agents, steps),),
        shapes=(ShapePlan("hexagon", slots),),
        fence=None,
        safety=Safety(),
        zones=(),
    )


def state_of(plan: Plan, agent: int, time_s: float, seq: int = 1, **changes: object) -> AgentState:
    """A state at the agent's start, flying the form step at 10 m."""
    north, east = plan.agent(agent).start
    made = AgentState(
        agent=agent,
        seq=seq,
        time_s=time_s,
        plan_hash=plan.hash(),
        phase=Phase.FLY,
        step=FORM,
        done=False,
        airborne=True,
        position_ned_m=(north * plan.unit_m, east * plan.unit_m, -10.0),
        velocity_ned_mps=(0.6, -0.8, 0.0),
        stop_point_m=(north * plan.unit_m, east * plan.unit_m),
        setpoint_mps=(0.0, 0.0),
    )
    return replace(made, **changes)  # type: ignore[arg-type]


def status_of(plan: Plan, agent: int, time_s: float, **changes: object) -> AgentStatus:
    """A status that fits to `state_of`."""
    made = AgentStatus(
        agent=agent,
        time_s=time_s,
        phase=Phase.FLY,
        step=FORM,
        done=False,
        reason="",
        outcome=Outcome.RUNNING,
        mode="GUIDED",
        armed=True,
        airborne=True,
        battery_percent=87.0,
        height_m=10.0,
        formation_error_m=3.2,
        nearest_agent=None,
        nearest_m=None,
        heartbeat_age_s=0.4,
        station_age_s=0.3,
        setpoints=200,
        setpoint_rate_hz=20.0,
        neighbours=plan.agent(agent).neighbours,
        sigma_tally={"paper": 5, "narrow": 1, "inactive": 2, "overspeed": 0},
        overspeed_ticks=0,
        links={p.id: LinkReport(0.04, 0.03, 0.06, 400, 1) for p in plan.agents if p.id != agent},
        steps=(
            StepResult("prepare", StepOutcome.DONE, 0.0, 6.0),
            StepResult("takeoff", StepOutcome.DONE, 6.0, 22.0),
            StepResult("form hexagon", StepOutcome.RUNNING, 22.0, None),
        ),
        tick=TickReport(500, 0, 0.2, 1.3, 4.0, 0.6, 1.1),
        vehicle_link=VehicleLinkReport(990, 10, 0.05),
        echo=Echo("station-1", time_s - 0.3, 0.2),
        gains=planned(plan),
    )
    return replace(made, **changes)  # type: ignore[arg-type]


def report_of(peer: int, distance: float, status: str = "paper", **changes: object) -> PairReport:
    """A pair report whose figures keep the law's bounds."""
    made = PairReport(peer, True, status, distance, 0.36, 0.26, 2.12, 2.92, 2.52, 0.41)
    return replace(made, **changes)  # type: ignore[arg-type]


def grouped_model(
    told: Mapping[int, tuple[int, bool]], now_s: float = 60.0, **changes: object
) -> Model:
    """The ready mission `groups`: the (step, done) of each agent, as all tell them at `now_s`. The
    agent that is done has been so for as many seconds as its id; `changes` are of all states."""
    plan = groups_mission().plan
    model = Model(plan, station="station-1")
    for agent, (step, done) in told.items():
        model.fold(state_of(plan, agent, now_s, step=step, done=done, **changes), now_s)
        names = Routes(plan).of[agent]
        steps = [
            StepResult(names.step_name(k), StepOutcome.DONE, 5.0 * k, 5.0 * k + 4.0)
            for k in range(step)
        ]
        how, end_s = (StepOutcome.DONE, now_s - agent) if done else (StepOutcome.RUNNING, None)
        steps.append(StepResult(names.step_name(step), how, 5.0 * step, end_s))
        status = status_of(plan, agent, now_s, step=step, done=done, steps=tuple(steps))
        model.fold(status, now_s)
    return model


def flying_model(plan: Plan, now_s: float = 30.0, states: int = 200) -> Model:
    """So many of all agents' states at 20 Hz until `now_s`, a status each, one pair in the
    avoidance region."""
    model = Model(plan, speedup=5.0, station="station-1")
    for k in range(states):
        sent = now_s - 0.03 - 0.05 * (states - 1 - k)
        for agent in plan.agents:
            model.fold(state_of(plan, agent.id, sent, seq=1000 + k), sent + 0.01)
    for agent in plan.agents:
        model.fold(status_of(plan, agent.id, now_s - 0.2), now_s - 0.19)
    model.fold(
        SigmaReport(2, now_s - 0.1, (0.01, 0.02), (0.0, -0.05), (report_of(6, 1.31),)), now_s - 0.1
    )
    model.fold(
        SigmaReport(
            6, now_s - 0.1, (0.1, 0.1), (-0.3, 0.1), (report_of(2, 1.33, "narrow", sigma=0.52),)
        ),
        now_s - 0.1,
    )
    return model
