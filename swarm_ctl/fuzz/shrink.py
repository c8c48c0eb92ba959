"""Makes a scenario that breaks an invariant smaller, as long as it breaks the same one."""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterator
from typing import Any, Final, TypeAlias

from swarm_ctl.errors import InputError, MissionError
from swarm_ctl.fuzz.campaign import fly
from swarm_ctl.fuzz.invariants import Invariant
from swarm_ctl.mission.input import yaml_file
from swarm_ctl.virtual.scenario import Scenario, scenario_of

Data: TypeAlias = dict[str, Any]

MOST: Final = 150
"""Flights that one scenario is worth."""
_NEEDED: Final = ("version", "name", "mission", "seed")
_OF_MISSION: Final = ("version", "name", "origin", "law", "agents", "steps", "shapes")


def shrink(
    scenario: Scenario, invariant: Invariant, say: Callable[[str], None] = lambda _: None
) -> Scenario:
    """The smallest scenario that was found: fewest agents, steps, happenings, settings, and round
    times. `say` is told each one that is smaller."""
    return _Shrinker(invariant, say).smallest(scenario)


class _Shrinker:
    def __init__(self, invariant: Invariant, say: Callable[[str], None]) -> None:
        self._invariant, self._say = invariant, say
        self._flown = 0

    def smallest(self, scenario: Scenario) -> Scenario:
        data = yaml_file.parse(
            yaml_file.write(scenario.model_dump(mode="json", exclude_unset=True, by_alias=True)),
            "scenario",
        ).data
        best: Data = dict(data)
        again = True
        while again and self._flown < MOST:
            again = False
            for smaller in _smaller(best):
                if self._flown >= MOST:
                    break
                if self._breaks(smaller):
                    best, again = smaller, True
                    self._say(_size(best))
                    break
        return scenario_of(yaml_file.write(best))[0]

    def _breaks(self, data: Data) -> bool:
        try:
            scenario, mission = scenario_of(yaml_file.write(data))
        except (InputError, MissionError):
            return False  # no scenario at all
        self._flown += 1
        return any(each.invariant is self._invariant for each in fly(scenario, mission)[1])


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
        yield {name: value for name, value in data.items() if name != key}
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
        yield {name: value for name, value in mission.items() if name != key}
    for key in ("policies", "law", "simulation", "vehicle"):
        for name in mission.get(key, ()):
            rest = {other: value for other, value in mission[key].items() if other != name}
            yield mission | {key: rest}
    for k, step in enumerate(steps):
        (kind, body), *_ = step.items() if isinstance(step, dict) else [(step, {})]
        for name in body or ():
            rest = {other: value for other, value in body.items() if other != name}
            yield mission | {"steps": [*steps[:k], {kind: rest}, *steps[k + 1 :]]}
    used = {
        step["form"].get("shape") for step in steps if isinstance(step, dict) and "form" in step
    }
    for name in [name for name in mission.get("shapes", {}) if name not in used]:
        shapes = {other: shape for other, shape in mission["shapes"].items() if other != name}
        yield mission | {"shapes": shapes}


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

    happens = [kept(each) for each in data.get("happens", [])]
    clocks = [kept(each) for each in data.get("clocks", [])]
    found = {**data, "happens": [each for each in happens if not _of_nobody(each)]}
    if clocks:
        found["clocks"] = [each for each in clocks if each["agents"]]
    return found


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
        yield {name: value for name, value in happening.items() if name != "for_s"}
    for name in ("kill", "restart", "stop"):
        if len(happening.get(name, ())) > 1:
            yield happening | {name: happening[name][:1]}
