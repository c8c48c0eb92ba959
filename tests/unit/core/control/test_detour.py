"""The way of a move when zones change in flight: one and the same for all agents."""

from __future__ import annotations

from dataclasses import replace

from hypothesis import given
from hypothesis import strategies as st

from swarm_ctl.core.control.detour import Detour
from swarm_ctl.core.model.plan import Zone
from swarm_ctl.core.model.planned_formation import Frame, PlannedFormation
from swarm_ctl.core.model.policies import Policy
from swarm_ctl.core.model.steps.hold import HoldStep
from swarm_ctl.core.model.steps.move import MoveStep
from swarm_ctl.core.safety.among_zones import AmongZones
from tests.unit.core.builders import plan

PLAN = replace(plan(), fence=None)
SLOTS = ((0.0, 0.0), (0.0, 1.9), (1.9, 0.0), (1.9, 1.9))
BEFORE = PlannedFormation(SLOTS, 5.0, (0.0, 0.0), height_m=10.0, formed=True)
MOVE = MoveStep(((100.0, 0.0), (100.0, 200.0)), 4.0, 0.5, 5.0, 100.0, Policy.LAND)
metres = st.floats(-40.0, 240.0)
zones = st.lists(
    st.builds(
        Zone, st.just("z"), st.tuples(st.tuples(metres, metres)), st.floats(1, 8), st.just(1.25)
    ),
    min_size=1,
    max_size=4,
).map(lambda found: tuple(replace(zone, name=f"z{k}") for k, zone in enumerate(found)))
shares = st.floats(0.0, 1.0)


def at(share: float, leg: int) -> Frame:
    """On its way along the planned move."""
    (a, b), (c, d) = ((0.0, 0.0), *MOVE.waypoints_m)[leg], MOVE.waypoints_m[leg]
    return Frame((a + share * (c - a), b + share * (d - b)), leg=leg, rate=1.0)


def test_the_mission_s_own_zones_change_nothing() -> None:
    """And a step without a way is flown as it is, whatever comes."""
    detour, frame = Detour(PLAN), at(0.5, 0)
    assert detour.flown(MOVE, BEFORE, PLAN.zones, frame) == (MOVE, frame)
    hold, pond = HoldStep(5.0, 20.0), (Zone("pond", ((50.0, 0.0),), 5.0, 1.25),)
    assert detour.flown(hold, BEFORE, pond, frame) == (hold, frame)


@given(zones, st.lists(st.tuples(shares, st.integers(0, 1)), min_size=2, max_size=3))
def test_all_agents_have_one_way_wherever_they_take_the_frame_to_be(
    found: tuple[Zone, ...], places: list[tuple[float, int]]
) -> None:
    """It has the move's own waypoints in their order, and no zone cuts it where it is another one.
    Each frame goes on to a corner up to the next of these; with the zones gone it is as before."""
    flown = set()
    for share, leg in places:
        detour, frame = Detour(PLAN), at(share, leg)
        step, now = detour.flown(MOVE, BEFORE, found, frame)
        flown.add(step)
        assert now is not None
        assert now.point_m == frame.point_m
        assert now.leg <= step.way_m.index(MOVE.waypoints_m[leg])
        assert detour.flown(step if step is MOVE else MOVE, BEFORE, found, now) == (step, now)
        again, back = detour.flown(MOVE, BEFORE, PLAN.zones, now)
        assert again == MOVE
        assert back is not None
        assert back.leg <= leg
    (step,) = flown
    assert [point for point in step.way_m if point in MOVE.waypoints_m] == [*MOVE.waypoints_m]
    ends = [complex(*point) for point in ((0.0, 0.0), *MOVE.waypoints_m)]
    middles = [(complex(*zone.corners_m[0]), zone.radius_m) for zone in found]
    if step is not MOVE and all(abs(a - b) > r + 12.0 for a in ends for b, r in middles):
        among = AmongZones.of(replace(PLAN, zones=found), (10.0, 10.0))
        way = ((0.0, 0.0), *step.way_m)
        # together, a zone may stand between two of them, on the centre's own line
        ways = [way] if step.file else zip(*map(BEFORE.places_m, way), strict=True)
        assert not any(among.cut(each) for each in ways)


def test_a_way_in_file_is_planned_again_in_file() -> None:
    """Round what cuts it, past a corner that lies in a zone, and back when that is lifted. A zone
    that is not in its way changes nothing, nor does one that leaves none."""
    detour, frame, file = Detour(PLAN), at(0.1, 0), replace(MOVE, opens_m=20.0)
    aside = (Zone("aside", ((50.0, 90.0),), 5.0, 1.25),)
    assert detour.flown(file, BEFORE, aside, frame) == (file, frame)
    ponds = (Zone("on", ((50.0, 0.0),), 5.0, 1.25), Zone("over", ((100.0, 0.0),), 5.0, 1.25))
    step, now = detour.flown(file, BEFORE, ponds, frame)
    assert step.file is not None
    assert MOVE.waypoints_m[0] not in step.way_m
    assert step.way_m[-1] == MOVE.waypoints_m[1]
    among = AmongZones.of(replace(PLAN, zones=ponds), (10.0, 10.0))
    assert not among.cut((BEFORE.centre_m, *step.way_m))
    assert now is not None
    assert not detour.hemmed(step, now)
    assert not among.cut((now.point_m, *step.way_m[now.leg :]))
    assert detour.flown(file, BEFORE, PLAN.zones, now)[0] == file
    sides = [complex(25, -30), complex(30, 25), complex(-25, 30), complex(-30, -25)]
    shut = tuple(
        Zone(f"side-{k}", ((at.real, at.imag), *ends), 0.0, 1.25)
        for k, (at, ends) in enumerate(
            (at, [(p.real, p.imag) for p in (at + 55 * to, at + (55 + 5j) * to, at + 5j * to)])
            for at, to in zip(sides, (1j, -1, -1j, 1), strict=True)
        )
    )
    around = AmongZones.of(replace(PLAN, zones=shut), (10.0, 10.0))
    assert around.single(BEFORE.centre_m, file.way_m) is None
    assert Detour(PLAN).flown(file, BEFORE, shut, frame)[0] == file


def test_a_frame_that_was_taken_over_counts_its_corners_as_the_peer_does() -> None:
    """Until the agent has the peer's zones; of zones that come later it counts them anew."""
    pond = (Zone("pond", ((50.0, 0.0),), 5.0, 1.25),)
    elm = (*pond, Zone("elm", ((100.0, 60.0),), 5.0, 1.25))
    way_m = Detour(PLAN).flown(MOVE, BEFORE, pond, None)[0].way_m
    assert len(way_m) > 2
    theirs = Frame((100.0, 20.0), leg=len(way_m) - 1)
    detour = Detour(PLAN)
    detour.join(7)
    assert detour.flown(MOVE, BEFORE, PLAN.zones, theirs, 0) == (MOVE, theirs)
    assert detour.flown(MOVE, BEFORE, pond, theirs, 7)[1] == theirs
    step, later = detour.flown(MOVE, BEFORE, elm, theirs, 8)
    assert later is not None
    assert len(way_m) - 1 <= later.leg < len(step.way_m)
    assert step.way_m[later.leg] != MOVE.waypoints_m[0]
    same = Detour(PLAN)
    same.join(0)
    assert same.flown(MOVE, BEFORE, PLAN.zones, at(0.9, 1), 0)[1] == at(0.9, 1)
    step, mapped = same.flown(MOVE, BEFORE, pond, at(0.9, 1), 7)
    assert mapped is not None
    assert step.way_m[mapped.leg] == MOVE.waypoints_m[1]
