"""Flights among zones on the virtual clock: no vehicle is in one by truth, whatever it is told."""

from __future__ import annotations

import itertools
import math
import random
from typing import Any

import pytest
import yaml

from swarm_ctl.commands.build import AgentNow, SwarmNow, build
from swarm_ctl.commands.parse import parse
from swarm_ctl.commands.send import CommandSender
from swarm_ctl.core.kernel.walls import Edge, faced
from swarm_ctl.core.model.messages import Outcome
from swarm_ctl.core.model.plan import Zone
from swarm_ctl.core.safety.fence import inside
from swarm_ctl.core.safety.surroundings import Surroundings
from swarm_ctl.core.swarm.gain_update import planned
from swarm_ctl.fuzz.invariants.table import broken
from swarm_ctl.mesh import keys
from swarm_ctl.mission.compile.loader import LoadedMission, loads
from swarm_ctl.virtual.scenario import scenario_of
from swarm_ctl.virtual.scenario_flight import fly_scenario
from swarm_ctl.virtual.virtual_swarm import VirtualSwarm
from tests.on_demand import on_demand
from tests.scenarios.swarm import (
    assert_arrives,
    at_half_rate,
    at_step,
    deaf,
    flown_once,
    landing_fast,
)
from tests.unit.plans import steps_of

HEAD = """\
version: 1
name: among-zones
origin: {lat_deg: -35.363262, lon_deg: 149.165237, alt_m: 584}
unit_m: 5
tick_s: 0.1
law: {r: 4.5, r_out: 1.5, r_in: 0.5, kappa: 10}
agents:
  - {id: 1, start: [0, 0]}
  - {id: 2, start: [0, 1.9]}
  - {id: 3, start: [1.9, 0]}
  - {id: 4, start: [1.9, 1.9]}
shapes: {grid: {kind: grid, spacing: 1.9}}
"""
STEPS = """\
steps:
  - takeoff: {height_m: 4}
  - form: {shape: grid, settle_s: 1}
  - move: {to: [24, 1], speed_mps: 4, settle_s: 1}
  - land
"""


def wood(seed: int, count: int = 6, room: float = 3.9) -> dict[str, Any]:
    """Trees between the starts and the goal, in units; apart, so that the formation has a way."""
    dice, trees = random.Random(seed), list[tuple[float, float, float]]()
    while len(trees) < count:
        north, east, r = dice.uniform(6, 19), dice.uniform(-8, 10), dice.uniform(0.1, 0.6)
        if all(math.dist((north, east), (n, e)) > r + q + 2 * room for n, e, q in trees):
            trees.append((north, east, r))
        else:
            room *= 0.999
    return {
        f"tree-{k}": {"circle": [round(n, 2), round(e, 2)], "radius": round(r, 2)}
        for k, (n, e, r) in enumerate(trees)
    }


def gap_m(zone: Zone, north: float, east: float) -> float:
    """From a zone to a place; under 0 inside."""
    corners = [complex(*corner) for corner in zone.corners_m]
    at = complex(north, east)
    if len(corners) == 1:
        return abs(at - corners[0]) - zone.radius_m
    ends = zip(corners, (*corners[1:], corners[0]), strict=True)
    least = min(faced(Edge(a, b, 0.0), at)[1] for a, b in ends)
    return -least if inside(zone.corners_m, (north, east)) else least


def go_on(
    swarm: VirtualSwarm, least: dict[str, float], until_s: float = 240.0, lands: bool = False
) -> None:
    """To the end, or until all land; what is least by zone is the least distance of any vehicle
    from it by truth."""
    while swarm.now < until_s and not all(member.ended for member in swarm.members.values()):
        if lands and swarm.in_step(swarm.plan.last_step):
            return
        swarm.tick()
        for place in swarm.positions().values():
            for zone in swarm.plan.zones:
                least[zone.name] = min(least[zone.name], gap_m(zone, place[0], place[1]))


def assert_clear(mission: LoadedMission, seed: int) -> None:
    """To its end: by truth none is nearer to a zone than its clearance, and no two under r_in."""
    least, swarm = {z.name: math.inf for z in mission.plan.zones}, VirtualSwarm(mission, seed)
    go_on(landing_fast(swarm), least)
    assert min(least.values()) > 1.25, least
    assert set(swarm.outcomes().values()) == {"completed"}
    assert swarm.closest_m > mission.plan.law.r_in * mission.plan.unit_m


@pytest.mark.parametrize("seed", [1, *(on_demand(seed) for seed in range(2, 21))])
def test_a_formation_moves_through_a_drawn_wood(seed: int) -> None:
    """None comes nearer to a tree than its clearance, no two come under r_in, and all arrive."""
    zones = yaml.safe_dump({"zones": wood(seed)}, default_flow_style=None)
    assert_clear(loads(HEAD + zones + STEPS), seed)


@flown_once
def before_the_wood() -> tuple[dict[str, float], VirtualSwarm]:
    """The ready mission through a wood at half the rate, formed. Its one more policy counts where
    an agent is lost."""
    mission = loads(at_half_rate("wood.yaml") + "policies: {agent_lost: continue}\n")
    least, swarm = {z.name: math.inf for z in mission.plan.zones}, VirtualSwarm(mission)
    landing_fast(swarm)
    while not swarm.in_step(3):
        go_on(swarm, least, until_s=swarm.now + mission.plan.tick_s / 2)
    return least, swarm


@flown_once
def in_the_gate() -> tuple[dict[str, float], VirtualSwarm]:
    """With its seventh in the gate's mouth."""
    least, swarm = before_the_wood()
    go_on(swarm, least, until_s=55.0)
    return least, swarm


def test_the_ready_mission_through_a_wood() -> None:
    """In file through the hedge's gate, and together past the pine, clear of all zones. At its own
    rate, to the ground, twenty seeds with real processes: `tests/system/test_lockstep.py`, on
    demand."""
    least, swarm = in_the_gate()
    assert [step.file is not None for step in steps_of(swarm.plan)[2:4]] == [True, False]
    go_on(swarm, least, lands=True)
    kept = {zone.name: zone.clearance_m for zone in swarm.plan.zones}
    del kept["hut"]  # flown over
    assert all(least[name] > clearance_m for name, clearance_m in kept.items()), least
    assert_arrives(swarm)


def test_all_pass_one_that_was_lost_in_the_gate_s_mouth() -> None:
    """Its vehicle has landed beside the way, and nobody knows: they go round it on the side that
    the hedge leaves, at once (at 94 s; where all are passed on one side, at 120 s)."""
    _, swarm = in_the_gate()
    swarm.kill(7)
    swarm.wait(lambda s: s.in_step(4), 105.0)
    assert not swarm.outcomes()


def test_a_formation_that_is_led_out_of_the_fence_stays_inside_of_it() -> None:
    """A frame that a leader tells leads the others against the fence: they stop before it, and no
    policy has to act."""
    fence = "fence: {polygon: [[-20, -20], [12, -20], [12, 20], [-20, 20]]}\n"
    mission = loads(HEAD + fence + STEPS.replace("to: [24, 1]", "to: [9, 1]"))
    edge_m = 60.0
    swarm = landing_fast(VirtualSwarm(mission))
    swarm.wait(lambda s: s.in_step(3))
    for member in swarm.members.values():
        controller, go_on = member.agent._controller, member.agent._controller.form

        def led(*args: Any, go_on: Any = go_on, controller: Any = controller) -> Any:
            controller.gain = 1.0
            return go_on(args[0], args[1], (4.0, 0.0), None)

        setattr(controller, "form", led)  # noqa: B010
    farthest = -math.inf
    for _ in range(250):
        swarm.tick()
        farthest = max(farthest, *(place[0] for place in swarm.positions().values()))
    assert edge_m - 3.0 < farthest < edge_m
    assert not any("geofence" in event.text for event in swarm.events)


def test_a_vehicle_over_a_zone_does_not_land_in_it() -> None:
    """An order to land, given over a house: it leaves that place first, and says so."""
    house = "zones: {house: {polygon: [[3, -4], [11, -4], [11, 6], [3, 6]], ceiling_m: 3}}\n"
    mission = loads(HEAD + house + STEPS.replace("height_m: 4", "height_m: 8"))
    swarm = landing_fast(VirtualSwarm(mission))
    swarm.wait(lambda s: s.in_step(3))
    swarm.wait(lambda s: min(place[0] for place in s.positions().values()) > 23.0)
    swarm.command("land")
    least = math.inf
    (zone,) = mission.plan.zones
    while swarm.now < 240 and not all(member.ended for member in swarm.members.values()):
        swarm.tick()
        for north, east, down in swarm.hub.world.positions():
            if -down < 4.4:
                least = min(least, gap_m(zone, north, east))
    assert least > 1.0
    assert swarm.all_down
    assert any(event.text == "leaves zone house before it lands" for event in swarm.events)


CUT = """\
shapes:
  line: {kind: line, spacing: 1.9}
zones:
  wall: {polygon: [[-1, 4.85], [9, 4.85], [9, 4.95], [-1, 4.95]]}
steps:
  - takeoff: {height_m: 4}
  - form: {shape: line, settle_s: 1, slots: fixed, exchange: false}
  - %s
"""


@pytest.mark.parametrize("last", [on_demand("land"), "return"])
def test_an_agent_whose_line_to_its_place_is_cut_goes_round(last: str) -> None:
    """Agents that start along a wall form a line across it, so that those behind the wall come
    round its end; and they come home again."""
    starts = "".join(f"  - {{id: {k + 1}, start: [{2 * k}, 3]}}\n" for k in range(4))
    head = HEAD[: HEAD.index("agents:")] + "agents:\n" + starts
    assert_clear(loads(head + CUT % last), 1)


def test_a_step_that_a_zone_holds_up_ends_and_names_it() -> None:
    """Nothing waits for ever."""
    mission = loads(HEAD + STEPS.replace("settle_s: 1}\n  - land", "timeout_s: 31}\n  - land"))
    swarm = landing_fast(VirtualSwarm(mission))
    swarm.wait(lambda s: s.in_step(3))
    corners = ((40.0, -400.0), (42.0, -400.0), (42.0, 400.0), (40.0, 400.0))
    wall = Zone("wall", corners, 0.0, 1.25)
    for member in swarm.members.values():
        controller, plan = member.agent._controller, mission.plan
        around = Surroundings([wall], None, plan.response, plan.limits.speed_mps)
        controller.safety_filter._surroundings = around
    swarm.wait(lambda s: all(member.ended for member in s.members.values()))
    reasons = {member.ended.reason for member in swarm.members.values() if member.ended}
    assert any("timed out" in reason and "kept off zone wall" in reason for reason in reasons)
    assert max(place[0] for place in swarm.positions().values()) < 40.0


def ordered(swarm: VirtualSwarm, line: str) -> None:
    """An operator's order."""
    flying = {i: member.agent._controller for i, member in swarm.members.items()}
    now = tuple(
        AgentNow(i, each.stop_point_m, gains=planned(swarm.plan), zones=each.other_zones)
        for i, each in flying.items()
    )
    sender = CommandSender(swarm.send, tuple(swarm.members))
    sent = sender.send(
        build(parse(line, swarm.plan), SwarmNow(swarm.plan, swarm.now, 3, now)), swarm.now
    )
    heard = len(swarm.acks)
    until = swarm.now + 5.0
    while not sent.over and swarm.now < until:
        sender.turn(swarm.now)
        swarm.tick()
        for ack in swarm.acks[heard:]:
            sender.hear(ack)
        heard = len(swarm.acks)
    assert sent.accepted, sent.failed


def test_a_zone_that_is_added_in_flight_is_left() -> None:
    """One over an agent's place: it says so and leaves."""
    mission = loads(HEAD + STEPS.replace("move: {to", "hold: {duration_s: 40}\n  - move: {to"))
    swarm = landing_fast(VirtualSwarm(mission))
    swarm.wait(lambda s: s.in_step(3))
    swarm.run(1.0)
    north, east = swarm.positions()[4]
    ordered(swarm, f"zone add pond circle {north + 0.5} {east + 0.5} 2")
    swarm.run(12.0)
    pond = Zone("pond", ((north + 0.5, east + 0.5),), 2.0, 1.25)
    assert min(gap_m(pond, *place) for place in swarm.positions().values()) > 1.0
    assert any("is in zone pond, and leaves it" in event.text for event in swarm.events)
    statuses = [member.status for member in swarm.members.values()]
    assert all(
        s is not None and s.zones is not None and s.zones[0].name == "pond" for s in statuses
    )
    assert swarm.closest_m > mission.plan.law.r_in * mission.plan.unit_m


@pytest.mark.parametrize("heard_late", [on_demand(False), True])
def test_an_agent_that_is_restarted_takes_up_the_zones_of_its_peers(heard_late: bool) -> None:
    """Killed, started again over the same plan, which has no zone: it keeps out of the one that was
    added in flight, on the way that leads through it, and the operator can lift that again. Also
    where the first words of the peer that tells it are lost."""
    mission = loads(HEAD + STEPS)
    swarm = at_step(mission, 3)
    ordered(swarm, "zone add pond circle 55 5 6")
    swarm.kill(2)
    swarm.run(1.0)
    swarm.restart(2)
    if heard_late:
        end = deaf(swarm, 2, keys.LAW)
        swarm.run(2.0)
        end()
    pond, least = Zone("pond", ((55.0, 5.0),), 6.0, 1.25), math.inf
    swarm.run(1.5)
    status = swarm.members[2].status
    assert status is not None
    assert status.zones is not None
    assert [zone.name for zone in status.zones] == ["pond"]
    assert any(
        event.agent == 2 and event.text == "takes up what agent 1 flies" for event in swarm.events
    )
    swarm.wait(lambda s: max(place[0] for place in s.positions().values()) > 45.0)
    while min(place[0] for place in swarm.positions().values()) < 65.0:
        assert swarm.now < 60.0
        swarm.tick()
        for north, east, down in swarm.hub.world.positions():
            if down < -1.0:
                least = min(least, gap_m(pond, north, east))
    assert least > 1.25
    tags = {member.agent._command_handler.gain_update.tag for member in swarm.members.values()}
    assert len(tags) == 1


def torn_m(swarm: VirtualSwarm) -> float:
    """How far the vehicles are from being a grid, by truth: the change of their distances."""
    at = [complex(n, e) for n, e, _ in swarm.hub.world.positions()]
    sides = (abs(at[0] - at[1]), abs(at[2] - at[3]), abs(at[0] - at[2]), abs(at[1] - at[3]))
    return max(abs(side - 9.5) for side in sides)


@pytest.mark.parametrize("by", ["mission", "order"])
def test_a_move_under_way_goes_round_a_zone_that_is_added(by: str) -> None:
    """All together: the shape stays, none comes near the zone, and the move ends where it was to;
    also a move that an operator has ordered. A zone that is lifted again is flown over."""
    mission = loads(HEAD + STEPS)
    swarm = at_step(mission, 3)
    if by == "order":
        ordered(swarm, "move 110 5 4")
    swarm.run(3.0)
    ordered(swarm, "zone add pond circle 70 6 5")
    swarm.run(2.5)
    ordered(swarm, "zone add well circle 105 30 2")
    pond, least, torn, beside = Zone("pond", ((70.0, 6.0),), 5.0, 1.25), math.inf, 0.0, 0.0
    while max(place[0] for place in swarm.positions().values()) < 100.0:
        assert swarm.now < 120.0
        swarm.tick()
        torn = max(torn, torn_m(swarm))
        for north, east, _ in swarm.hub.world.positions():
            least = min(least, gap_m(pond, north, east))
            beside = max(beside, abs(east - 5.0))
    assert least > 1.25
    assert torn < 1.5
    assert beside > 15.0  # it went round
    assert not any("doubt" in event.text or "off its way" in event.text for event in swarm.events)
    if by == "order":
        swarm.wait(lambda s: min(place[0] for place in s.positions().values()) > 104.0)
        ordered(swarm, "resume")
    assert_arrives(swarm)
    assert swarm.closest_m > 2 * mission.plan.law.r_in * mission.plan.unit_m


def test_a_move_in_file_goes_round_a_zone_that_is_added() -> None:
    """One that lies on its way, with half of the eight behind it: all follow one way round it, also
    one that was killed and started again. Places in it, straight on, held all up before."""
    _, swarm = before_the_wood()
    swarm.wait(lambda s: max(place[0] for place in s.positions().values()) > 40.0)
    ordered(swarm, "zone add pond circle 40 14 8")
    swarm.run(3.0)
    swarm.kill(5)
    swarm.run(1.0)
    swarm.restart(5)
    pond, left = Zone("pond", ((40.0, 14.0),), 8.0, 1.25), dict.fromkeys(range(8), False)
    while min(place[0] for place in swarm.positions().values()) < 54.0:
        assert swarm.now < 130.0
        swarm.tick()
        for k, place in enumerate(swarm.hub.world.positions()):
            left[k] = left[k] or gap_m(pond, *place[:2]) > 1.0
            assert not left[k] or gap_m(pond, *place[:2]) > 0.0
    assert all(left.values())
    assert swarm.closest_m > 2 * swarm.plan.law.r_in * swarm.plan.unit_m


@pytest.mark.parametrize("east", [5.0, on_demand(9.0), on_demand(14.0)])
def test_a_zone_that_is_added_over_a_formation_on_its_way_holds_it_up_for_a_moment(
    east: float,
) -> None:
    """Those who are in it leave it, the others keep off, and all come together again behind it."""
    mission = loads(HEAD + STEPS)
    swarm = at_step(mission, 3)
    swarm.wait(lambda s: max(place[0] for place in s.positions().values()) > 45.0)
    ordered(swarm, f"zone add pond circle 52 {east} 5")
    swarm.wait(lambda s: all(m.agent._controller.other_zones for m in s.members.values()))
    swarm.run(2.0)  # those who come at full speed need this long to stop
    pond, left = Zone("pond", ((52.0, east),), 5.0, 1.25), dict.fromkeys(range(4), False)
    while not swarm.in_step(4):
        assert swarm.now < 100.0
        swarm.tick()
        for k, (north, east_m, down) in enumerate(swarm.hub.world.positions()):
            gap = gap_m(pond, north, east_m)
            left[k] = left[k] or gap > 1.0
            assert not left[k] or gap > 0.0 or down > -0.5
    assert_arrives(swarm)


def test_a_zone_that_is_lifted_is_flown_over_again() -> None:
    """The mission's own way, which leads round it, is not: a zone of the operator's."""
    mission = loads(HEAD + STEPS)
    swarm = at_step(mission, 3)
    ordered(swarm, "zone add pond circle 60 6 5")
    swarm.run(4.0)
    ordered(swarm, "zone lift pond")
    swarm.wait(lambda s: max(place[0] for place in s.positions().values()) > 62.0)
    middle = sum(east for _, east, _ in swarm.hub.world.positions()) / 4
    assert abs(middle - 5.0) < 5.0
    assert_arrives(swarm)


HOME = """\
version: 1
name: home
mission:
  version: 1
  name: home
  origin: {lat_deg: 47.4, lon_deg: 8.55, alt_m: 450.0}
  unit_m: 3.0
  law: {r: 4.5, r_out: 1.5, r_in: 0.48}
  tick_s: 0.1
  agents:
    - {id: 1, start: [1.29, 2.31]}
    - {id: 2, start: [1.29, 4.33]}
    - {id: 3, start: [3.31, 2.31]}
  shapes:
    one: {kind: line, spacing: 2.34}
  steps:
    - takeoff: {height_m: 4.7}
    - form: {settle_s: 0.6, shape: one}
    - hold: {duration_s: 1.0}
    - return: {}
seed: 860177
happens:
  - {at_s: 26.9, order: zone add pond circle 11.3 4.1 3.4 ceiling=5.3}
"""


def test_a_zone_that_is_added_over_a_home_is_not_landed_in() -> None:
    """As agent 3 comes over its own start: the plan's own zones hold none, so nobody looked."""
    flown = fly_scenario(*scenario_of(HOME))
    assert flown.summary.outcome is Outcome.COMPLETED
    assert any("leaves zone pond before it lands" in event.text for event in flown.events)
    assert broken(flown) == []


def test_no_zone_is_added_over_a_vehicle_that_stands() -> None:
    """It would take off inside: the agent refuses, and says what would be allowed; one over which
    it passes is taken."""
    swarm = VirtualSwarm(loads(HEAD + STEPS))
    swarm.run(1.0)
    with pytest.raises(AssertionError, match=r"agent 1 would take off in zone shed; allowed: a zo"):
        ordered(swarm, "zone add shed circle 1 0 4")
    swarm.run(2.0)
    ordered(swarm, "zone add cloud circle 1 0 4 floor=40")
    swarm.run(2.0)
    zones = [member.agent._controller.zones for member in swarm.members.values()]
    assert [[zone.name for zone in each] for each in zones] == [["cloud"]] * 4


def test_a_return_that_a_zone_holds_up_names_it() -> None:
    """A wall across the fence comes between the agents and their starts: they say at once that
    they have no way, and the time-out says it again."""
    fence = "fence: {polygon: [[-8, -14], [30, -14], [30, 18], [-8, 18]], height_m: 40}\n"
    steps = STEPS.replace("- land", "- hold: {duration_s: 5}\n  - return: {timeout_s: 25}")
    steps = steps.replace("[24, 1]", "[15, 1]")
    swarm = landing_fast(VirtualSwarm(loads(HEAD + fence + steps)))
    swarm.wait(lambda s: s.in_step(4))
    ordered(swarm, "zone add r polygon 40 -90 42 -90 42 110 40 110")
    swarm.wait(lambda s: s.in_step(5))
    begun_s = swarm.now
    swarm.wait(lambda s: all(member.ended for member in s.members.values()))
    said = [event for event in swarm.events if event.text == "has no way past zone r"]
    assert sorted(event.agent for event in said) == [1, 2, 3, 4]
    assert max(event.time_s for event in said) < begun_s + 15.0
    reasons = {member.ended.reason for member in swarm.members.values() if member.ended}
    assert any("timed out after 25 s" in why and "no way past zone r" in why for why in reasons)


@pytest.mark.parametrize("by", ["mission", on_demand("order")])
def test_who_starts_in_a_zone_that_was_added_lands_beside_it(by: str) -> None:
    """Two of four: each says so as its return begins, and comes down where the zone lets it come no
    nearer, apart from the other. It hovered there for minutes before."""
    steps = STEPS.replace("[24, 1]", "[8, 1]")
    steps = steps.replace("- land", "- hold: {duration_s: 9}\n  - return")
    swarm = at_step(loads(HEAD + steps), 4)
    ordered(swarm, "zone add shed circle 5 10 7")
    if by == "order":
        swarm.command("return")
    swarm.wait(lambda s: all(member.ended for member in s.members.values()), 150)
    said = "return: its start lies in zone shed: it lands beside it"
    assert {event.agent for event in swarm.events if event.text == said} == {2, 4}
    places, shed = swarm.hub.world.positions(), Zone("shed", ((5.0, 10.0),), 7.0, 1.25)
    assert min(gap_m(shed, north, east) for north, east, _ in places[1::2]) > 1.25
    for k, start in ((0, (0.0, 0.0)), (2, (9.5, 0.0))):
        assert math.dist(places[k][:2], start) < 1.0
    apart_m = min(math.dist(a[:2], b[:2]) for a, b in itertools.combinations(places, 2))
    assert apart_m > swarm.plan.law.r_in * swarm.plan.unit_m
    ends = {i: str(m.ended.reason) for i, m in swarm.members.items() if m.ended}
    assert all(ends[i].endswith("its start lies in zone shed, so it lands here") for i in (2, 4))
