"""How near a formation is to a target that turns: twenty simulated ArduCopters in a block, a target
at 8 m/s on straights of 100 m and half circles, its news at 5 Hz, 0.3 s late, a fifth lost, with
noise of 0.3 m and 0.2 m/s. By truth, from 60 s after the step began.

    python -m tests.bench.bench_follow          # half circles of 60 and of 40 m
    python -m tests.bench.bench_follow 60 --agents 5
"""

from __future__ import annotations

import argparse
import math
from dataclasses import replace
from typing import Final

import numpy as np

from swarm_ctl.core.model.frames import geodetic_from_ned
from swarm_ctl.core.model.messages import TargetWord
from swarm_ctl.mesh import keys
from swarm_ctl.mesh.memory_transport import MemoryTransport
from swarm_ctl.mesh.node import Node
from swarm_ctl.mission.compile.loader import loads
from swarm_ctl.virtual.virtual_swarm import VirtualSwarm

MISSION: Final = """\
version: 1
name: chase
origin: {{lat_deg: -35.363262, lon_deg: 149.165237, alt_m: 584}}
lengths: metres
law: {{r: 60, r_out: 12, r_in: 2.5}}
vehicle: {{limits: {{speed_mps: 10}}}}
policies: {{max_speed_mps: 25}}
agents: [{agents}]
targets: {{boat: {{height_m: 0}}}}
shapes: {{block: {{kind: grid, spacing: 15, columns: 5}}}}
steps:
  - takeoff: {{height_m: 10}}
  - form: {{shape: block}}
  - follow: {{target: boat, duration_s: 150, lost_after_s: 30}}
  - land
fence:
  polygon: [[-2000, -2000], [2000, -2000], [2000, 2000], [-2000, 2000]]
  height_m: 60
"""
STEP: Final = 3
SPEED_MPS, STRAIGHT_M = 8.0, 100.0
LATE_S, LOST, EVERY_S, FROM_S = 0.3, 0.2, 0.2, 60.0


def target(seconds: float, radius_m: float) -> tuple[complex, complex, bool]:
    """Place, velocity, and whether it turns."""
    left, at, course, side, turns = SPEED_MPS * seconds, 30 + 30j, 0.0, 1.0, False
    while True:
        leg = math.pi * radius_m if turns else STRAIGHT_M
        way = min(left, leg)
        heading = complex(math.cos(course), math.sin(course))
        if turns:
            middle = at + 1j * side * radius_m * heading
            angle = side * way / radius_m
            at = middle + (at - middle) * complex(math.cos(angle), math.sin(angle))
            course += angle
        else:
            at += way * heading
        left -= way
        if left <= 0.0:
            return at, SPEED_MPS * complex(math.cos(course), math.sin(course)), turns
        side = -side if turns else side
        turns = not turns


def fly(radius_m: float, count: int) -> str:
    """One flight, in a line."""
    starts = ", ".join(
        f"{{id: {k + 1}, start: [{15 * (k // 5)}, {15 * (k % 5)}]}}" for k in range(count)
    )
    mission = loads(MISSION.format(agents=starts))
    swarm, dice = VirtualSwarm(mission), np.random.default_rng(1)
    node = Node(MemoryTransport(swarm.mesh), "test", "boat.1")
    group, unit = swarm.members[1].agent._group, mission.plan.unit_m
    began_s, due_s, mail = math.inf, 0.0, list[tuple[float, TargetWord]]()
    found: dict[bool, list[float]] = {False: [], True: []}
    shape = list[float]()
    while not all(member.ended for member in swarm.members.values()):
        swarm.tick()
        now, step = swarm.now, group.progress.step
        if step == STEP and math.isinf(began_s):
            began_s = due_s = now
        if step != STEP:
            continue
        at, velocity, turns = target(now - began_s, radius_m)
        if now >= due_s - 1e-6:
            due_s += EVERY_S
            noise, wrong = dice.normal(0, 0.3, 2), dice.normal(0, 0.2, 2)
            place = geodetic_from_ned(
                (at.real + noise[0], at.imag + noise[1], 0.0), mission.plan.origin
            )
            word = TargetWord(
                "boat",
                place.lat_deg,
                place.lon_deg,
                LATE_S,
                altitude_m=place.alt_m,
                velocity_ned_mps=(velocity.real + wrong[0], velocity.imag + wrong[1], 0.0),
                accuracy_m=0.5,
                station="boat.1",
            )
            if dice.random() >= LOST:
                mail.append((now + LATE_S, word))
        for each in [each for each in mail if each[0] <= now + 1e-6]:
            mail.remove(each)
            node.send(keys.SIGHTING, replace(each[1], age_s=LATE_S))
        if now - began_s > FROM_S:
            slots = group.reference.slots
            off = np.array(
                [
                    complex(*place[:2]) - at - complex(*slots[agent]) * unit
                    for agent, place in swarm.positions().items()
                ]
            )
            found[turns] += np.abs(off).tolist()
            shape += np.abs(off - off.mean()).tolist()

    def rms(of: list[float]) -> float:
        return math.sqrt(sum(value * value for value in of) / max(len(of), 1))

    return (
        f"{count} agents, half circles of {radius_m:g} m: place {rms(found[False]):.2f} m rms"
        f" straight on, {rms(found[True]):.2f} m in turns; shape {rms(shape):.2f} m;"
        f" nearest pair {swarm.closest_m:.1f} m"
    )


def main() -> None:
    """Print a line a radius."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("radius", nargs="*", type=float, default=[60.0, 40.0])
    parser.add_argument("--agents", type=int, default=20)
    given = parser.parse_args()
    for radius_m in given.radius:
        print(fly(radius_m, given.agents), flush=True)


if __name__ == "__main__":
    main()
