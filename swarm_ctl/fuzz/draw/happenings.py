"""What befalls a drawn flight, and what is ordered in it."""

from __future__ import annotations

from typing import Final, NamedTuple, get_args

from swarm_ctl.fuzz.coverage import NOTHING, WHATS, Coverage, CoverageCell
from swarm_ctl.fuzz.draw.dice import Data, Dice, some_of
from swarm_ctl.fuzz.draw.mission import ACTIONS
from swarm_ctl.fuzz.draw.surroundings import draw_fence, plan_of
from swarm_ctl.mission.compile.forecast import forecast
from swarm_ctl.mission.sections.simulation_section import Pilot
from swarm_ctl.virtual.scenario import STATION

_STEP_S: Final = 12.0
"""About so long takes a step of a short flight."""
_ANSWERED: Final = 0.3
"""Of what happens: the operator gives an order soon after, or takes back one that holds."""
_PREPARED_S: Final = 3.6
"""All have prepared, and take off."""
_PILOTS: Final = get_args(Pilot)


class Addressees(NamedTuple):
    """What happenings and orders name."""

    ids: list[int]
    shapes: list[str]
    groups: list[str]
    waiting: list[int]
    """On the ground, to be launched."""


def two_losses(dice: Dice, mission: Data) -> list[Data]:
    """Two things that policies are for, one soon after the other, to the end; the first policy
    holds mostly. Then perhaps an order. The mission waits for them, in the air."""
    ids = sorted(agent["id"] for agent in mission["agents"])
    one = dice.pick(ids)
    found: list[Data] = []
    at_s = dice.number(14, 30, 1)
    for k, (policy, happening) in enumerate(dice.shuffled(_losses(dice, one, ids))[:2]):
        mission["policies"][policy] = dice.pick(ACTIONS, lambda act: 4 if act == "hold" else 1)
        if policy == "fence":
            draw_fence(mission, dice, fair=False, always=True)
            mission["policies"]["estimate"] = dice.pick(("continue", "hold"))  # it jumps, too
        if k == 1 and mission["policies"][policy] == "hold":
            mission["policies"][policy] = dice.pick(("land", "return"))
        found.append({"at_s": at_s} | happening)
        at_s = round(at_s + dice.number(0.5, 12, 1), 1)
    _waits_in_the_air(dice, mission)
    if dice.chance(0.3):
        found.append({"at_s": at_s, "order": dice.pick(("land", "return", f"land @{one}"))})
    return found


def failed_and_ended(dice: Dice, mission: Data) -> list[Data]:
    """One agent breaks the mission off by itself, and goes home or lands; the others fly on until
    the operator ends the flight. Or that comes first, and the agent fails on its way down."""
    ids = sorted(agent["id"] for agent in mission["agents"])
    one = dice.pick(ids)
    own = ("estimate", "battery_low", "fence")
    policy, failure = dice.pick([each for each in _losses(dice, one, ids) if each[0] in own])
    if dice.chance(0.3):
        failure = {"pilot": {"agents": [one], "mode": dice.pick(_PILOTS)}}
    else:
        failure["vehicle"]["agents"] = [one]
    mission["policies"] |= {policy: dice.pick(("land", "return")), "agent_lost": "continue"}
    if policy == "fence":
        draw_fence(mission, dice, fair=False, always=True)
        mission["policies"]["estimate"] = "continue"  # it jumps, too
    order: Data = {"order": dice.pick(("land", "return", "return", "kill"))}
    at_s, later_s = dice.number(14, 30, 1), dice.number(0.5, 12, 1)
    first, then = (failure, order) if dice.chance(0.6) else (order, failure)
    _waits_in_the_air(dice, mission)
    return [{"at_s": at_s} | first, {"at_s": round(at_s + later_s, 1)} | then]


def _waits_in_the_air(dice: Dice, mission: Data) -> None:
    """For what is to happen."""
    formed = [k for k, step in enumerate(mission["steps"]) if "form" in step]
    if formed:
        mission["steps"].insert(formed[0] + 1, {"hold": {"duration_s": dice.number(20, 40, 0)}})


def _losses(dice: Dice, one: int, ids: list[int]) -> list[tuple[str, Data]]:
    """What makes each policy act."""
    some = some_of(dice, ids)

    def set_to(name: str, value: float) -> Data:
        return {"vehicle": {"agents": [*some], "set": {f"SIM_{name}": value}}}

    jump_m = dice.signed(40, 70, 0)
    return [
        ("agent_lost", {"kill": [one]}),
        ("station_lost", {"station": "gone"}),
        ("left_by_order", {"order": f"land @{one}"}),
        ("estimate", set_to("GPS_SATS", 4)),
        ("battery_low", set_to("BATT_DRAIN", 400.0)),
        ("fence", set_to(dice.pick(("GPS_JUMP_N", "GPS_JUMP_E")), jump_m)),
    ]


def crossed(dice: Dice, mission: Data) -> list[Data]:
    """What befalls agents that change sides, before or as they pass each other. Two orders to land
    let some come down where others are in the air, or stand. Where one falls silent, the others
    mostly go on, past the place where it may be. One that is not where it says comes too near, for
    the verdict to tell."""
    ids = sorted(agent["id"] for agent in mission["agents"])
    some = " @" + ",".join(map(str, some_of(dice, ids)))
    up, apart = (step.expected_s or 0.0 for step in forecast(plan_of(mission))[:2])
    at_s = round(_PREPARED_S + up + apart + dice.number(-2.0, 7.0, 1), 1)
    off = dice.pick(("SIM_GPS_JUMP_N", "SIM_GPS_JUMP_E"))
    what: tuple[Data, ...] = (
        {"kill": [dice.pick(ids)]},
        {"stop": [dice.pick(ids)], "for_s": dice.number(1, 8, 1)},
        {"order": "land"},
        {"order": f"land{some}"},
        {"order": f"return{some}"},
        {"vehicle": {"agents": [dice.pick(ids)], "set": {off: dice.signed(2.0, 3.6, 1)}}},
    )
    found: list[Data] = [{"at_s": at_s} | dice.pick(what, lambda each: 3 if "order" in each else 1)]
    if "order" not in found[0] and dice.chance(0.6):
        mission["policies"]["agent_lost"] = "continue"
    elif dice.chance(0.4):
        found.append({"at_s": round(at_s + dice.number(0.5, 12, 1), 1), "order": "land"})
    return found


def rezoned(dice: Dice, mission: Data) -> list[Data]:
    """Orders in flight: a zone where a vehicle may be, or near it, or between two places of the
    plan; perhaps another one, and perhaps the first one lifted."""
    plan = plan_of(mission)
    places = [
        place
        for group in plan.groups
        for at in group.formations(plan.unit_m)
        for place in at.places_m()
    ]
    places += [(n * plan.unit_m, e * plan.unit_m) for n, e in (a.start for a in plan.agents)]
    found: list[Data] = []
    at_s = dice.number(4, 45, 1)
    for name in ("pond", "pole")[: dice.pick((1, 1, 2))]:
        one, other, share = dice.pick(places), dice.pick(places), dice.pick((0.0, 0.5))
        north, east = (
            round(a + share * (b - a) + dice.signed(0, 5, 1), 1)
            for a, b in zip(one, other, strict=True)
        )
        found.append({"at_s": at_s, "order": f"zone add {name} {_outline(dice, north, east)}"})
        at_s = round(at_s + dice.number(0.1, 20, 1), 1)
    if dice.chance(0.4):
        found.append({"at_s": at_s, "order": "zone lift pond"})
    return found


def _outline(dice: Dice, north: float, east: float) -> str:
    """Of a zone in an order."""
    size_m = dice.number(0.5, 4.0, 1)
    wide_m = round(size_m * dice.number(1.0, 3.0, 1), 1)
    corners = ((-size_m, -wide_m), (-size_m, wide_m), (size_m, wide_m), (size_m, -wide_m))
    polygon = " ".join(f"{north + n:.1f} {east + e:.1f}" for n, e in corners)
    circle = f"circle {north:g} {east:g} {size_m:g}"
    words = dice.pick((circle, f"polygon {polygon}"))
    words += f" clearance={dice.pick((0.5, 2.0)):g}" if dice.chance(0.2) else ""
    return words + (f" ceiling={dice.number(2.0, 15.0, 1):g}" if dice.chance(0.2) else "")


def drawn_happenings(
    dice: Dice, wanted: Coverage, swarm: Addressees, steps: list[str]
) -> list[Data]:
    """Up to five, at any time of a short flight; some right behind another."""
    found: list[Data] = []
    at_s, after, most_s = 0.0, NOTHING, 10.0 + _STEP_S * len(steps)
    for _ in range(dice.pick((1, 1, 2, 2, 3, 3, 4, 5))):
        burst = bool(found) and dice.chance(0.3)
        at_s = round(at_s + dice.number(0.1, 3, 1), 1) if burst else dice.number(1, most_s, 1)
        # which step that will be in is not known yet: about
        step = steps[min(int(at_s / most_s * len(steps)), len(steps) - 1)]
        what = dice.pick(WHATS, lambda each: wanted.wants(CoverageCell(step, after, each)))  # noqa: B023
        found += _happening(dice, what, at_s, swarm)
        if found and not found[-1].get("order"):
            after = what.split()[0]
        if found and dice.chance(_ANSWERED):
            found += _answer(dice, found[-1], swarm)
    return found


def _answer(dice: Dice, happening: Data, swarm: Addressees) -> list[Data]:
    """What the operator orders after this: on again, after an order that holds and after a pilot;
    else something quick."""
    at_s, line = happening["at_s"], happening.get("order", "")
    kind, _, rest = line.partition(" ")
    again = _TAKEN_BACK.get(kind)
    if again:
        at_s, rest = round(at_s + dice.number(2, 40, 1), 1), rest[rest.find("@") :]
        return [{"at_s": at_s, "order": f"{again} {rest}".strip()}]
    if line:
        return []
    if "pilot" in happening and dice.chance(0.6):
        order = "resume @" + ",".join(map(str, happening["pilot"]["agents"]))
    else:
        order = _order(dice, dice.pick(("land", "return", "hold", "resume", "next")), swarm)
    return [{"at_s": round(at_s + dice.number(0.2, 8, 1), 1), "order": order}]


_TAKEN_BACK: Final = {"hold": "resume", "expel": "readmit", "goto": "join"}


def _happening(dice: Dice, what: str, at_s: float, swarm: Addressees) -> list[Data]:
    kind, _, which = what.partition(" ")
    ids = swarm.ids
    happening: Data = {"at_s": at_s}
    match kind:
        case "order":
            happening["order"] = _order(dice, which, swarm)
        case "kill":
            happening["kill"] = some_of(dice, ids)
        case "restart":
            agents = [dice.pick(ids)]
            dead_s = dice.pick((0.5, 1.0, 2.0, 5.0, 12.0))
            killed = {"at_s": max(0.1, round(at_s - dead_s, 1)), "kill": agents}
            return [killed, happening | {"restart": list(agents)}]
        case "stop":
            happening |= {"stop": some_of(dice, ids), "for_s": dice.number(0.2, 12, 1)}
        case "station":
            happening |= {"station": "gone"} | _for_s(dice, 15)
        case "part":
            if len(ids) < 2:
                return []
            one = dice.some(ids, dice.whole(1, len(ids) - 1))
            other: list[int | str] = [agent for agent in ids if agent not in one]
            other += [STATION] if dice.chance(0.5) else []
            part = {"one": one, "other": other, "one_way": dice.chance(0.3)}
            happening |= {"part": part, "for_s": dice.number(0.3, 15, 1)}
        case "pilot":
            happening["pilot"] = {"agents": some_of(dice, ids), "mode": which}
        case "vehicle":
            happening["vehicle"] = {"agents": some_of(dice, ids), "set": _fault(dice, which)}
            happening |= {} if which == "REBOOT" else _for_s(dice, 20)
        case "clock":
            jump_s = dice.pick((0.3, 0.8, 2.0, 20.0, 3600.0))
            jump_s = jump_s if dice.chance(0.5) else -jump_s
            happening["clock"] = {"agents": some_of(dice, ids), "ahead_s": jump_s}
        case _:
            says: Data = {"agents": some_of(dice, ids)}
            if dice.chance(0.5):
                says["moved_m"] = [dice.signed(1, 30, 1), dice.signed(1, 30, 1)]
            else:
                field = dice.pick(("step", "override", "gains_tag", "stage"))
                says["set"] = {field: dice.pick((0, 1, 2, 3, 9, 255))}
            happening |= {"says": says, "for_s": dice.number(0.2, 20, 1)}
    return [happening]


def _order(dice: Dice, kind: str, swarm: Addressees) -> str:
    ids, shapes = swarm.ids, swarm.shapes
    few = " @" + ",".join(map(str, some_of(dice, ids)))
    some = "" if dice.chance(0.55) else few
    group = f" @{dice.pick(swarm.groups)}" if swarm.groups else ""
    some = group if group and dice.chance(0.5) else some
    north, east = dice.signed(1, 15, 0), dice.signed(1, 15, 0)
    match kind:
        case "form":
            return f"form {dice.pick(shapes)}{group}" if shapes else f"hold{some}"
        case "move":
            return f"move {north:g} {east:g}{group}"
        case "goto":
            return f"goto {2 * north:g} {2 * east:g}{few}"
        case "launch":
            return f"launch @{swarm.waiting[0]}" if swarm.waiting else f"resume{some}"
        case "tune":
            return dice.pick(("tune h=0.1", "tune h=0.15 delta_a=0.2", "tune plan"))
        case "zone":
            if dice.chance(0.3):
                return "zone lift drawn"
            return f"zone add drawn circle {north:g} {east:g} {dice.number(0.5, 4.0, 1):g}"
        case "expel" | "readmit":
            return f"{kind} @{dice.pick(ids)}"
        case "next":
            return f"next{group}"
        case "follow":
            return f"follow boat{group}"
    return f"{kind}{some}"


def _fault(dice: Dice, name: str) -> Data:
    """A value of a vehicle's parameter with which something goes wrong. Every third jump leads out
    of every fence."""
    jump_m = dice.pick(((1, 6), (1, 15), (30, 60)))
    value: float = {
        "BATT_DRAIN": dice.pick((10.0, 25.0, 60.0, 400.0)),
        "DELAY": dice.number(0.05, 0.6),
        "GPS_ACC": dice.pick((1.2, 4.0)),
        "GPS_DRIFT": dice.number(0.2, 3.0, 1),
        "GPS_JUMP_D": dice.signed(*jump_m, 0),
        "GPS_JUMP_E": dice.signed(*jump_m, 0),
        "GPS_JUMP_N": dice.signed(*jump_m, 0),
        "GPS_NOISE": dice.number(0.1, 1.5, 1),
        "GPS_SATS": 4,
        "LOSS": dice.whole(5, 80),
        "VEL_NOISE": dice.number(0.1, 1.0, 1),
        "WIND_DIR": dice.whole(0, 359),
        "WIND_GUST": dice.number(0.5, 4, 1),
        "WIND_SPD": dice.number(2, 16, 1),
    }.get(name, 1)
    return {f"SIM_{name}": value}


def _for_s(dice: Dice, most_s: float) -> Data:
    return {"for_s": dice.number(0.3, most_s, 1)} if dice.chance(0.6) else {}
