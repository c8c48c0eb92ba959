"""What is around a drawn mission: its vehicles, the weather, the fence and the zones. Fence and
zones go by its plan."""

from __future__ import annotations

import math

from swarm_ctl.core.model.plan import Plan
from swarm_ctl.fuzz.draw.dice import Data, Dice
from swarm_ctl.mission.checks.envelope import PX4_ROOM_M
from swarm_ctl.mission.compile.loader import loads
from swarm_ctl.mission.input import yaml_file


def plan_of(mission: Data) -> Plan:
    """As agents would fly it."""
    return loads(yaml_file.write(mission)).plan


def drawn_weather(dice: Dice, most_mps: float) -> Data:
    """`most_mps`: of gusts."""
    wind = {"SIM_WIND_SPD": dice.number(1, 6, 1), "SIM_WIND_DIR": dice.whole(0, 359)}
    gusts_mps = min(dice.number(0.2, 1.3, 1), math.floor(10.0 * most_mps) / 10.0)
    gusts = {"SIM_WIND_SPD": 2.0, "SIM_WIND_GUST": gusts_mps}
    noise = {"SIM_GPS_NOISE": dice.number(0.05, 0.3)}
    drift = {"SIM_GPS_DRIFT": dice.number(0.1, 0.4)}
    return dice.pick((wind, gusts, noise, drift, wind | noise))


def drawn_vehicle(dice: Dice) -> Data:
    """Limits of all vehicles."""
    return {
        "limits": {
            "speed_mps": dice.number(1.5, 4.0, 1),
            "climb_mps": dice.number(0.8, 1.5, 1),
            "descent_mps": dice.number(0.8, 1.4, 1),
        }
    }


def drawn_fleet(dice: Dice, ids: list[int], room_m: float, *, fair: bool) -> Data:
    """ArduCopters, PX4s or both, most with their own response; no PX4 in units that are too small
    for it."""
    kinds = dice.pick((("ardupilot",), ("px4",), ("ardupilot", "px4")))
    kinds = kinds if room_m >= PX4_ROOM_M else ("ardupilot",)
    entries: list[Data] = []
    answers = not fair and dice.chance(0.3)
    for agent in ids:
        entry: Data = {"id": agent, "autopilot": dice.pick(kinds)}
        if answers:
            entry |= _responses(dice)
        entries.append(entry)
    return {"agents": entries}


def _responses(dice: Dice) -> Data:
    """What the agent believes, and what is so: dead time and lag together off by less than the
    doubt of half a second."""
    believed = {
        "dead_time_s": dice.number(0.1, 0.5),
        "lag_s": dice.number(0.2, 0.7),
        "acceleration_mps2": dice.number(2.0, 2.8, 1),
    }
    dead_s = max(0.0, believed["dead_time_s"] + dice.signed(0, 0.25))
    lag_s = max(0.15, believed["lag_s"] + dice.signed(0, 0.15))
    true = {"dead_time_s": round(dead_s, 2), "lag_s": round(lag_s, 2)}
    true["acceleration_mps2"] = round(believed["acceleration_mps2"] + dice.number(0, 1.5), 1)
    return {"response": believed, "simulated_response": true}


def draw_fence(mission: Data, dice: Dice, *, fair: bool, always: bool = False) -> None:
    """Draw a fence around all places that the plan goes to; in fair weather with room to spare."""
    if not always and dice.chance(0.6):
        return
    plan = plan_of(mission)
    places_m = [place for at in plan.all_steps() for place in at.after.places_m()]
    places_m += [(n * plan.unit_m, e * plan.unit_m) for n, e in (a.start for a in plan.agents)]
    top_m = max(max(at.after.heights_m, default=0.0) for at in plan.all_steps())
    metre = 1.0 if mission.get("lengths") == "metres" else 1.0 / plan.unit_m
    room_m = dice.number(14, 25, 0) if fair or dice.chance(0.6) else dice.number(1, 8, 1)
    norths, easts = zip(*places_m, strict=True)
    south, north = min(norths) - room_m, max(norths) + room_m
    west, east = min(easts) - room_m, max(easts) + room_m
    corners = [(south, west), (south, east), (north, east), (north, west)]
    if dice.chance(0.3):  # a corner more, outwards
        corners.insert(2, ((south + north) / 2, east + dice.number(1, 10, 1)))
    fence: Data = {}
    if always or dice.chance(0.8):
        fence["polygon"] = [[round(n * metre, 2), round(e * metre, 2)] for n, e in corners]
    if not fence or dice.chance(0.4):
        above_m = dice.number(6, 20, 0) if fair or dice.chance(0.6) else dice.number(1, 5, 1)
        fence["height_m"] = round(top_m + above_m, 1)
    mission["fence"] = fence


def draw_zones(mission: Data, dice: Dice) -> None:
    """Draw zones between the places that the plan goes to: trees, huts, and walls that lines to
    places and ways of a `move` meet."""
    if dice.chance(0.7) or "zones" in mission:
        return
    plan = plan_of(mission)
    stands = (at for group in plan.groups for at in group.formations(plan.unit_m))
    places_m = [place for at in stands for place in at.places_m()]
    norths, easts = zip(*places_m, strict=True)
    metre = 1.0 if mission.get("lengths") == "metres" else 1.0 / plan.unit_m
    away_m = 0.5 * plan.law.r_in * plan.unit_m + 1.0
    zones: Data = {}
    for k in range(dice.whole(1, 4)):
        north = dice.number(min(norths) - 5, max(norths) + 5, 1)
        east = dice.number(min(easts) - 5, max(easts) + 5, 1)
        size_m = dice.number(0.3, 3.0, 1)
        wide_m = size_m * dice.number(1.0, 4.0, 1)
        near_m = min(math.dist((north, east), place) for place in places_m)
        if near_m < away_m + 1.5 * wide_m:
            continue
        zone: Data = {"circle": [round(north * metre, 3), round(east * metre, 3)]}
        if dice.chance(0.5):
            corners = ((-size_m, -wide_m), (-size_m, wide_m), (size_m, wide_m), (size_m, -wide_m))
            polygon = [
                [round((north + n) * metre, 3), round((east + e) * metre, 3)] for n, e in corners
            ]
            zone = {"polygon": polygon}
        else:
            zone["radius"] = round(size_m * metre, 3)
        if dice.chance(0.3):
            zone["ceiling_m"] = dice.number(1.0, 20.0, 1)
        zones[f"zone-{k + 1}"] = zone
    if zones:
        mission["zones"] = zones
