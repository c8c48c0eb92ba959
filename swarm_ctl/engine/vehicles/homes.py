"""Where each ArduCopter of a plan stands, and its parameters.

`python -m swarm_ctl.engine.vehicles.homes PLAN FOLDER` writes both for autopilots that others
start: FOLDER/home-ID is an agent's `--home`, FOLDER/copter.parm their `--defaults`.
"""

from __future__ import annotations

import shutil
import sys
from pathlib import Path
from typing import Final

from swarm_ctl.core.model.frames import geodetic_from_ned
from swarm_ctl.core.model.plan import Geodetic, Plan
from swarm_ctl.mission.compile.plan_file import read_plan

DEFAULTS: Final = Path(__file__).with_name("copter.parm")
"""Parameters of a simulated copter."""


def start_of(plan: Plan, agent: int) -> Geodetic:
    """Where an agent's vehicle stands before the flight."""
    north, east = plan.agent(agent).start
    return geodetic_from_ned((north * plan.unit_m, east * plan.unit_m, 0.0), plan.origin)


def home(at: Geodetic) -> str:
    """ArduCopter's `--home`: latitude, longitude [deg], altitude [m], heading [deg]."""
    return f"{at.lat_deg:.8f},{at.lon_deg:.8f},{at.alt_m:.2f},0"


def write_homes(plan: Plan, folder: Path) -> None:
    """A file for each agent, and the parameters."""
    for agent in plan.agents:
        (folder / f"home-{agent.id}").write_text(home(start_of(plan, agent.id)) + "\n")
    shutil.copy(DEFAULTS, folder)


if __name__ == "__main__":
    write_homes(read_plan(Path(sys.argv[1])).plan, Path(sys.argv[2]))
