"""Between the mission protocol and the mission's flight: what both personas do with an uploaded
mission. Pure."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from sim.firmware.flying.mission_flight import Auto, Course
from sim.firmware.message import Severity
from sim.firmware.protocol.commands import MAX_SPEED_MPS
from sim.firmware.protocol.mission_lists import ABSOLUTE_FRAMES, MISSION, Item, Nav
from sim.physics.geodesy import Geodetic, Vector3

if TYPE_CHECKING:
    from sim.firmware.base import Firmware

NO_MISSION, NOT_STARTED, ACTIVE, PAUSED, COMPLETE = 1, 2, 3, 4, 5
"""MISSION_STATE."""
_NAMES = {
    16: "WP",
    17: "LoitUnlim",
    18: "LoitTurns",
    19: "LoitTime",
    20: "RTL",
    21: "Land",
    22: "Takeoff",
}


def items(f: Firmware) -> list[Item]:
    """The uploaded mission."""
    return f.plans.lists[MISSION]


def present(f: Firmware) -> bool:
    """There is something to fly."""
    return len(items(f)) > f.first_index


def begins_with_takeoff(f: Firmware) -> bool:
    """The first thing flown is a take-off."""
    flown = [i for i in items(f)[f.first_index :] if i.command < Nav.DO_JUMP]
    return bool(flown) and flown[0].command == Nav.TAKEOFF


def flight(f: Firmware) -> Auto:
    """The mission's flight, from the current item on; from the first one after it had been
    completed."""
    mission = items(f)
    current = f.plans.current
    if f.mission_complete or not f.first_index <= current < len(mission):
        current = f.first_index
    f.mission_complete = False
    f.plans.current = current
    _announce(f)
    return Auto(mission, current, course(f))


def course(f: Firmware) -> Course:
    """What the mission's flight asks of this vehicle."""
    return f.course(
        lambda item: place(f, item),
        lambda seq: _reached(f, seq),
        lambda speed: _set_speed(f, speed),
    )


def place(f: Firmware, item: Item) -> Vector3:
    """NED of an item's point; its height alone where it has no place."""
    home = f.plane.geodetic_from_ned(f.home_ned)
    here = f.plane.geodetic_from_ned(f.sensed.position_ned_m)
    lat, lon = (item.x * 1e-7, item.y * 1e-7) if item.placed else (here.lat_deg, here.lon_deg)
    alt = item.z if item.frame in ABSOLUTE_FRAMES else home.alt_m + item.z
    return f.plane.ned_from_geodetic(Geodetic(lat, lon, alt))


def keep_up(f: Firmware) -> None:
    """Notes how far the mission has come; every tick."""
    auto = f.maneuver
    if not isinstance(auto, Auto):
        return
    if auto.current != f.plans.current:
        f.plans.current = auto.current
        _announce(f)
    if auto.finished and not f.mission_complete:
        f.mission_complete = True
        say_current(f)


def changed(f: Firmware) -> None:
    """Another mission was uploaded, or it was cleared: one that is being flown starts anew, or
    ends."""
    f.mission_complete = False
    if isinstance(f.maneuver, Auto):
        if present(f):
            f.begin(flight(f))
        else:
            f.mission_lost()


def go_on_at(f: Firmware, index: int) -> bool:
    """The item to fly next; False where there is none."""
    if not 0 <= index < len(items(f)):
        return False
    f.plans.current = max(index, f.first_index)
    f.mission_complete = False
    if isinstance(f.maneuver, Auto):
        f.maneuver.jump_to(f.plans.current)
        f.update_demand()
    return True


def say_current(f: Firmware) -> None:
    """MISSION_CURRENT, now."""
    f.say("MISSION_CURRENT", current_fields(f))


def current_fields(f: Firmware) -> dict[str, Any]:
    """MISSION_CURRENT."""
    total = max(0, len(items(f)) - f.first_index)
    return {"seq": f.plans.current, "total": total, "mission_state": state(f), "mission_mode": 0}


def state(f: Firmware) -> int:
    """MISSION_STATE."""
    if not present(f):
        return NO_MISSION
    if f.mission_complete:
        return COMPLETE
    if isinstance(f.maneuver, Auto):
        return PAUSED if f.maneuver.paused else ACTIVE
    return NOT_STARTED if f.plans.current <= f.first_index else PAUSED


def _announce(f: Firmware) -> None:
    mission, at = items(f), f.plans.current
    if at < len(mission):
        name = _NAMES.get(mission[at].command, f"Command {mission[at].command}")
        f.text(Severity.INFO, f"Mission: {at} {name}")
    say_current(f)


def _reached(f: Firmware, seq: int) -> None:
    f.say("MISSION_ITEM_REACHED", {"seq": seq})


def _set_speed(f: Firmware, speed: float) -> None:
    f.speed_mps = min(speed, MAX_SPEED_MPS)
