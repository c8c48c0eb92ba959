"""Zones that change in flight: one at a time, and by what is in force."""

from __future__ import annotations

from swarm_ctl.core.model.messages import Command, CommandKind, Tuning
from swarm_ctl.core.model.plan import Zone
from swarm_ctl.core.swarm.gain_update import GainUpdate, bad_zones, planned, zone_changes
from swarm_ctl.core.swarm.snapshot import PeerSnapshot
from tests.unit.core.builders import NOW, plan

OAK = Zone("oak", ((30.0, 0.0),), 2.0, 1.0)
POND = Zone("pond", ((0.0, 30.0),), 2.0, 1.0)
HUT = Zone("hut", ((0.0, 0.0), (4.0, 0.0), (4.0, 4.0)), 0.0, 1.0)
PLAN = plan(zones=(OAK,))


def refusal(
    update: GainUpdate, zones: tuple[Zone, ...] | None, kind: CommandKind = CommandKind.ZONE
) -> str:
    """What one agent says to an update that is for in 2 s."""
    tuning = Tuning(planned(PLAN), NOW + 2.0, zones=zones)
    command = Command("a", kind, (1,), NOW, tuning=tuning)
    return update.refusal(command, PeerSnapshot(NOW, ()))


def test_one_zone_at_a_time() -> None:
    """A sender that knows the zones of a moment ago lifts none that was just added."""
    update = GainUpdate(PLAN, 1, PLAN.hash())
    assert refusal(update, (OAK, POND)) == ""
    assert refusal(update, ()) == ""
    assert refusal(update, (POND,)).startswith("it would add pond, lift oak: its sender knows")
    assert refusal(update, (OAK, POND), CommandKind.TUNE).startswith("it would add pond")
    update.zones = (OAK, POND)
    assert "lift pond" in refusal(update, (OAK, HUT))
    assert refusal(update, (OAK, POND, HUT)) == ""
    assert refusal(update, None) == ""  # the mission's own
    assert "lift pond" in refusal(update, None, CommandKind.TUNE)
    assert refusal(update, (OAK, POND), CommandKind.TUNE) == ""


def test_what_is_no_zone_is_refused() -> None:
    update = GainUpdate(PLAN, 1, PLAN.hash())
    flat = Zone("flat", ((0.0, 0.0), (1.0, 1.0), (2.0, 2.0)), 0.0, 1.0)
    nowhere = Zone("nowhere", ((float("nan"), 0.0),), 1.0, 1.0)
    for zone in (flat, nowhere, Zone("none", ((0.0, 0.0),), 0.0, 1.0)):
        assert refusal(update, (OAK, zone))
    low = Zone("low", ((0.0, 0.0),), 1.0, 1.0, 10.0, 2.0)
    near = Zone("near", ((0.0, 0.0),), 1.0, -30.0)
    assert bad_zones((low,)) == "zone low: floor 10, ceiling 2; allowed: a floor below it"
    assert bad_zones((near,)) == "zone near: clearance -30; allowed: 0 m or more"
    assert bad_zones((OAK, OAK)).startswith("two zones have one name")


def test_what_changes_is_said() -> None:
    assert zone_changes((OAK,), (OAK, POND)) == "add pond"
    assert zone_changes((OAK, POND), (POND,)) == "lift oak"
    assert zone_changes((OAK,), (OAK,)) == ""
