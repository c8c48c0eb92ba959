"""Make missions in Python and fly each: how close do two drones come that change places?"""

import swarm_ctl

MISSION = """
version: 1
name: swap-{spacing:g}
origin: {{lat_deg: -35.363262, lon_deg: 149.165237, alt_m: 584}}
unit_m: 5
law: {{r: 8, r_out: 1.5, r_in: 0.5}}
vehicle: {{limits: {{speed_mps: 3}}}}
agents:
  - {{id: 1, start: [0, 0]}}
  - {{id: 2, start: [0, {spacing}]}}
shapes:
  line: {{kind: offsets, offsets: [[0, 0], [0, {spacing}]]}}
  turned: {{kind: offsets, offsets: [[0, {spacing}], [0, 0]]}}
steps:
  - takeoff: {{height_m: 5}}
  - form: {{shape: line, slots: fixed}}
  - form: {{shape: turned, slots: fixed}}
  - land
"""


def closest_m(spacing: float) -> float:
    """In metres, on the virtual clock."""
    with swarm_ctl.fly(MISSION.format(spacing=spacing), vehicles="virtual") as swarm:
        return swarm.finish().closest_m


if __name__ == "__main__":
    for spacing in (2.0, 4.0):
        print(f"{spacing:g} units apart: {closest_m(spacing):.2f} m")
