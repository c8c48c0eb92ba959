"""Swarms in which an agent hears near peers at every tick and all others now and then, on the
virtual clock."""

from __future__ import annotations

import random
from collections.abc import Callable

from swarm_ctl.mesh.keys import FAR, Qos
from swarm_ctl.mesh.transport import Inlet, Transport
from swarm_ctl.mission.compile.loader import LoadedMission, loads
from tests.scenarios.swarm import VirtualSwarm

SPACING_M = 10


def mission(count: int, columns: int, *steps: str, policies: str = "{}") -> LoadedMission:
    """Rows of so many, which form a block, then the given steps; `mirror` is the block with left
    and right exchanged."""
    places = [(SPACING_M * (k // columns), SPACING_M * (k % columns)) for k in range(count)]
    agents = "".join(f"  - {{id: {k + 1}, start: [{n}, {e}]}}\n" for k, (n, e) in enumerate(places))
    mirror = [[n, SPACING_M * (columns - 1) - e] for n, e in places]
    return loads(
        "version: 1\nname: large\norigin: {lat_deg: -35.36, lon_deg: 149.16, alt_m: 584}\n"
        f"unit_m: 1\ntick_s: 0.1\nlaw: {{r: {1.45 * SPACING_M}, r_out: 6, r_in: 2.5}}\n"
        f"vehicle: {{limits: {{speed_mps: 4}}}}\npolicies: {policies}\nagents:\n{agents}"
        f"shapes:\n  block: {{kind: grid, spacing: {SPACING_M}, columns: {columns}}}\n"
        f"  mirror: {{kind: offsets, offsets: {mirror}}}\n"
        "steps:\n  - takeoff: {height_m: 4}\n  - form: {shape: block, settle_s: 1}\n"
        + "".join(f"  - {step}\n" for step in (*steps, "land"))
    )


class FarLost(Transport):
    """Loses this share of the agent's far words."""

    def __init__(self, inner: Transport, share: float, seed: int) -> None:
        self._inner, self._share, self._dice = inner, share, random.Random(seed)

    def publish(self, key: str, data: bytes, qos: Qos) -> None:
        if not key.endswith(f"/{FAR.name}") or self._dice.random() >= self._share:
            self._inner.publish(key, data, qos)

    def subscribe(self, key_expression: str, *, timed: bool = False) -> Inlet:
        return self._inner.subscribe(key_expression, timed=timed)

    def close(self) -> None:
        self._inner.close()


def losing(share: float) -> Callable[[Transport, int], Transport]:
    return lambda inner, agent: FarLost(inner, share, agent)


def test_a_row_moves_on_without_a_killed_agent() -> None:
    """A third of all far words is lost, and the agent in the middle dies on the way: all others,
    near and far from it, go on without it to the end of the move. The ends of the row hear each
    other now and then alone."""
    move = "move: {to: [14, 80], speed_mps: 3}"
    row = mission(17, 17, move, policies="{agent_lost: continue}")
    swarm = VirtualSwarm(row, mesh=losing(0.33))
    swarm.wait(lambda s: s.in_step(3))
    swarm.run(2.0)
    assert 17 not in swarm.members[1].near
    assert {2, 3} <= swarm.members[1].near
    swarm.kill(9)
    swarm.wait(lambda s: all(s.members[i].status.step == 4 for i in s.members if i != 9))
    assert swarm.closest_m > swarm.plan.law.r_in * swarm.plan.unit_m
    assert not any("falls apart" in e.text for e in swarm.events if e.agent not in (8, 10))
