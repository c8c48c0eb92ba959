"""Missions of few agents, inside the envelope of docs/understand/safety-evidence.md. Lengths are
the law's units until the end.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from typing import Any, Final

from swarm_ctl.core.model.plan import Policy
from swarm_ctl.fuzz.coverage import Coverage
from swarm_ctl.fuzz.draw.dice import Data, Dice, Point
from swarm_ctl.fuzz.draw.surroundings import drawn_fleet, drawn_vehicle

_ORIGINS: Final = ((-35.363262, 149.165237, 584.0), (47.4, 8.55, 450.0))
ACTIONS: Final = tuple(policy.value for policy in Policy)
_R: Final = 4.5
_APART: Final = 1.26
"""Of slots, by the envelope, in r_out."""
_TAKEOFF_M: Final = 4.0
"""Between starts, besides r_in, as docs/understand/safety-evidence.md advises."""
_VARIANTS: Final = {"": 54, "swap": 24, "stack": 8, "column": 8, "split": 12}
"""How often a mission has steps of its own kind (`_VARIED`)."""
_LAYERED: Final = 0.15
"""Of `form` steps: their slots lie at several heights."""
_SMALL: Final = (1.5, 1.5, 2.0)
"""Units in which most change sides: there room to land lacks."""


def flat_steps(steps: Sequence[Any]) -> list[tuple[str, Data]]:
    """Kind and body of each step, those of splits among them."""
    found: list[tuple[str, Data]] = []
    for step in steps:
        kind, body = next(iter(step.items())) if isinstance(step, dict) else (step, {})
        if kind == "split":
            found += [each for part in body.values() for each in flat_steps(part)]
        else:
            found.append((kind, body or {}))
    return found


def drawn_mission(dice: Dice, wanted: Coverage, *, fair: bool) -> tuple[Data, list[Data]]:
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
        mission["vehicle"] = drawn_vehicle(dice)
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
    follows = any(kind == "follow" for kind, _ in flat_steps(mission["steps"]))
    if follows and "targets" not in mission:
        mission["targets"] = {"boat": _target(dice, speed_mps, unit_m)}
    mission["fleet"] = drawn_fleet(dice, ids, (1.5 - r_in) * unit_m, fair=fair)
    return (_in_metres(mission) if dice.chance(0.1) else mission), happens


def changes_sides(mission: Data) -> bool:
    """By `_swap`: both its shapes have fixed slots."""
    forms = [body for kind, body in flat_steps(mission["steps"]) if kind == "form"]
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
            given[name] = dice.pick(ACTIONS)
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
            next(iter(entry.values()))["on_timeout"] = dice.pick(ACTIONS)
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
    for _, body in flat_steps(mission["steps"]):
        names = ("to", "by", "along", "offset")
        body |= {name: metres(body[name]) for name in names if name in body}
    for target in mission.get("targets", {}).values():
        target["along"] = metres(target["along"])
    return {"lengths": "metres", **mission}
