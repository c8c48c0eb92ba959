"""The scenarios fly the same virtual swarm that the package brings for its users' tests. What many
rows begin with is flown once: each goes on with a copy."""

from __future__ import annotations

import copyreg
import dataclasses
import struct
from collections.abc import Callable
from copy import deepcopy
from functools import cache
from pathlib import Path
from typing import Any, ParamSpec, TypeVar
from unittest.mock import patch

from swarm_ctl.core.model import messages, plan
from swarm_ctl.mesh import keys
from swarm_ctl.mission.compile.loader import LoadedMission, loads
from swarm_ctl.virtual.virtual_swarm import VirtualSwarm
from swarm_sim.firmware import autopilot

__all__ = [
    "VirtualSwarm",
    "assert_arrives",
    "at_half_rate",
    "at_step",
    "flown_once",
    "landing_fast",
    "low_hexagon",
    "low_hexagon_text",
    "ready",
]

READY = Path(__file__).parents[2] / "missions"
HEXAGON = READY / "hexagon.yaml"

P, S = ParamSpec("P"), TypeVar("S")
_FLOWN: dict[Any, dict[int, VirtualSwarm]] = {}
"""By what was flown, and the step at whose begin it is kept."""


def flown_once(fly: Callable[P, S]) -> Callable[P, S]:
    """What `fly` returns for these arguments, a swarm or what holds one, is made once: each call
    has a copy of it, which flies on by itself."""
    once = cache(fly)

    def flown(*args: P.args, **kwargs: P.kwargs) -> S:
        return _copy(once(*args, **kwargs))

    return flown


@cache
def low_hexagon() -> LoadedMission:
    """The ready hexagon close to the ground and at half the rate: for half the work."""
    return loads(low_hexagon_text())


def low_hexagon_text() -> str:
    """As its file has it."""
    text = HEXAGON.read_text()
    for own, here in (
        ("height_m: 10}", "height_m: 4}"),
        ("tick_s: 0.05", "tick_s: 0.1"),
        ("kappa: 20", "kappa: 10"),
    ):
        assert own in text
        text = text.replace(own, here)
    return text


def ready(name: str) -> str:
    """The text of a ready mission."""
    return (READY / name).read_text(encoding="utf-8")


def at_half_rate(name: str) -> str:
    """The text of a ready mission in metres, at half the rate: for half the work."""
    text, law = ready(name), "r_in: 2.5}"
    assert text.count(law) == 1
    assert "tick_s" not in text
    return text.replace(law, "r_in: 2.5, kappa: 10}\ntick_s: 0.1")


def landing_fast(swarm: VirtualSwarm) -> VirtualSwarm:
    """Its vehicles touch down at 2 m/s, for 0.5 and 0.7: a sixth of a short flight is landing."""
    for vehicle in swarm.hub.world.vehicles:
        known = vehicle.firmware.parameters
        if "LAND_SPEED" in known:
            known.set("LAND_SPEED", 200)  # ArduCopter's, in cm/s
        else:
            known.set("MPC_LAND_SPEED", 2.0)
    return swarm


def assert_arrives(swarm: VirtualSwarm, until_s: float = 300.0) -> None:
    """All begin their last step: each other one is done, none has ended early, and no two came
    under r_in. A third of a short flight is landing, which other rows hold."""
    swarm.wait(lambda s: s.outcomes() or s.in_step(s.plan.last_step), until_s)
    assert swarm.outcomes() == {}, {i: m.ended for i, m in swarm.members.items() if m.ended}
    assert swarm.closest_m > swarm.plan.law.r_in * swarm.plan.unit_m


def at_step(
    mission: LoadedMission, step: int, seed: int = 1, *, as_delivered: bool = False
) -> VirtualSwarm:
    """The mission's swarm in the tick in which all are in this step; unless its vehicles are `as
    delivered`, they will land fast."""
    flown = mission.plan, mission.fleet, str(mission.file.simulation), seed, as_delivered
    kept = _FLOWN.setdefault(flown, {})
    if step not in kept:
        nearest = max((known for known in kept if known < step), default=None)
        swarm = VirtualSwarm(mission, seed) if nearest is None else _copy(kept[nearest])
        if nearest is None and not as_delivered:
            landing_fast(swarm)
        swarm.wait(lambda s: s.in_step(step))
        kept[step] = swarm
    return _copy(kept[step])


def _copy(flown: S) -> S:
    """Plans, their steps and flight modes are compared by identity: a copy has the same ones."""
    with patch.dict(copyreg.dispatch_table, _SHARED):
        return deepcopy(flown)


_SHARED: dict[type, Callable[[Any], Any]] = {
    kind: lambda found: type(found).__qualname__  # a name: itself
    for module in (autopilot, messages, plan)
    for kind in vars(module).values()
    if dataclasses.is_dataclass(kind) and kind.__dataclass_params__.frozen
} | {struct.Struct: lambda found: (struct.Struct, (found.format,))}


def deaf(swarm: VirtualSwarm, agent: int, *channels: keys.Channel[Any], kind: str = "") -> Any:
    """Nothing of these channels (or only no command of this kind) reaches the agent; call the
    result to end it."""
    node, take = swarm.members[agent].node, swarm.members[agent].node.take

    def nothing(channel: keys.Channel[Any], likely: Any = None) -> list[Any]:
        heard = take(channel, likely)
        if channel not in channels:
            return heard
        return [item for item in heard if kind and getattr(item[0], "kind", "") != kind]

    node.take = nothing  # type: ignore[method-assign]
    return lambda: setattr(node, "take", take)
