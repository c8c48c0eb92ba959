"""Makes a scenario that breaks an invariant smaller, as long as it breaks the same one."""

from __future__ import annotations

import copy
import itertools
from collections.abc import Callable, Iterator
from typing import Any, Final, TypeAlias

from swarm_ctl.errors import InputError, MissionError
from swarm_ctl.fuzz.campaign import fly, kind_of
from swarm_ctl.fuzz.invariants.table import Broken, Invariant
from swarm_ctl.mission.input import yaml_file
from swarm_ctl.virtual.scenario import Scenario, scenario_of

Data: TypeAlias = dict[str, Any]

MOST: Final = 150
"""Flights that one scenario is worth."""
_NEEDED: Final = ("version", "name", "mission", "seed")
_OF_MISSION: Final = ("version", "name", "origin", "law", "agents", "steps", "shapes")


def shrink(
    scenario: Scenario, first: Broken, say: Callable[[str], None] = lambda _: None
) -> Scenario | None:
    """The smallest scenario that was found: fewest agents, steps, happenings, settings, and round
    times. None: it does not break any more, as where it was mended since. `say` is told each one
    that is smaller."""
    return _Shrinker(first, say).smallest(scenario)


class _Shrinker:
    def __init__(self, first: Broken, say: Callable[[str], None]) -> None:
        self._first, self._say = first, say
        self._flown = 0
        self._tried = set[str]()

    def smallest(self, scenario: Scenario) -> Scenario | None:
        data = yaml_file.parse(
            yaml_file.write(scenario.model_dump(mode="json", exclude_unset=True, by_alias=True)),
            "scenario",
        ).data
        best: Data = dict(data)
        if not self._breaks(best):
            return None
        at, again = 0, False
        while self._flown < MOST:
            smaller = next(itertools.islice(_smaller(best), at, None), None)
            if smaller is not None and self._breaks(smaller):
                # on from here: what did not do before will mostly not do now
                best, again = smaller, True
                self._say(_size(best))
            elif smaller is not None:
                at += 1
            elif again:
                at, again = 0, False
            else:
                break
        return scenario_of(yaml_file.write(best))[0]

    def _breaks(self, data: Data) -> bool:
        """The same invariant; of errors, one of the same words."""
        text = yaml_file.write(data)
        if text in self._tried:
            return False
        self._tried.add(text)
        try:
            scenario, mission = scenario_of(text)
        except (InputError, MissionError):
            return False  # no scenario at all
        self._flown += 1
        alike = self._first.invariant
        for each in fly(scenario, mission, twice=alike is Invariant.SAME)[1]:
            if each.invariant is alike:
                words = kind_of(each.text), kind_of(self._first.text)
                return alike is not Invariant.RAISES or len({*words}) == 1
        return False


def _size(data: Data) -> str:
    mission = data["mission"]
    counts = len(mission["agents"]), len(mission["steps"]), len(data.get("happens", ()))
    return "{} agents, {} steps, {} happenings".format(*counts)


def _smaller(data: Data) -> Iterator[Data]:
    """Scenarios that are smaller by one thing, the greatest first."""
    happens, mission = data.get("happens", []), data["mission"]
    if len(happens) > 3:
        yield data | {"happens": happens[: len(happens) // 2]}
        yield data | {"happens": happens[len(happens) // 2 :]}
    for k in range(len(happens)):
        yield data | {"happens": happens[:k] + happens[k + 1 :]}
    if isinstance(mission, dict):
        for smaller in _smaller_missions(mission):
            named = {agent["id"] for agent in smaller["agents"]}
            yield _without_others(data | {"mission": smaller}, named)
    for key in [key for key in data if key not in _NEEDED and key != "happens"]:
        yield _less(data, key)
    for name in data.get("mesh", ()):
        yield data | {"mesh": _less(data["mesh"], name)}
    for k, happening in enumerate(happens):
        for simpler in _simpler(happening):
            yield data | {"happens": [*happens[:k], simpler, *happens[k + 1 :]]}


def _smaller_missions(mission: Data) -> Iterator[Data]:
    agents, steps = mission["agents"], mission["steps"]
    for agent in reversed(agents) if len(agents) > 1 else ():
        yield _without(mission, agent["id"])
    for k in range(1, len(steps) - 1):
        yield mission | {"steps": steps[:k] + steps[k + 1 :]}
    for key in [key for key in mission if key not in _OF_MISSION]:
        yield _less(mission, key)
    for key in ("policies", "law", "simulation", "vehicle", "fence", "zones"):
        for name in mission.get(key, ()):
            yield mission | {key: _less(mission[key], name)}
    weather = mission.get("simulation", {}).get("parameters", ())
    for name in weather:
        parameters = {"parameters": _less(weather, name)}
        yield mission | {"simulation": mission["simulation"] | parameters}
    fleet = mission.get("fleet")
    entries = fleet["agents"] if isinstance(fleet, dict) else []
    for name in ("response", "simulated_response", "autopilot"):
        if any(name in entry for entry in entries):
            simpler = [_less(entry, name) for entry in entries]
            yield mission | {"fleet": mission["fleet"] | {"agents": simpler}}
    for k, step in enumerate(steps):
        (kind, body), *_ = step.items() if isinstance(step, dict) else [(step, {})]
        if kind == "split":
            for group, part in body.items():
                for j in range(len(part) if len(part) > 1 else 0):
                    parts = body | {group: part[:j] + part[j + 1 :]}
                    yield mission | {"steps": [*steps[:k], {kind: parts}, *steps[k + 1 :]]}
        for name in body or ():
            yield mission | {"steps": [*steps[:k], {kind: _less(body, name)}, *steps[k + 1 :]]}
    used = {
        step["form"].get("shape") for step in steps if isinstance(step, dict) and "form" in step
    }
    for name in [name for name in mission.get("shapes", {}) if name not in used]:
        yield mission | {"shapes": _less(mission["shapes"], name)}


def _less(data: Data, key: str) -> Data:
    """All but this."""
    return {name: value for name, value in data.items() if name != key}


def _without(mission: Data, agent: int) -> Data:
    """The mission without this agent: offsets lose their last place."""
    smaller = copy.deepcopy(mission)
    smaller["agents"] = [each for each in smaller["agents"] if each["id"] != agent]
    fleet = smaller.get("fleet")
    if isinstance(fleet, dict):
        fleet["agents"] = [each for each in fleet["agents"] if each["id"] != agent]
    for shape in smaller.get("shapes", {}).values():
        if "offsets" in shape:
            shape["offsets"] = shape["offsets"][: len(smaller["agents"])]
    for name, members in smaller.get("groups", {}).items():
        smaller["groups"][name] = [each for each in members if each != agent]
    links = smaller.get("neighbours")
    if isinstance(links, list):
        smaller["neighbours"] = [link for link in links if agent not in link]
    return smaller


def _without_others(data: Data, ids: set[int]) -> Data:
    """The scenario without what befalls agents that are not in its mission."""

    def kept(value: Any) -> Any:
        if isinstance(value, dict):
            return {name: kept(each) for name, each in value.items()}
        if isinstance(value, list) and value and all(isinstance(each, int | str) for each in value):
            return [each for each in value if isinstance(each, str) or each in ids]
        return value

    happens = [_to_others(kept(each), ids) for each in data.get("happens", [])]
    clocks = [kept(each) for each in data.get("clocks", [])]
    found = {**data, "happens": [each for each in happens if not _of_nobody(each)]}
    if clocks:
        found["clocks"] = [each for each in clocks if each["agents"]]
    return found


def _to_others(happening: Data, ids: set[int]) -> Data:
    """An order without agents that are not in the mission, if others are left."""
    line, mark, named = happening.get("order", "").partition(" @")
    numbers = named.split(",") if mark else []
    if not numbers or not all(number.strip().isdigit() for number in numbers):
        return happening
    left = [number for number in numbers if int(number) in ids]
    return happening | {"order": f"{line} @{','.join(left)}"} if left else happening


def _of_nobody(happening: Data) -> bool:
    lists = [value for value in happening.values() if isinstance(value, list)]
    for value in happening.values():
        if isinstance(value, dict):
            lists += [each for name, each in value.items() if name in ("agents", "one", "other")]
    return any(not each for each in lists)


def _simpler(happening: Data) -> Iterator[Data]:
    """Round times, and no end."""
    at_s = happening["at_s"]
    if at_s != round(at_s):
        yield happening | {"at_s": float(round(at_s))}
    if "for_s" in happening and "stop" not in happening:
        yield _less(happening, "for_s")
    for name in ("kill", "restart", "stop"):
        for agents in _fewer(happening.get(name, [])):
            yield happening | {name: agents}
    for name in ("pilot", "vehicle", "clock", "says", "part"):
        body = happening.get(name, {})
        for key in ("agents", "one", "other"):
            for agents in _fewer(body.get(key, [])):
                yield happening | {name: body | {key: agents}}


def _fewer(these: list[Any]) -> Iterator[list[Any]]:
    """Without one of them, as long as one is left."""
    for k in range(len(these) if len(these) > 1 else 0):
        yield these[:k] + these[k + 1 :]
