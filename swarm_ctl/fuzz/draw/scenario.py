"""Scenarios that are drawn from a seed: short flights of few agents, inside the envelope of
docs/understand/safety-evidence.md, and what may befall them.

A scenario depends on the seed, its number and what was met before (`Coverage`) alone. Numbers have
few digits, because people read them.
"""

from __future__ import annotations

from typing import Final

from swarm_ctl.errors import InputError, MissionError
from swarm_ctl.fuzz.coverage import Coverage
from swarm_ctl.fuzz.draw.dice import Data, Dice, some_of
from swarm_ctl.fuzz.draw.happenings import (
    Addressees,
    crossed,
    drawn_happenings,
    failed_and_ended,
    rezoned,
    two_losses,
)
from swarm_ctl.fuzz.draw.mission import changes_sides, drawn_mission, flat_steps
from swarm_ctl.fuzz.draw.surroundings import draw_fence, draw_zones, drawn_weather, plan_of
from swarm_ctl.mission.checks.envelope import most_gusts_mps
from swarm_ctl.mission.compile.forecast import forecast, refuse_too_close
from swarm_ctl.mission.compile.loader import LoadedMission
from swarm_ctl.mission.input import yaml_file
from swarm_ctl.virtual.scenario import Scenario, scenario_of

_FAIR: Final = 0.12
"""Of all flights: nothing happens in them, so the forecast has to hold."""
_REZONED: Final = 0.25
"""Of the flights that are not fair, beside the orders that are drawn as all happenings are."""
_OTHER_CLOCKS: Final = 0.12
"""Of the flights; of the fair ones, which have nothing else, three times as many."""
_CROSSED: Final = 0.8
"""Of the missions whose agents change sides: something befalls them meanwhile ..."""
_CROSSED_ALONE: Final = 0.6
"""... and of these, nothing else."""
_TWO_LOSSES: Final = 0.12
"""Of the flights that are not fair: two policies are to act at a time."""
_ENDED: Final = 0.1
"""Of the others: one agent fails by itself, and the operator ends the flight."""
_TRIES: Final = 200


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
            for each in data.get("happens", ()):
                each |= {"may_be_refused": True} if "order" in each else {}
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
        mission, happens = drawn_mission(dice, wanted, fair=fair)
        if not fair and dice.chance(_TWO_LOSSES):
            losses = two_losses(dice, mission)
        elif not fair and dice.chance(_ENDED):
            losses = failed_and_ended(dice, mission)
        if "fence" not in mission:
            draw_fence(mission, dice, fair=fair)
        draw_zones(mission, dice)
    else:
        mission = dict(of)
    scenario: Data = {"version": 1, "name": name, "mission": mission, "seed": dice.whole(0, 10**6)}
    ids = sorted(agent["id"] for agent in mission["agents"])
    if dice.chance(3.0 * _OTHER_CLOCKS if fair else _OTHER_CLOCKS):
        ahead_s, drift = dice.signed(0.1, 50, 1), dice.pick((0.0, 1e-4, -5e-4))
        scenario["clocks"] = [{"agents": some_of(dice, ids), "ahead_s": ahead_s, "drift": drift}]
    if fair:
        return scenario
    if dice.chance(0.5) and "simulation" not in mission:
        most_mps = most_gusts_mps(plan_of(mission))
        mission["simulation"] = {"since": "start", "parameters": drawn_weather(dice, most_mps)}
    if dice.chance(0.35):
        quality = {
            "loss": dice.pick((0.0, 0.05, 0.2)),
            "delay_s": dice.pick((0.0, 0.05, 0.1)),
            "jitter_s": dice.pick((0.0, 0.05, 0.1)),
            "duplicate": dice.pick((0.0, 0.1)),
        }
        scenario["mesh"] = {name: value for name, value in quality.items() if value}
    steps = [kind for kind, _ in flat_steps(mission["steps"])]
    waiting = [agent["id"] for agent in mission["agents"] if agent.get("waits")]
    swarm = Addressees(ids, [*mission.get("shapes", {})], [*mission.get("groups", {})], waiting)
    scenario["happens"] = losses or happens + drawn_happenings(dice, wanted, swarm, steps)
    if of is None and changes_sides(mission) and dice.chance(_CROSSED):
        before = [] if dice.chance(_CROSSED_ALONE) and not losses else scenario["happens"]
        scenario["happens"] = before + crossed(dice, mission)
    if waiting and dice.chance(0.8):
        launch = {"at_s": dice.number(10, 40, 1), "order": f"launch @{waiting[0]}"}
        scenario["happens"].append(launch)
    if dice.chance(_REZONED):
        scenario["happens"] += rezoned(dice, mission)
    return scenario
