"""What both personas do with an uploaded mission: begin it, jump in it, tell its state. Pure."""

from __future__ import annotations

from typing import Any

from swarm_sim.firmware.autopilot import SimAutopilot
from swarm_sim.firmware.flying.mission_flight import MissionManeuver, MissionVehicle
from swarm_sim.firmware.flying.mission_items import MISSION, MissionItem
from swarm_sim.firmware.message import ABSOLUTE_FRAMES, MavCmd, MavSeverity
from swarm_sim.physics.geodesy import Vector3

NO_MISSION, NOT_STARTED, ACTIVE, PAUSED, COMPLETE = 1, 2, 3, 4, 5
"""MISSION_STATE."""
_NAMES = dict(
    enumerate(("WP", "LoitUnlim", "LoitTurns", "LoitTime", "RTL", "Land", "Takeoff"), start=16)
)


def items(a: SimAutopilot) -> list[MissionItem]:
    """The uploaded mission."""
    return a.missions.lists[MISSION]


def present(a: SimAutopilot) -> bool:
    """There is something to fly."""
    return len(items(a)) > a.first_index


def begins_with_takeoff(a: SimAutopilot) -> bool:
    """The first thing flown is a take-off."""
    flown = [i for i in items(a)[a.first_index :] if i.command < MavCmd.DO_JUMP]
    return bool(flown) and flown[0].command == MavCmd.NAV_TAKEOFF


def fly(a: SimAutopilot) -> MissionManeuver:
    """The mission's flight from the current item on, or from the first after a complete one."""
    mission = items(a)
    current = a.missions.current
    if a.missions.complete or not a.first_index <= current < len(mission):
        current = a.first_index
    a.missions.complete = False
    a.missions.current = current
    _announce(a)
    vehicle = MissionVehicle(
        style=a.style(),
        place=lambda item: place(a, item),
        home=lambda: a.home_ned,
        set_speed=a.set_speed,
        reached=lambda seq: a.say("MISSION_ITEM_REACHED", {"seq": seq}),
    )
    return MissionManeuver(mission, current, vehicle)


def place(a: SimAutopilot, item: MissionItem) -> Vector3:
    """NED of an item's point; its height alone where it has no place."""
    here = a.geodetic()
    lat, lon = (item.x * 1e-7, item.y * 1e-7) if item.placed else (here.lat_deg, here.lon_deg)
    return a.ned(lat, lon, item.z, above_home=item.frame not in ABSOLUTE_FRAMES)


def keep_up(a: SimAutopilot) -> None:
    """Notes how far the mission has come; every tick."""
    flight = a.maneuver
    if not isinstance(flight, MissionManeuver):
        return
    if flight.current != a.missions.current:
        a.missions.current = flight.current
        _announce(a)
    if flight.finished and not a.missions.complete:
        a.missions.complete = True
        say_current(a)


def changed(a: SimAutopilot) -> None:
    """The mission was replaced or cleared: one that is being flown starts anew, or ends."""
    a.missions.complete = False
    if isinstance(a.maneuver, MissionManeuver):
        if present(a):
            a.begin(fly(a))
        else:
            a.mission_lost()


def go_on_at(a: SimAutopilot, index: int) -> bool:
    """The item to fly next; False where there is none."""
    if not 0 <= index < len(items(a)):
        return False
    a.missions.current = max(index, a.first_index)
    a.missions.complete = False
    if isinstance(a.maneuver, MissionManeuver):
        a.maneuver.jump_to(a.missions.current)
        a.update_demand()
    return True


def say_current(a: SimAutopilot) -> None:
    """MISSION_CURRENT, now."""
    a.say("MISSION_CURRENT", mission_current(a))


def mission_current(a: SimAutopilot) -> dict[str, Any]:
    """MISSION_CURRENT's fields."""
    total = max(0, len(items(a)) - a.first_index)
    return {"seq": a.missions.current, "total": total, "mission_state": state(a)}


def state(a: SimAutopilot) -> int:
    """MISSION_STATE."""
    if not present(a):
        return NO_MISSION
    if a.missions.complete:
        return COMPLETE
    if isinstance(a.maneuver, MissionManeuver):
        return PAUSED if a.maneuver.paused else ACTIVE
    return NOT_STARTED if a.missions.current <= a.first_index else PAUSED


def _announce(a: SimAutopilot) -> None:
    mission, at = items(a), a.missions.current
    if at < len(mission):
        name = _NAMES.get(mission[at].command, f"Command {mission[at].command}")
        a.text(MavSeverity.INFO, f"Mission: {at} {name}")
    say_current(a)
