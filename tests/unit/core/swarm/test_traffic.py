"""What the traffic sensor sees beside the mesh: a contact is a peer only where it is and stops as
the peer says."""

from __future__ import annotations

from dataclasses import replace

import pytest

from swarm_ctl.core.model.frames import geodetic_from_ned
from swarm_ctl.core.model.vehicle import Contact
from swarm_ctl.core.swarm.peers import Peers
from swarm_ctl.core.swarm.plausibility import LASTS_S
from swarm_ctl.core.swarm.traffic import Traffic, Vacated
from tests.unit.core.builders import NOW, peer, plan, state

PLAN = plan()


def contact(north: float, velocity: float = 0.0, age_s: float = 0.2) -> Contact:
    """At (north, 0), flying north."""
    place = geodetic_from_ned((north, 0.0, -8.0), PLAN.origin)
    return Contact(NOW - age_s, 77, place, (velocity, 0.0, 0.0))


@pytest.mark.parametrize(
    ("at_m", "stop_m", "explained"),
    [
        (0.0, 0.0, True),
        (2.0, 2.0, True),
        (0.0, 4.0, True),  # it was told to fly a moment ago
        (0.0, 12.0, False),
        (0.0, -12.0, False),
        (4.0, 4.0, False),
    ],
)
def test_a_contact_is_a_peer_that_stops_where_it_says(
    at_m: float, stop_m: float, explained: bool
) -> None:
    """A peer that tells a false stop point is kept clear of where the sensor sees it stop."""
    said = peer(2, 0.05, position_ned_m=(at_m, 0.0, -8.0), stop_point_m=(stop_m, 0.0))
    traffic = Traffic(PLAN)
    found = traffic.unexplained(NOW, [contact(0.0)], [said], (20.0, 0.0))
    assert (found == ()) is explained
    assert (2 in traffic.seen) is explained
    if not explained:
        assert abs(found[0].stop_point) < 0.1


def test_a_peer_that_stops_elsewhere_for_a_while_is_doubted() -> None:
    """It was heard as if all were well."""
    peers, now = Peers(PLAN, 1), NOW
    peers.clocks.of[2].answered(NOW, NOW, NOW, NOW + 0.01)
    for k in range(60):
        now = NOW + 0.05 * k
        place = {"position_ned_m": (0.0, 0.0, -8.0), "stop_point_m": (12.0, 0.0)}
        assert peers.hear(state(2, seq=k, time_s=now, **place), now)
        seen = replace(contact(0.0), time_s=now - 0.1)
        strangers = peers.snapshot(now, [seen], (20.0, 0.0)).traffic
        assert len(strangers) == 1
        assert (2 in peers.suspects(now)) is (0.05 * k >= LASTS_S)
    assert peers.suspects(now)[2].startswith("the traffic sensor sees it stop 12.0 m from")


GONE = replace(peer(2, 60.0, position_ned_m=(0.0, 0.0, -8.0)), expelled=True)
"""The last place of a vehicle whose agent was expelled."""


def vacated(*contacts: Contact, sees: bool = True) -> Vacated:
    """After 20 s in which the sensor heard these contacts."""
    place = Vacated(PLAN)
    for k in range(400):
        now = NOW + 0.05 * k
        heard = [replace(each, time_s=now - 0.2) for each in contacts]
        place.look(now, heard, [GONE], sees=sees)
    return place


def at(height_m: float, speed: float = 0.0) -> Contact:
    """Over the last place."""
    place = geodetic_from_ned((1.0, 0.0, -height_m), PLAN.origin)
    return Contact(NOW, 78, place, (speed, 0.0, 0.0))


@pytest.mark.parametrize(
    ("place", "free"),
    [
        (vacated(), True),
        (vacated(contact(40.0)), True),
        (vacated(at(0.1)), True),
        (vacated(sees=False), False),
        (vacated(at(8.0)), False),
        (vacated(at(0.5, speed=2.0)), False),
        (vacated(at(0.1), at(8.0)), False),
    ],
    ids=["nothing", "elsewhere", "landed", "blind", "hovers", "taxies", "two"],
)
def test_the_last_place_of_an_expelled_vehicle_is_free_by_evidence_alone(
    place: Vacated, free: bool
) -> None:
    """A sensor that sees others, and nothing in the air there; `readmit` begins anew."""
    (seen,) = place.at_rest((GONE,))
    assert seen.down is free
    assert seen.expelled
    assert place.at_rest((replace(GONE, expelled=False),)) == (replace(GONE, expelled=False),)
    assert place.at_rest((GONE,)) == (GONE,)
