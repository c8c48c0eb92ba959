"""Print the pairs that avoid each other, and each alarm, as they come: without asyncio."""

import sys

import swarm_ctl

MISSION = """
version: 1
name: swap
origin: {lat_deg: -35.363262, lon_deg: 149.165237, alt_m: 584}
unit_m: 5
law: {r: 8, r_out: 1.5, r_in: 0.5}
vehicle: {limits: {speed_mps: 3}}
agents:
  - {id: 1, start: [0, 0]}
  - {id: 2, start: [0, 3]}
shapes:
  swapped: {kind: offsets, offsets: [[0, 3], [0, 0]]}
steps:
  - takeoff: {height_m: 5}
  - form: {shape: swapped, slots: fixed}
  - land
"""
"""Two drones change places: on the way they are in each other's avoidance region, where each tunes
its sigma."""


def main(vehicles: str) -> None:
    said = set()
    with swarm_ctl.fly(MISSION, speedup=5, vehicles=vehicles) as swarm:
        for view in swarm.views(every_s=0.5):
            for pair in view.pairs:
                sigmas = ", ".join(f"agent {i} tunes {side.sigma:.3f}" for i, side in pair.sides)
                print(
                    f"{view.time_s:6.1f} s  {pair.a}-{pair.b}  {pair.distance_m:5.2f} m  {sigmas}"
                )
            for alarm in swarm.alarms():
                if alarm.key not in said:
                    said.add(alarm.key)
                    print(f"{view.time_s:6.1f} s  ALARM {alarm.name}: {alarm.words}")
        print(swarm.finish().outcomes)


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else "simulated")
