"""What the traffic sensor sees beside the mesh: a contact is a peer only where it is and stops as
the peer says."""

from __future__ import annotations

import pytest

from swarm_ctl.core.model.frames import geodetic_from_ned
from swarm_ctl.core.model.vehicle import Contact
from swarm_ctl.core.swarm.traffic import Traffic
from tests.unit.core.builders import NOW, peer, plan

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
