"""Small builders for the inputs of core's pure parts: a plan, a vehicle view, a state, a tick.

By default three agents fly their mission's hold step, agent 1 is the own one, it is healthy, and
all is well. A test names what differs. The unit is 2 m, so that a mistaken unit shows.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import replace
from typing import Any, Final

from swarm_ctl.core.agent.group import Group
from swarm_ctl.core.agent.interruption import EventLog, Interruption
from swarm_ctl.core.agent.landing import Landing
from swarm_ctl.core.agent.own_vehicle import OwnVehicle
from swarm_ctl.core.agent.preflight import Preflight
from swarm_ctl.core.agent.progress import Progress
from swarm_ctl.core.agent.return_to_launch import ReturnToLaunch
from swarm_ctl.core.agent.steering import Intent, Steering
from swarm_ctl.core.agent.takeover import Takeover
from swarm_ctl.core.agent.tick import Tick
from swarm_ctl.core.control.controller import Controller
from swarm_ctl.core.control.navigation import Navigator, OwnFix
from swarm_ctl.core.model.messages import AgentState, Event, Phase, StationBeacon
from swarm_ctl.core.model.plan import (
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
)
from swarm_ctl.core.model.route import Routes
from swarm_ctl.core.model.steps.form import FormStep
from swarm_ctl.core.model.steps.hold import HoldStep
from swarm_ctl.core.model.steps.land import LandStep
from swarm_ctl.core.model.steps.move import MoveStep
from swarm_ctl.core.model.steps.return_ import ReturnStep
from swarm_ctl.core.model.steps.step import Step
from swarm_ctl.core.model.steps.takeoff import TakeoffStep
from swarm_ctl.core.model.timeouts import FRESH_S, NEIGHBOUR_S
from swarm_ctl.core.model.vehicle import GlobalFix, Goal, LocalFix, VehicleView
from swarm_ctl.core.swarm.peers import Peers
from swarm_ctl.core.swarm.snapshot import OtherAircraft, PeerSnapshot
from tests.unit.plans import with_group

NOW: Final = 1000.0
OWN: Final = 1
UNIT_M: Final = 2.0
HEIGHT_M: Final = 8.0
ORIGIN: Final = Geodetic(47.4, 8.5, 400.0)
SLOTS: Final = ((0.0, 0.0), (0.0, 5.0), (0.0, 10.0))
TAKEOFF, FORM, HOLD, MOVE, LAST = 1, 2, 3, 4, 5
GROUP: Final = "all"

FORMING: Final = FormStep("row", SLOTS, tolerance_m=0.5, settle_s=2.0, timeout_s=60.0)
MOVING: Final = MoveStep(((20.0, 10.0),), 2.0, tolerance_m=0.5, settle_s=2.0, timeout_s=60.0)
STEPS: Final = (TakeoffStep(HEIGHT_M, 60.0), FORMING, HoldStep(30.0, 60.0), MOVING)


def plan(last: Step | None = None, agents: int = 3, **changes: Any) -> Plan:
    """Take-off, form, hold, move, and `last` (landing); each agent's neighbours are all others."""
    ids = range(1, agents + 1)
    flying = tuple(AgentPlan(i, (0.0, 5.0 * (i - 1)), tuple(j for j in ids if j != i)) for i in ids)
    made = Plan(
        name="row",
        origin=ORIGIN,
        unit_m=UNIT_M,
        tick_s=0.05,
        kappa=20.0,
        law=LawParameters(r=10.0, r_out=3.0, r_in=1.0, h=0.05),
        compensation=Compensation.STOP_POINT,
        response=Response(),
        limits=Limits(),
        policies=Policies(),
        prepare_timeout_s=120.0,
        groups=(GroupPlan(GROUP, flying, (*STEPS, last or LandStep(60.0))),),
        shapes=(),
        zones=(),
        fence=None,
        safety=Safety(),
    )
    steps = {"steps": changes.pop("steps")} if "steps" in changes else {}
    return replace(with_group(made, **steps), **changes)


RETURNING: Final = plan(ReturnStep(60.0))


def view(**changes: Any) -> VehicleView:
    """A healthy ArduCopter in GUIDED, in the air over the start of agent 1."""
    local = LocalFix(NOW, (0.0, 0.0, -HEIGHT_M), (0.0, 0.0, 0.0))
    above = replace(ORIGIN, alt_m=ORIGIN.alt_m + HEIGHT_M)
    well = VehicleView(
        heartbeat_s=NOW,
        autopilot="ardupilot",
        armed=True,
        mode="GUIDED",
        controlled=True,
        on_ground=False,
        healthy=True,
        health_reason="",
        released=False,
        battery_percent=80.0,
        tilt_deg=5.0,
        wind_mps=3.0,
        origin=ORIGIN,
        local=local,
        global_=GlobalFix(NOW, above, HEIGHT_M, (0.0, 0.0, 0.0)),
    )
    return replace(well, **changes)


PARKED: Final[dict[str, Any]] = {"armed": False, "on_ground": True, "controlled": False}
"""What `view` says of a vehicle that stands on the ground."""


def fix(
    north: float = 0.0,
    east: float = 0.0,
    *,
    velocity: tuple[float, float, float] = (0.0, 0.0, 0.0),
    age_s: float = 0.1,
    height_m: float = HEIGHT_M,
) -> OwnFix:
    """The own position [m] and velocity [m/s]."""
    return OwnFix(age_s, (north, east, -height_m), velocity, height_m)


def state(agent: int, **changes: Any) -> AgentState:
    """A peer in the hold step, standing over its start."""
    place = (0.0, 5.0 * UNIT_M * (agent - 1))
    told = AgentState(
        agent,
        seq=1,
        time_s=NOW,
        plan_hash=plan().hash(),
        phase=Phase.FLY,
        step=HOLD,
        done=False,
        airborne=True,
        position_ned_m=(*place, -HEIGHT_M),
        velocity_ned_mps=(0.0, 0.0, 0.0),
        stop_point_m=place,
        setpoint_mps=(0.0, 0.0),
    )
    return replace(told, **changes)


def peer(agent: int, age_s: float = 0.1, **changes: Any) -> OtherAircraft:
    """A peer whose state is `age_s` old, and says what it has said for long; infinite: it was never
    heard."""
    if math.isinf(age_s):
        return OtherAircraft(agent)
    told = state(agent, **changes)
    fresh = age_s <= FRESH_S
    return OtherAircraft(
        agent,
        told,
        complex(*told.position_ned_m[:2]),
        complex(*told.stop_point_m),
        complex(*told.setpoint_mps),
        age_s,
        age_s,
        fresh,
        age_s <= NEIGHBOUR_S,
        fresh and told.phase in (Phase.FLY, Phase.HOLD, Phase.RETURN),
        (GROUP, told.step, told.override) if fresh and told.phase is Phase.FLY else None,
        ends=told.phase in (Phase.LAND, Phase.YIELD, Phase.ENDED, Phase.RETURN),
        left=told.left,
        down=told.down,
        held=told.override != 0,
    )


def snapshot(*peers: OtherAircraft, now: float = NOW) -> PeerSnapshot:
    """These peers; without any, the two peers of `plan` as they are by default."""
    return PeerSnapshot(now, peers or (peer(2), peer(3)))


def alone(now: float = NOW) -> PeerSnapshot:
    """No other aircraft."""
    return PeerSnapshot(now, ())


def tick(
    *peers: OtherAircraft,
    now: float = NOW,
    fix: OwnFix | None = fix(),  # noqa: B008 - frozen
    station_age_s: float | None = 0.1,
    plan_hash: int | None = None,
    **seen: Any,
) -> Tick:
    """One tick; `seen` are changes of the vehicle's view."""
    station = None
    if station_age_s is not None:
        told = plan().hash() if plan_hash is None else plan_hash
        station = (StationBeacon("desk", now, told), now - station_age_s)
    seen = {"heartbeat_s": now} | seen
    return Tick(now, view(**seen), fix, snapshot(*peers, now=now), station)


def progress(
    of: Plan, step: int = HOLD, *, done: bool = False, started_s: float = NOW - 10.0
) -> Progress:
    """An agent in this step."""
    made = Progress(Routes(of).of[OWN], of.prepare_timeout_s, started_s)
    if step:
        made.rejoin(step, started_s)
    if done:
        made.finish_step(started_s)
    return made


class Own:
    """The flight of agent 1, which armed its vehicle and controls it: what lasts from tick to tick,
    and the real parts around that. `changes` are the vehicle's."""

    def __init__(self, of: Plan | None = None, step: int = HOLD, **changes: Any) -> None:
        self.plan = of = of or plan()
        self.phase, self.reason = Phase.FLY, ""
        self.log = EventLog(OWN)
        self.vehicle = OwnVehicle(
            **{
                "since_s": NOW - 90.0,
                "known_s": NOW - 90.0,
                "arming_s": NOW - 60.0,
                "was_armed": True,
                "had_control": True,
                "target_height_m": HEIGHT_M,
                "planned_height_m": HEIGHT_M,
                **changes,
            }
        )
        self.group = Group(of, OWN, Peers(of, OWN), NOW - 10.0, self.log)
        self.progress = self.group.progress
        if step:
            self.progress.rejoin(step, NOW - 10.0)
        self.interruption = Interruption(self.vehicle, self.progress, self.log)
        self.controller = Controller(of, OWN, of.response)
        self.steering = Steering(self.controller, self.vehicle, of.limits)
        self.preflight = Preflight(
            of, of.agent(OWN), of.hash(), Navigator(of.origin), False, of.response
        )
        parts = self.vehicle, self.group, self.interruption, self.log
        self.takeover = Takeover(OWN, *parts, self.preflight)
        self.landing = Landing(of, *parts, self.controller, ReturnToLaunch(of, OWN))

    def tick(self, *peers: OtherAircraft, **seen: Any) -> Tick:
        """One tick of this agent; the controller knows where it is."""
        one = replace(tick(*peers, **seen), before=self.phase)
        if one.fix is not None:
            self.controller.locate(one.fix, one.now)
        return one

    def act(self, one: Tick, decision: Intent) -> Goal:
        """The vehicle's goal by this decision."""
        stopped = self.interruption.reason
        self.phase = decision.phase
        self.reason = stopped if decision.reason is None else decision.reason
        return self.steering.fly(one, decision.course)


def texts(events: Iterable[Event]) -> list[str]:
    """What was said."""
    return [event.text for event in events]
