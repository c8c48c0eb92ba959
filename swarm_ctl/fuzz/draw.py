"""Scenarios that are drawn from a seed: short flights of few agents, inside the envelope of
docs/understand/safety-evidence.md, and what may befall them.

A scenario depends on the seed, its number and what was met before (`Coverage`) alone. Numbers have
few digits, because people read them. Lengths are the law's units until the end.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from typing import Any, Final, NamedTuple, TypeAlias, TypeVar, get_args

import numpy as np

from swarm_ctl.core.model.plan import Plan, Policy
from swarm_ctl.errors import InputError, MissionError
from swarm_ctl.fuzz.coverage import NOTHING, WHATS, Coverage, CoverageCell
from swarm_ctl.mission.checks.envelope import PX4_ROOM_M, most_gusts_mps
from swarm_ctl.mission.compile.forecast import forecast, refuse_too_close
from swarm_ctl.mission.compile.loader import LoadedMission, loads
from swarm_ctl.mission.input import yaml_file
from swarm_ctl.mission.sections.simulation_section import Pilot
from swarm_ctl.virtual.scenario import STATION, Scenario, scenario_of

T = TypeVar("T")
Data: TypeAlias = dict[str, Any]
Point: TypeAlias = tuple[float, float]

_ORIGINS: Final = ((-35.363262, 149.165237, 584.0), (47.4, 8.55, 450.0))
_ACTIONS: Final = tuple(policy.value for policy in Policy)
_R: Final = 4.5
_APART: Final = 1.26
"""Of slots, by the envelope, in r_out."""
_TAKEOFF_M: Final = 4.0
"""Between starts, besides r_in, as docs/understand/safety-evidence.md advises."""


class Dice:
    """The same words give the same throws, on each machine."""

    def __init__(self, *words: int) -> None:
        self._random = np.random.default_rng(words)

    def chance(self, share: float) -> bool:
        """True in this share of throws."""
        return bool(self._random.random() < share)

    def pick(self, these: Sequence[T], weight: Callable[[T], float] = lambda _: 1.0) -> T:
        """One of them, each as often as it weighs."""
        weights = np.array([weight(each) for each in these], dtype=np.float64)
        ends = np.cumsum(weights)
        at = int(np.searchsorted(ends, self._random.random() * ends[-1], side="right"))
        return these[min(at, len(these) - 1)]

    def some(self, these: Sequence[T], count: int) -> list[T]:
        """So many of them, in their order."""
        chosen = self._random.permutation(len(these))[:count]
        return [these[int(k)] for k in sorted(chosen)]

    def shuffled(self, these: Sequence[T]) -> list[T]:
        """All of them in another order."""
        return [these[int(k)] for k in self._random.permutation(len(these))]

    def number(self, low: float, high: float, digits: int = 2) -> float:
        """Evenly between the two, which are among them."""
        drawn = low + (high - low) * float(self._random.random())
        return min(max(round(drawn, digits), low), high)

    def whole(self, low: int, high: int) -> int:
        """Evenly from low to high, both among them."""
        return int(self._random.integers(low, high + 1))

    def signed(self, low: float, high: float, digits: int = 2) -> float:
        """A number of either sign whose size is between the two."""
        size = self.number(low, high, digits)
        return size if self.chance(0.5) else -size


_VARIANTS: Final = {"": 54, "swap": 24, "stack": 8, "column": 8, "split": 12}
"""How often a mission has steps of its own kind (`_VARIED`)."""
_LAYERED: Final = 0.15
"""Of `form` steps: their slots lie at several heights."""
_FAIR: Final = 0.12
"""Of all flights: nothing happens in them, so the forecast has to hold."""
_REZONED: Final = 0.25
"""Of the flights that are not fair, beside the orders that are drawn as all happenings are."""
_OTHER_CLOCKS: Final = 0.12
"""Of the flights; of the fair ones, which have nothing else, three times as many."""
_STEP_S: Final = 12.0
"""About so long takes a step of a short flight."""
_ANSWERED: Final = 0.3
"""Of what happens: the operator gives an order soon after, or takes back one that holds."""
_CROSSED: Final = 0.8
"""Of the missions whose agents change sides: something befalls them meanwhile ..."""
_CROSSED_ALONE: Final = 0.6
"""... and of these, nothing else."""
_PREPARED_S: Final = 3.6
"""All have prepared, and take off."""
_TWO_LOSSES: Final = 0.12
"""Of the flights that are not fair: two policies are to act at a time."""
_ENDED: Final = 0.1
"""Of the others: one agent fails by itself, and the operator ends the flight."""
_SMALL: Final = (1.5, 1.5, 2.0)
"""Units in which most change sides: there room to land lacks."""
_TRIES: Final = 200
_PILOTS: Final = get_args(Pilot)


class _Swarm(NamedTuple):
    """What happenings and orders name."""

    ids: list[int]
    shapes: list[str]
    groups: list[str]
    waiting: list[int]
    """On the ground, to be launched."""


def draw(
    seed: int, number: int, wanted: Coverage, of: Data | None = None
) -> tuple[Scenario, LoadedMission]:
    """The scenario of this number, and its mission.

    Args:
        seed: of all scenarios.
        number: from 0.
        wanted: what was met before: what was not is drawn more often.
        of: a user's mission, as data; weather, mesh and happenings alone are drawn around it.

    Raises:
        InputError: none of many tries may fly: the mission itself is refused.
    """
    why = ""
    for attempt in range(_TRIES):
        dice = Dice(seed, number, attempt)
        try:
            data = _scenario(dice, wanted, f"drawn-{seed}-{number}", of)
            scenario, mission = scenario_of(yaml_file.write(data))
            refuse_too_close(mission, forecast(mission.plan))
        except (InputError, MissionError) as error:  # drawn outside of what is allowed: again
            why = str(error)
        else:
            return scenario, mission
    raise InputError(f"no scenario of {_TRIES} may fly: {why}")


def _scenario(dice: Dice, wanted: Coverage, name: str, of: Data | None) -> Data:
    fair = dice.chance(_FAIR)
    happens: list[Data] = []
    losses: list[Data] = []
    if of is None:
        mission, happens = _mission(dice, wanted, fair=fair)
        if not fair and dice.chance(_TWO_LOSSES):
            losses = _two_losses(dice, mission)
        elif not fair and dice.chance(_ENDED):
            losses = _ended(dice, mission)
        if "fence" not in mission:
            _fence(mission, dice, fair=fair)
        _zones(mission, dice)
    else:
        mission = dict(of)
    scenario: Data = {"version": 1, "name": name, "mission": mission, "seed": dice.whole(0, 10**6)}
    ids = sorted(agent["id"] for agent in mission["agents"])
    if dice.chance(3.0 * _OTHER_CLOCKS if fair else _OTHER_CLOCKS):
        ahead_s, drift = dice.signed(0.1, 50, 1), dice.pick((0.0, 1e-4, -5e-4))
        scenario["clocks"] = [{"agents": _some(dice, ids), "ahead_s": ahead_s, "drift": drift}]
    if fair:
        return scenario
    if dice.chance(0.5) and "simulation" not in mission:
        most_mps = most_gusts_mps(_plan_of(mission))
        mission["simulation"] = {"since": "start", "parameters": _weather(dice, most_mps)}
    if dice.chance(0.35):
        quality = {
            "loss": dice.pick((0.0, 0.05, 0.2)),
            "delay_s": dice.pick((0.0, 0.05, 0.1)),
            "jitter_s": dice.pick((0.0, 0.05, 0.1)),
            "duplicate": dice.pick((0.0, 0.1)),
        }
        scenario["mesh"] = {name: value for name, value in quality.items() if value}
    steps = [kind for kind, _ in _flat(mission["steps"])]
    waiting = [agent["id"] for agent in mission["agents"] if agent.get("waits")]
    swarm = _Swarm(ids, [*mission.get("shapes", {})], [*mission.get("groups", {})], waiting)
    scenario["happens"] = losses or happens + _happenings(dice, wanted, swarm, steps)
    if of is None and _changes_sides(mission) and dice.chance(_CROSSED):
        before = [] if dice.chance(_CROSSED_ALONE) and not losses else scenario["happens"]
        scenario["happens"] = before + _crossed(dice, mission)
    if waiting and dice.chance(0.8):
        launch = {"at_s": dice.number(10, 40, 1), "order": f"launch @{waiting[0]}"}
        scenario["happens"].append(launch)
    if dice.chance(_REZONED):
        scenario["happens"] += _rezoned(dice, mission)
    return scenario


def _flat(steps: Sequence[Any]) -> list[tuple[str, Data]]:
    """Kind and body of each step, those of splits among them."""
    found: list[tuple[str, Data]] = []
    for step in steps:
        kind, body = next(iter(step.items())) if isinstance(step, dict) else (step, {})
        if kind == "split":
            found += [each for part in body.values() for each in _flat(part)]
        else:
            found.append((kind, body or {}))
    return found


def _two_losses(dice: Dice, mission: Data) -> list[Data]:
    """Two things that policies are for, one soon after the other, to the end; the first policy
    holds mostly. Then perhaps an order. The mission waits for them, in the air."""
    ids = sorted(agent["id"] for agent in mission["agents"])
    one = dice.pick(ids)
    found: list[Data] = []
    at_s = dice.number(14, 30, 1)
    for k, (policy, happening) in enumerate(dice.shuffled(_losses(dice, one, ids))[:2]):
        mission["policies"][policy] = dice.pick(_ACTIONS, lambda act: 4 if act == "hold" else 1)
        if policy == "fence":
            _fence(mission, dice, fair=False, always=True)
            mission["policies"]["estimate"] = dice.pick(("continue", "hold"))  # it jumps, too
        if k == 1 and mission["policies"][policy] == "hold":
            mission["policies"][policy] = dice.pick(("land", "return"))
        found.append({"at_s": at_s} | happening)
        at_s = round(at_s + dice.number(0.5, 12, 1), 1)
    _waits_in_the_air(dice, mission)
    if dice.chance(0.3):
        found.append({"at_s": at_s, "order": dice.pick(("land", "return", f"land @{one}"))})
    return found


def _ended(dice: Dice, mission: Data) -> list[Data]:
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
        _fence(mission, dice, fair=False, always=True)
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
    some = _some(dice, ids)

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


def _crossed(dice: Dice, mission: Data) -> list[Data]:
    """What befalls agents that change sides, before or as they pass each other. Two orders to land
    let some come down where others are in the air, or stand. Where one falls silent, the others
    mostly go on, past the place where it may be. One that is not where it says comes too near, for
    the verdict to tell."""
    ids = sorted(agent["id"] for agent in mission["agents"])
    some = " @" + ",".join(map(str, _some(dice, ids)))
    up, apart = (step.expected_s or 0.0 for step in forecast(_plan_of(mission))[:2])
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


def _plan_of(mission: Data) -> Plan:
    return loads(yaml_file.write(mission)).plan


def _rezoned(dice: Dice, mission: Data) -> list[Data]:
    """Orders in flight: a zone where a vehicle may be, or near it, or between two places of the
    plan; perhaps another one, and perhaps the first one lifted."""
    plan = _plan_of(mission)
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


def _weather(dice: Dice, most_mps: float) -> Data:
    """`most_mps`: of gusts."""
    wind = {"SIM_WIND_SPD": dice.number(1, 6, 1), "SIM_WIND_DIR": dice.whole(0, 359)}
    gusts_mps = min(dice.number(0.2, 1.3, 1), math.floor(10.0 * most_mps) / 10.0)
    gusts = {"SIM_WIND_SPD": 2.0, "SIM_WIND_GUST": gusts_mps}
    noise = {"SIM_GPS_NOISE": dice.number(0.05, 0.3)}
    drift = {"SIM_GPS_DRIFT": dice.number(0.1, 0.4)}
    return dice.pick((wind, gusts, noise, drift, wind | noise))


# --- what happens ---


def _happenings(dice: Dice, wanted: Coverage, swarm: _Swarm, steps: list[str]) -> list[Data]:
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


def _answer(dice: Dice, happening: Data, swarm: _Swarm) -> list[Data]:
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


def _happening(dice: Dice, what: str, at_s: float, swarm: _Swarm) -> list[Data]:
    kind, _, which = what.partition(" ")
    ids = swarm.ids
    happening: Data = {"at_s": at_s}
    match kind:
        case "order":
            happening["order"] = _order(dice, which, swarm)
        case "kill":
            happening["kill"] = _some(dice, ids)
        case "restart":
            agents = [dice.pick(ids)]
            dead_s = dice.pick((0.5, 1.0, 2.0, 5.0, 12.0))
            killed = {"at_s": max(0.1, round(at_s - dead_s, 1)), "kill": agents}
            return [killed, happening | {"restart": list(agents)}]
        case "stop":
            happening |= {"stop": _some(dice, ids), "for_s": dice.number(0.2, 12, 1)}
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
            happening["pilot"] = {"agents": _some(dice, ids), "mode": which}
        case "vehicle":
            happening["vehicle"] = {"agents": _some(dice, ids), "set": _fault(dice, which)}
            happening |= {} if which == "REBOOT" else _for_s(dice, 20)
        case "clock":
            jump_s = dice.pick((0.3, 0.8, 2.0, 20.0, 3600.0))
            jump_s = jump_s if dice.chance(0.5) else -jump_s
            happening["clock"] = {"agents": _some(dice, ids), "ahead_s": jump_s}
        case _:
            says: Data = {"agents": _some(dice, ids)}
            if dice.chance(0.5):
                says["moved_m"] = [dice.signed(1, 30, 1), dice.signed(1, 30, 1)]
            else:
                field = dice.pick(("step", "override", "gains_tag", "stage"))
                says["set"] = {field: dice.pick((0, 1, 2, 3, 9, 255))}
            happening |= {"says": says, "for_s": dice.number(0.2, 20, 1)}
    return [happening]


def _order(dice: Dice, kind: str, swarm: _Swarm) -> str:
    ids, shapes = swarm.ids, swarm.shapes
    few = " @" + ",".join(map(str, _some(dice, ids)))
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


def _some(dice: Dice, ids: Sequence[int]) -> list[int]:
    """One of them mostly, seldom all."""
    most = len(ids)
    count = dice.pick((1, 1, 1, 1, min(2, most), min(2, most), most))
    return dice.some(ids, count)


# --- the mission ---


def _mission(dice: Dice, wanted: Coverage, *, fair: bool) -> tuple[Data, list[Data]]:
    """A mission's data, which `validate` may still refuse; and what is to befall it."""
    variant = dice.pick([*_VARIANTS], _VARIANTS.__getitem__)
    count = dice.pick((2, 3, 4, 5, 6, 7, 8), lambda n: {2: 34, 3: 30, 4: 20}.get(n, 4))
    count = dice.pick(
        {
            "split": (4, 4, 5, 6, 7),
            "stack": (2, 3, 4, 6),
            "column": (3, 4, 5),
            "swap": (count, 4, 5),
        }.get(variant, (count,))
    )
    small = variant == "swap" and dice.chance(0.7)
    unit_m = dice.pick(_SMALL if small else (1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 5.0))
    r_in = dice.number(max(0.4, 1.0 / unit_m), 0.75)
    spacing = _APART * 1.5 + dice.pick((0.02, 0.1, 0.4))
    mission: Data = {
        "version": 1,
        "name": "drawn",
        "origin": dict(zip(("lat_deg", "lon_deg", "alt_m"), dice.pick(_ORIGINS), strict=True)),
        "unit_m": unit_m,
        "law": {"r": _R, "r_out": 1.5, "r_in": r_in, **_gains(dice)},
    }
    if dice.chance(0.85):  # half the work; a tenth flies the usual rate
        mission["tick_s"] = 0.1
    if dice.chance(0.4):
        mission["vehicle"] = _vehicle(dice)
    if not fair and dice.chance(0.1):
        off = dice.pick(("guard", "release", "align"))
        mission["safety"] = {off: False}
    mission["prepare_timeout_s"] = dice.number(25, 40, 0)
    mission["policies"] = _policies(dice)
    ids = _ids(dice, count)
    starts = _starts(dice, count, max(1.02 * 1.5, r_in + _TAKEOFF_M / unit_m), r_in)
    mission["agents"] = [{"id": i, "start": list(p)} for i, p in zip(ids, starts, strict=True)]
    if dice.chance(0.15):
        mission["neighbours"] = _links(dice, ids)
    mission["shapes"] = {name: _shape(dice, count, spacing) for name in ("one", "other")}
    speed_mps = mission.get("vehicle", {}).get("limits", {}).get("speed_mps", 3.0)
    mission["steps"] = _steps(dice, wanted, ids, speed_mps, fair=fair)
    happens = _VARIED[variant](dice, mission, spacing) if variant else []
    follows = any(kind == "follow" for kind, _ in _flat(mission["steps"]))
    if follows and "targets" not in mission:
        mission["targets"] = {"boat": _target(dice, speed_mps, unit_m)}
    mission["fleet"] = _fleet(dice, ids, (1.5 - r_in) * unit_m, fair=fair)
    return (_in_metres(mission) if dice.chance(0.1) else mission), happens


def _changes_sides(mission: Data) -> bool:
    """By `_swap`: both its shapes have fixed slots."""
    forms = [body for kind, body in _flat(mission["steps"]) if kind == "form"]
    return len(forms) == 2 and all(form.get("slots") == "fixed" for form in forms)


def _swap(dice: Dice, mission: Data, spacing: float) -> list[Data]:
    """All change sides: each flies through the middle to the slot opposite to its own, or to any
    other agent's."""
    count = len(mission["agents"])
    points = [list(point) for point in _scattered(dice, count, spacing, 2 * spacing)]
    if dice.chance(0.5):
        turn = 2 * math.pi / count
        radius = round(max(1.0, 1.0 / (2 * math.sin(turn / 2))) * (spacing + 0.02), 2)
        points = [
            [round(radius * math.cos(turn * k), 3), round(radius * math.sin(turn * k), 3)]
            for k in range(count)
        ]
        others = [[-north, -east] for north, east in points]
    else:
        others = [[round(-n, 3), round(-e, 3)] for n, e in reversed(dice.shuffled(points))]
    for name, offsets in zip(("one", "other"), (points, others), strict=True):
        mission["shapes"][name] = {"kind": "offsets", "offsets": offsets}
    forms = [_formed(name, 90.0, slots="fixed") for name in _SHAPES]
    mission["steps"] = [mission["steps"][0], *forms, mission["steps"][-1]]
    return []


def _stack(dice: Dice, mission: Data, spacing: float) -> list[Data]:
    """A ring too narrow for one height, in layers that turn; all leave it for a shape at one
    height."""
    count = len(mission["agents"])
    layers = dice.pick([k for k in (2, 3) if count % k == 0])
    turn, apart_m = 2 * math.pi / count, dice.number(5.5, 8, 1)
    radius = dice.number(0.25, 0.6)
    if count > layers:
        radius = round((spacing + 0.02) / (2 * math.sin(0.5 * layers * turn)), 2)
    mission["wake"] = {"rotor_distance_m": 0.16, "mass_kg": 0.25}
    names = [name for name in _SHAPES if name == "one" or dice.chance(0.7)]
    for k, name in enumerate(names):
        mission["shapes"][name] = {
            "kind": "offsets",
            "offsets": [
                [
                    round(radius * math.cos(turn * place), 3),
                    round(radius * math.sin(turn * place), 3),
                ]
                for place in range(count)
            ],
            "up_m": [round(apart_m * ((place + k) % layers), 1) for place in range(count)],
        }
    mission["shapes"]["flat"] = {"kind": "grid", "spacing": round(spacing + 0.02, 2)}
    forms = [_formed(name, 120.0, slots="fixed") for name in (*names, "flat")]
    mission["steps"] = [mission["steps"][0], *forms, mission["steps"][-1]]
    return []


def _formed(shape: str, timeout_s: float, **more: Any) -> Data:
    return {"form": {"shape": shape, "settle_s": 1.0, "timeout_s": timeout_s, **more}}


def _column(dice: Dice, mission: Data, spacing: float) -> list[Data]:
    """One behind the other, all follow a boat or move on; then one stays, falls silent or is taken,
    or there is a zone, in the way of those behind: who is held up is so within the formation."""
    ids, unit_m = sorted(agent["id"] for agent in mission["agents"]), mission["unit_m"]
    spacing, way = round(spacing + 0.02, 2), dice.signed(8, 14, 1)
    mission["shapes"]["one"] = {"kind": "column", "spacing": spacing}
    norths, easts = zip(*(agent["start"] for agent in mission["agents"]), strict=True)
    north, east = sum(norths) / len(ids), sum(easts) / len(ids)
    speed_mps = mission.get("vehicle", {}).get("limits", {}).get("speed_mps", 3.0)
    on: Data = {"move": {"by": [way, 0.0], "settle_s": 1.0, "timeout_s": 90.0}}
    if dice.chance(0.7):
        along = [[round(north, 2), round(east, 2)], [round(north + 4 * way, 2), round(east, 2)]]
        quick = round(dice.number(0.4, 0.8) * speed_mps, 1)
        mission["targets"] = {"boat": {"along": along, "speed_mps": quick, "height_m": 0.0}}
        on = {"follow": {"target": "boat", "duration_s": dice.number(12, 18, 0)}}
    form = _formed("one", 60.0, slots="fixed")
    mission["steps"] = [mission["steps"][0], form, on, mission["steps"][-1]]
    at_s, one = dice.number(18, 30, 1), dice.pick((ids[0], ids[-1], dice.pick(ids)))
    if dice.chance(0.6):
        mission["policies"] |= {"agent_lost": "continue", "left_by_order": "continue"}
        stays: tuple[Data, ...] = (
            {"order": f"expel @{one}"},
            {"order": f"hold @{one}"},
            {"kill": [one]},
            {"stop": [one], "for_s": dice.number(1, 10, 1)},
            {"pilot": {"agents": [one], "mode": "hold"}},
        )
        return [{"at_s": at_s} | dice.pick(stays)]
    ahead = math.copysign((len(ids) - 1) / 2 * spacing + dice.number(0.8, 3), way)
    at = f"{(north + ahead) * unit_m:.1f} {east * unit_m + dice.signed(0, 1, 1):.1f}"
    return [{"at_s": at_s, "order": f"zone add post circle {at} {dice.number(0.3, 1.5):g}"}]


def _split(dice: Dice, mission: Data, spacing: float) -> list[Data]:
    """Two or three groups fly apart, perhaps wait for each other, and join, or land by
    themselves. Perhaps one agent waits on the ground."""
    ids = dice.shuffled(sorted(agent["id"] for agent in mission["agents"]))
    names = ["red", "blue", "green"][: dice.pick((2, 2, 3)) if len(ids) > 5 else 2]
    size = len(ids) // len(names) - (1 if len(ids) > 2 * len(names) and dice.chance(0.3) else 0)
    mission["groups"] = {n: sorted(ids[k * size : (k + 1) * size]) for k, n in enumerate(names)}
    mission["shapes"] = {name: _shape(dice, len(ids), spacing, fits=True) for name in _SHAPES}
    if dice.chance(0.25):
        dice.pick(mission["agents"])["waits"] = True
    gap = {"on_gap": "close"} if dice.chance(0.4) else {}
    meet = dice.some(names, 2) if dice.chance(0.6) else []
    parts: dict[str, list[Data]] = {}
    for k, (name, members) in enumerate(mission["groups"].items()):
        turn, way = 2 * math.pi * (k + dice.number(0, 0.1)) / len(names), dice.number(3.5, 6, 1)
        by = [round(way * math.cos(turn), 2), round(way * math.sin(turn), 2)]
        steps: list[Data] = [{"move": {"by": by, "settle_s": 1.0, "timeout_s": 60.0}}]
        for kind in dice.some(("form", "hold", "move", "rotate"), dice.whole(0, 2)):
            body = _body(dice, kind, members, 1.5, fair=True)
            flat = {key: value for key, value in body.items() if key != "layers"}
            steps.append({kind: flat | gap} if kind == "form" else {kind: body})
        if name in meet:
            steps.insert(dice.whole(1, len(steps)), {"barrier": {"name": "meet"}})
        if dice.chance(0.15) and name != names[0]:
            steps.append({dice.pick(("land", "return")): {}})
        parts[name] = steps
    between = [_formed("other", 90.0, **gap)] if dice.chance(0.7) else []
    first, last = mission["steps"][0], mission["steps"][-1]
    mission["steps"] = [first, _formed("one", 60.0, **gap), {"split": parts}, *between, last]
    return []


_VARIED: Final[dict[str, Callable[[Dice, Data, float], list[Data]]]] = {
    "swap": _swap,
    "stack": _stack,
    "column": _column,
    "split": _split,
}
_SHAPES: Final = ("one", "other")


def _gains(dice: Dice) -> Data:
    gains: Data = {}
    if dice.chance(0.15):
        gains["h"] = dice.pick((0.1, 0.15, 0.2))
    if dice.chance(0.1):
        gains["delta_a"] = dice.number(0.05, 0.3)
    if dice.chance(0.1):
        gains["delta_l"] = dice.number(2.0, 2.2)
    return gains


def _vehicle(dice: Dice) -> Data:
    return {
        "limits": {
            "speed_mps": dice.number(1.5, 4.0, 1),
            "climb_mps": dice.number(0.8, 1.5, 1),
            "descent_mps": dice.number(0.8, 1.4, 1),
        }
    }


def _policies(dice: Dice) -> Data:
    """Some of them, each with what it may say; a third of the missions has the defaults."""
    given: Data = {"override_pause_s": dice.pick((5.0, 10.0, 20.0))}
    for name in (
        "agent_lost",
        "station_lost",
        "left_by_order",
        "fence",
        "battery_low",
        "too_fast",
        "wind",
        "estimate",
    ):
        if dice.chance(0.35):
            given[name] = dice.pick(_ACTIONS)
    for name, low, high, digits in (
        ("agent_lost_after_s", 2.0, 6.0, 1),
        ("station_lost_after_s", 2.0, 6.0, 1),
        ("hold_before_land_s", 0.0, 4.0, 1),
        ("return_separation_m", 0.0, 3.0, 1),
        ("battery_reserve_percent", 5.0, 30.0, 0),
    ):
        if dice.chance(0.25):
            given[name] = dice.number(low, high, digits)
    return given


def _ids(dice: Dice, count: int) -> list[int]:
    if dice.chance(0.8):
        return list(range(1, count + 1))
    ids = list(range(1, 1 + 3 * count))
    return dice.shuffled(dice.some(ids, count)) if dice.chance(0.5) else dice.some(ids, count)


def _starts(dice: Dice, count: int, apart: float, r_in: float) -> list[Point]:
    """In a line, a grid or anyhow, each within r of another one."""
    if dice.chance(0.06):  # `validate` warns of it
        apart = dice.number(1.5 * r_in, apart)
    most = max(0.95 * _R, apart)
    how = dice.pick(("line", "column", "grid", "random", "random"))
    if how == "random":
        return _scattered(dice, count, apart, most)
    step = round(min(apart * dice.number(1.0, 1.6) + 0.01, most), 2)
    columns = {"line": count, "column": 1}.get(how, math.ceil(math.sqrt(count)))
    at = dice.number(-3, 3), dice.number(-3, 3)
    places = (divmod(k, columns) for k in range(count))
    return [(round(at[0] + step * n, 2), round(at[1] + step * e, 2)) for n, e in places]


def _scattered(dice: Dice, count: int, apart: float, most: float) -> list[Point]:
    """Each at least `apart` from all others, and at most `most` from one of them."""
    points: list[Point] = [(0.0, 0.0)]
    while len(points) < count:
        north, east = dice.pick(points)
        turn, way = dice.number(0, 2 * math.pi, 4), dice.number(apart + 0.02, most)
        point = round(north + way * math.cos(turn), 2), round(east + way * math.sin(turn), 2)
        if all(math.dist(point, each) >= apart for each in points):
            points.append(point)
    return points


def _links(dice: Dice, ids: list[int]) -> list[list[int]]:
    """A tree, and some more."""
    order = dice.shuffled(ids)
    tree = [[dice.pick(order[:k]), order[k]] for k in range(1, len(order))]
    others = [[i, j] for i, j in itertools.combinations(order, 2)]
    more = [pair for pair in others if sorted(pair) not in list(map(sorted, tree))]
    return tree + dice.some(more, dice.whole(0, len(more)))


def _shape(dice: Dice, count: int, spacing: float, *, fits: bool = False) -> Data:
    """`fits`: also fewer agents than these."""
    kinds = ["ring", "line", "column", "grid", "vee", "wedge"]
    if not fits:
        kinds += _of_all(count)
    kind = dice.pick(kinds)
    shape: Data = {"kind": kind}
    wide = round(spacing * dice.number(1.0, 1.3) + 0.01, 2)
    if kind == "offsets":
        points = _scattered(dice, count, spacing, 2 * spacing)
        shape["offsets"] = [list(point) for point in points]
    elif kind == "ring":
        around = wide / (2 * math.sin(math.pi / count))
        by_radius = not fits and dice.chance(0.4)
        shape |= {"radius": round(around + 0.01, 2)} if by_radius else {"side": wide}
    elif kind == "circle":
        chord = wide / (2 * math.sin(math.pi / (count - 1)))
        shape["radius"] = round(max(wide, chord) + 0.01, 2)
    elif kind == "star":
        shape["inner_radius"] = round(wide * 1.2, 2)
        shape["radius"] = round(shape["inner_radius"] + wide, 2)
    elif kind == "letters":
        shape |= {"text": dice.pick("ILVTX"), "height": round(wide * count * 0.9, 1)}
    else:
        shape["spacing"] = wide
    if kind == "vee" and dice.chance(0.5):
        shape["angle_deg"] = dice.number(60, 150, 0)
    if kind == "grid" and not fits and dice.chance(0.3):
        shape["columns"] = dice.whole(1, count)
    if dice.chance(0.4):
        shape["rotation_deg"] = dice.number(-180, 180, 0)
    return shape


def _of_all(count: int) -> list[str]:
    """Kinds of shapes that so many agents fill, and fewer may not."""
    kinds = ["offsets"] + ["circle"] * (count > 2)
    return kinds + ["star"] * (count > 3) + ["letters"] * (count > 2)


def _steps(
    dice: Dice, wanted: Coverage, ids: list[int], speed_mps: float, *, fair: bool
) -> list[Data]:
    steps: list[Data] = [{"takeoff": {"height_m": dice.number(2, 6, 1)}}]
    between = ("form", "hold", "move", "rotate", "scale", "follow")
    kinds = ["form"] if dice.chance(0.95) else []
    kinds += [
        dice.pick(between, wanted.wants_step) for _ in range(dice.whole(0, 2) if kinds else 0)
    ]
    steps += [{kind: _body(dice, kind, ids, speed_mps, fair=fair)} for kind in kinds]
    steps.append({dice.pick(("land", "return"), wanted.wants_step): {}})
    for entry in steps[:-1]:
        if dice.chance(0.4):
            next(iter(entry.values()))["on_timeout"] = dice.pick(_ACTIONS)
    return steps


def _body(dice: Dice, kind: str, ids: list[int], speed_mps: float, *, fair: bool) -> Data:
    if kind == "hold":
        return {"duration_s": dice.number(1, 6, 1)}
    if kind == "follow":
        follows: Data = {"target": "boat", "duration_s": dice.number(4, 15, 1)}
        if dice.chance(0.7):
            follows |= {"offset": [dice.signed(0, 2), dice.signed(0, 2)]}
            follows |= {"offset_in": "course"} if dice.chance(0.5) else {}
        return follows
    body: Data = {"settle_s": dice.number(0.5, 2.5, 1)}
    if dice.chance(0.3):
        body["tolerance_m"] = dice.number(0.4, 0.9, 1)
    if kind == "form":
        body |= {"shape": dice.pick(("one", "other")), "timeout_s": 60.0}
        if not fair and dice.chance(0.2):
            body["timeout_s"] = dice.number(2, 9, 1)
        if dice.chance(0.25):
            body["slots"] = "fixed"
        if dice.chance(0.2):
            body["exchange"] = dice.chance(0.5)
        if dice.chance(0.3):
            how = dice.pick(("keep", "rechoose", "links"))
            body["neighbours"] = _links(dice, ids) if how == "links" else how
        if dice.chance(_LAYERED):
            body["layers"] = dice.whole(2, 3)
        return body
    if dice.chance(0.4):
        body["speed_mps"] = dice.number(0.8, min(2.5, speed_mps), 1)
    if kind == "rotate":
        body["angle_deg"] = dice.signed(15, 120, 0)
    elif kind == "scale":
        body["factor"] = dice.number(1.0, 1.5)
    else:
        point = [dice.signed(0.3, 3), dice.signed(0.3, 3)]
        how = dice.pick(("to", "by", "along"))
        body[how] = [point, [dice.signed(0.3, 2), dice.signed(0.3, 2)]] if how == "along" else point
    return body


def _target(dice: Dice, speed_mps: float, unit_m: float) -> Data:
    """One that is played: through some points near the starts."""
    way = [[dice.signed(0, 5, 1), dice.signed(0, 5, 1)] for _ in range(dice.whole(2, 4))]
    way[1] = [way[1][0] + 6.0 / unit_m, way[1][1]]  # never the first one again
    return {"along": way, "speed_mps": dice.number(0.3, 1.2 * speed_mps, 1), "height_m": 0.0}


def _fleet(dice: Dice, ids: list[int], room_m: float, *, fair: bool) -> Data:
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


def _fence(mission: Data, dice: Dice, *, fair: bool, always: bool = False) -> None:
    """Draw a fence around all places that the plan goes to; in fair weather with room to spare."""
    if not always and dice.chance(0.6):
        return
    plan = _plan_of(mission)
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


def _zones(mission: Data, dice: Dice) -> None:
    """Draw zones between the places that the plan goes to: trees, huts, and walls that lines to
    places and ways of a `move` meet."""
    if dice.chance(0.7) or "zones" in mission:
        return
    plan = _plan_of(mission)
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


def _in_metres(mission: Data) -> Data:
    """The same mission with `lengths: metres`."""
    unit_m = mission.pop("unit_m")

    def metres(value: Any) -> Any:
        return [metres(v) for v in value] if isinstance(value, list) else round(value * unit_m, 2)

    for name in ("r", "r_out", "r_in"):
        mission["law"][name] = metres(mission["law"][name])
    for agent in mission["agents"]:
        agent["start"] = metres(agent["start"])
    lengths = ("side", "radius", "inner_radius", "spacing", "height", "offsets")
    for shape in mission["shapes"].values():
        shape |= {name: metres(shape[name]) for name in lengths if name in shape}
    for zone in mission.get("zones", {}).values():
        zone |= {name: metres(zone[name]) for name in ("circle", "radius")}
    for _, body in _flat(mission["steps"]):
        names = ("to", "by", "along", "offset")
        body |= {name: metres(body[name]) for name in names if name in body}
    for target in mission.get("targets", {}).values():
        target["along"] = metres(target["along"])
    return {"lengths": "metres", **mission}
