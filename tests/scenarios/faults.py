"""What goes wrong, as rows, each with the checks that it must pass; the same seed gives the same
trace.

A row is a mission, what is wrong from the start (mesh, clocks, vehicles), and what happens when.
Times of happenings count from the first tick of the form step, where the agents cross each other's
ways.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass, field, replace

from swarm_ctl.core.model.messages import AgentState
from swarm_ctl.core.model.plan import Policy
from swarm_ctl.mesh.impaired import ImpairedTransport, Impairment
from swarm_ctl.mesh.transport import Transport
from swarm_ctl.mission.compile.loader import LoadedMission, loads
from tests.scenarios.swarm import VirtualSwarm, flown_once, landing_fast

IDS = (1, 2, 3, 4)
LIE_M = 3.0


TEXT = """\
version: 1
name: swap
origin: {{lat_deg: -35.36, lon_deg: 149.16, alt_m: 584}}
unit_m: 1
law: {{r: 30, r_out: 7, r_in: 2.5, kappa: {rate_hz}}}
tick_s: {tick_s}
agents:
  - {{id: 1, start: [0, 0]}}
  - {{id: 2, start: [0, 14]}}
  - {{id: 3, start: [14, 0]}}
  - {{id: 4, start: [14, 14]}}
shapes:
  swapped: {{kind: offsets, offsets: [[14, 14], [14, 0], [0, 14], [0, 0]]}}
policies: {{agent_lost: {policy}}}
steps:
  - takeoff: {{height_m: 5}}
  - form: {{shape: swapped, slots: fixed, settle_s: 2, timeout_s: {form_s}}}
  - hold: {{duration_s: 1}}
  - move: {{to: [12, 9], speed_mps: 2}}
  - land
"""
FORM = 2


@functools.cache
def mission(policy: str = "land", form_s: int = 60, rate_hz: int = 20) -> LoadedMission:
    """Four on a square all change to the opposite corner, through each other's midst; then they fly
    a bit."""
    return loads(TEXT.format(policy=policy, form_s=form_s, rate_hz=rate_hz, tick_s=1.0 / rate_hz))


class Faulty:
    """A swarm with what can be done to it."""

    def __init__(self, row: Row, seed: int) -> None:
        self.row = row
        self.transports: dict[int, ImpairedTransport] = {}
        self._seed = seed
        flown = mission(row.policy, row.form_s, row.rate_hz)
        self.swarm = landing_fast(VirtualSwarm(flown, seed, mesh=self._wrap, clocks=row.clocks))
        for vehicle in self.swarm.hub.world.vehicles:
            for name, value in row.vehicles.items():
                vehicle.firmware.parameters.set(name, value)

    def _wrap(self, transport: Transport, agent: int) -> Transport:
        wrapped = ImpairedTransport(
            transport, [*IDS, "station"], self.row.mesh, self._now_s, self._seed * 100 + agent
        )
        self.transports[agent] = wrapped
        return wrapped

    def _now_s(self) -> float:
        return self.swarm.now

    def form(self) -> None:
        """Up to the form step's begin."""
        self.swarm.wait(
            lambda s: any(
                m.status is not None and m.status.step >= FORM for m in s.members.values()
            ),
            60,
        )

    def fly_on(self) -> None:
        """From there to the end, with all that happens."""
        swarm = self.swarm
        begun = swarm.now
        for at_s, happening in self.row.happenings:
            while swarm.now < begun + at_s:
                swarm.tick()
            happening(self)
        swarm.fly(begun + self.row.within_s)
        while not swarm.all_down and swarm.now < begun + self.row.within_s:
            swarm.tick()  # a vehicle left alone comes down by itself

    def fly(self) -> None:
        """From the start to the end."""
        self.form()
        self.fly_on()

    def trace(self) -> object:
        """Everything that a run of the same seed has to repeat, to the last bit."""
        swarm = self.swarm
        places = swarm.hub.world.positions().tobytes()
        return (
            swarm.now,
            swarm.minimum,
            swarm.events,
            places,
            [m.goals for m in swarm.members.values()],
        )


@flown_once
def _formed(policy: str, rate_hz: int, seed: int) -> Faulty:
    """What all rows share that begin well."""
    faulty = Faulty(Row("", (), policy=policy, rate_hz=rate_hz), seed)
    faulty.form()
    return faulty


def flown(row: Row, seed: int) -> Faulty:
    """The row's whole flight."""
    if row.mesh == Impairment() and not row.clocks and not row.vehicles:
        faulty = _formed(row.policy, row.rate_hz, seed)
        faulty.row = row
    else:
        faulty = Faulty(row, seed)
        faulty.form()
    faulty.fly_on()
    return faulty


Happening = tuple[float, Callable[[Faulty], None]]
Check = Callable[[Faulty], str]
"""What is wrong, or ''."""


# --- what happens ---


def ahead(offset_s: float, drift: float = 0.0) -> Callable[[float], float]:
    """A clock that is so far ahead, and gains so much a second."""
    return lambda now: now * (1.0 + drift) + offset_s


def parted(faulty: Faulty) -> None:
    """1 and 2 no longer hear 3 and 4, nor they them; the station stays with 1 and 2 and is heard by
    all."""
    for agent, transport in faulty.transports.items():
        transport.silent |= {str(other) for other in IDS if (other <= 2) != (agent <= 2)}


def deaf(agent: int) -> Callable[[Faulty], None]:
    """`agent` hears no peer, but is heard."""
    return lambda faulty: faulty.transports[agent].silent.update(map(str, IDS))


def alone(agent: int) -> Callable[[Faulty], None]:
    """`agent` has lost the mesh, the station included."""

    def cut(faulty: Faulty) -> None:
        for i, transport in faulty.transports.items():
            transport.silent |= {*map(str, IDS), "station"} if i == agent else {str(agent)}

    return cut


def stalled(faulty: Faulty) -> None:
    """No agent hears a peer; all hear the station."""
    for transport in faulty.transports.values():
        transport.silent.update(map(str, IDS))


def healed(faulty: Faulty) -> None:
    """All agents hear each other."""
    for transport in faulty.transports.values():
        transport.silent.clear()


def frozen(agent: int, stops: bool = True) -> Callable[[Faulty], None]:
    """Its loop stalls (SIGSTOP), or goes on (SIGCONT)."""
    return lambda faulty: setattr(faulty.swarm.members[agent], "frozen", stops)


def clock(agent: int, jump_s: float) -> Callable[[Faulty], None]:
    """Its clock is set ahead, or back."""
    return lambda faulty: setattr(faulty.swarm.members[agent], "clock", ahead(jump_s))


def dead(agent: int) -> Callable[[Faulty], None]:
    """SIGKILL."""
    return lambda faulty: faulty.swarm.kill(agent)


def lies(agent: int) -> Callable[[Faulty], None]:
    """It tells that it is `LIE_M` further north than it is."""

    def moved(state: AgentState) -> AgentState:
        (n, e, d), (stop_n, stop_e) = state.position_ned_m, state.stop_point_m
        return replace(
            state, position_ned_m=(n + LIE_M, e, d), stop_point_m=(stop_n + LIE_M, stop_e)
        )

    return lambda faulty: setattr(faulty.swarm.members[agent], "tampered", moved)


def vehicle(agent: int, **parameters: float) -> Callable[[Faulty], None]:
    """SIM_* parameters of one vehicle, from then on."""

    def change(faulty: Faulty) -> None:
        for name, value in parameters.items():
            faulty.swarm.hub.world.vehicles[agent - 1].firmware.parameters.set(name, value)

    return change


# --- what is checked ---


def apart(faulty: Faulty) -> str:
    """No two vehicles were under r_in, by the truth."""
    swarm = faulty.swarm
    r_in = swarm.plan.law.r_in * swarm.plan.unit_m
    return "" if swarm.closest_m > r_in else f"{swarm.closest_m:.2f} m apart, r_in is {r_in:g} m"


def down(faulty: Faulty) -> str:
    """In the end all vehicles stand disarmed on the ground."""
    return "" if faulty.swarm.all_down else "not all are down"


def ended(faulty: Faulty) -> str:
    """Every live agent has ended within the row's time."""
    left = [i for i, m in faulty.swarm.members.items() if m.alive and not m.frozen]
    return f"agents {left} have not ended" if left else ""


def outcome(*allowed: str, of: tuple[int, ...] = IDS) -> Check:
    """How the agents end."""

    def check(faulty: Faulty) -> str:
        found = faulty.swarm.outcomes()
        wrong = {i: found.get(i) for i in of if found.get(i) not in allowed}
        return f"{wrong}, allowed: {allowed}" if wrong else ""

    return check


def says(*texts: str) -> Check:
    """The events name the cause."""

    def check(faulty: Faulty) -> str:
        said = "\n".join(event.text for event in faulty.swarm.events)
        return "; ".join(f"no agent says {text!r}" for text in texts if text not in said)

    return check


SAFE: tuple[Check, ...] = (apart, down, ended)
GOOD: tuple[Check, ...] = (*SAFE, outcome("completed"))


@dataclass(frozen=True)
class Row:
    """One thing that goes wrong, and what must come of it."""

    name: str
    checks: tuple[Check, ...]
    mesh: Impairment = field(default_factory=Impairment)
    clocks: dict[int, Callable[[float], float]] = field(default_factory=dict)
    vehicles: dict[str, float] = field(default_factory=dict)
    happenings: tuple[Happening, ...] = ()
    policy: str = Policy.LAND.value
    form_s: int = 60
    """What the form step may take."""
    within_s: float = 240.0
    rate_hz: int = 20
    """Of ticks, and of the law."""
    falls: bool = False
    """Out of the sky: no agent steers that, so where it comes down in gusts, 4 m under the others,
    proves nothing."""

    def __str__(self) -> str:
        return self.name


LOST = "agent {} has not been heard for 5 s"
DRAWN = "kept inside the fence, drawn there by the place that agent {} tells"
GUSTY = {"SIM_WIND_SPD": 5.0, "SIM_WIND_DIR": 70.0, "SIM_WIND_GUST": 2.0}

_SPURT: tuple[Happening, ...] = ((0.0, stalled), (0.8, healed))

ROWS = (
    Row("a tenth is lost", GOOD, Impairment(loss=0.1)),
    Row("half is lost", GOOD, Impairment(loss=0.5)),
    Row("0.2 s late", GOOD, Impairment(delay_s=0.2)),
    Row("0.1 to 0.5 s late, out of order", GOOD, Impairment(delay_s=0.1, jitter_s=0.4)),
    # never younger than FRESH_S: the shape cannot be judged, so the step's time runs out
    Row(
        "0.5 s late",
        (*SAFE, outcome("failed"), says("timed out")),
        Impairment(delay_s=0.5),
        form_s=30,
    ),
    Row("a third comes twice", GOOD, Impairment(jitter_s=0.2, duplicate=0.33)),
    Row("lost, late, twice", GOOD, Impairment(0.3, 0.05, 0.15, 0.2)),
    Row(
        "parted for 3 s",
        (*GOOD, says("is not heard", "is heard again")),
        happenings=((3, parted), (6, healed)),
    ),
    Row(
        "parted for 8 s",
        (*SAFE, outcome("failed"), says(LOST.format(1), LOST.format(3))),
        happenings=((3, parted), (11, healed)),
    ),
    Row("parted for 8 s, goes on", GOOD, happenings=((3, parted), (11, healed)), policy="continue"),
    # as over TCP that loses packets: everything waits for what was lost
    Row(
        "in spurts",
        GOOD,
        happenings=tuple((1.2 * k + dt, do) for k in range(50) for dt, do in _SPURT),
    ),
    Row(
        "one is deaf", (*SAFE, outcome("failed"), says(LOST.format(1))), happenings=((3, deaf(4)),)
    ),
    Row(
        "one has lost the mesh",
        (*SAFE, outcome("failed"), says(LOST.format(2), "no ground station")),
        happenings=((3, alone(2)),),
    ),
    Row("clocks apart by 0.3 s", GOOD, clocks={1: ahead(0.3), 2: ahead(-0.3)}),
    Row("clocks apart by 0.7 s", GOOD, clocks={1: ahead(-0.7)}),
    Row("clocks apart by seconds", GOOD, clocks={1: ahead(5.0), 3: ahead(-5.0)}),
    Row("clocks apart by an hour", GOOD, clocks={1: ahead(3600.0), 4: ahead(-3600.0)}),
    Row(
        "clocks drift",
        GOOD,
        clocks={1: ahead(0.0, 5e-4), 2: ahead(0.0, 1e-4), 4: ahead(0.0, -4e-4)},
    ),
    Row(
        "clocks apart, drifting; lost, late, twice",
        GOOD,
        Impairment(0.3, 0.05, 0.15, 0.2),
        clocks={1: ahead(3600.0, 1e-4), 2: ahead(-0.3, -1e-4), 3: ahead(-0.7, 2e-4)},
    ),
    Row(
        "clocks apart; 0.2 s late, a fifth is lost",
        GOOD,
        Impairment(0.2, 0.2),
        clocks={1: ahead(0.5), 3: ahead(-9.0)},
    ),
    Row("a clock jumps ahead", GOOD, happenings=((3, clock(2, 2.0)),)),
    Row("a clock jumps back", GOOD, happenings=((3, clock(2, -2.0)),)),
    Row(
        "the clocks of two hosts jump",
        GOOD,
        happenings=(
            *((3, clock(agent, 2.0)) for agent in (1, 2)),
            *((5, clock(agent, -2.0)) for agent in (3, 4)),
        ),
    ),
    Row("GPS jumps by 3 m", GOOD, happenings=((3, vehicle(2, SIM_GPS_JUMP_N=3.0)),)),
    Row(
        "GPS jumps and comes back",
        GOOD,
        happenings=((3, vehicle(2, SIM_GPS_JUMP_E=3.0)), (5, vehicle(2, SIM_GPS_JUMP_E=0.0))),
    ),
    Row("frozen for 2 s", GOOD, happenings=((3, frozen(3)), (5, frozen(3, stops=False)))),
    Row(
        "frozen for 10 s",
        (*SAFE, outcome("failed"), says(LOST.format(3))),
        happenings=((3, frozen(3)), (13, frozen(3, stops=False))),
    ),
    Row(
        "dies",
        (*SAFE, outcome("failed", of=(1, 2, 4)), says(LOST.format(3))),
        happenings=((3, dead(3)),),
    ),
    # the others follow what it says, and it follows the others: the shape never comes to rest, and
    # drifts to the fence
    Row(
        "lies by 3 m", (*SAFE, outcome("failed"), says(DRAWN.format(2))), happenings=((1, lies(2)),)
    ),
    Row(
        "a vehicle restarts in the air",  # and falls; its telemetry is not asked for again
        (*SAFE, outcome("failed"), says("disarmed by a pilot or by its own failsafe")),
        happenings=((3, vehicle(2, SIM_REBOOT=1.0)),),
        falls=True,
    ),
    Row("gusts", GOOD, vehicles=GUSTY),
    Row("gusts, lost, late", GOOD, Impairment(0.2, 0.05, 0.1), vehicles=GUSTY),
    Row("the vehicles' radio loses a fifth", GOOD, vehicles={"SIM_LOSS": 20.0}),
)
