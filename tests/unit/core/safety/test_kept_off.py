"""What a vehicle is kept off is told by name, also when zones change in flight."""

from __future__ import annotations

from swarm_ctl.core.law.own_response import OwnResponse
from swarm_ctl.core.model.plan import Zone
from swarm_ctl.core.safety.safety_filter import SafetyFilter
from swarm_ctl.core.swarm.snapshot import NO_FORMATION, PeerSnapshot
from tests.unit.core.builders import NOW, plan

OAK = Zone("oak", ((30.0, 0.0),), 2.0, 1.0)
POND = Zone("pond", ((0.0, 30.0),), 2.0, 1.0)


def test_a_zone_that_is_lifted_keeps_nobody_off() -> None:
    """Its number was looked up among the zones that were left: none, or another one's name."""
    mission = plan(zones=(POND, OAK))
    estimate = OwnResponse(mission.response, mission.tick_s)
    safety = SafetyFilter(mission, 1, mission.response, estimate)
    for _ in range(round(3.0 / mission.tick_s)):
        safety.filtered(PeerSnapshot(NOW, ()), 26.4 + 0j, 3.0 + 0j, NO_FORMATION)
    assert safety.kept_off == "zone oak"
    safety.set_zones((POND,))
    assert safety.kept_off == ""
