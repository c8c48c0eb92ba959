"""What the simulator is told to simulate a mission: plain JSON for `python -m swarm_sim`."""

from __future__ import annotations

import json
import math
import subprocess
import sys
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Final

from swarm_ctl.core.model.fleet import FleetAgent
from swarm_ctl.core.model.frames import geodetic_from_ned
from swarm_ctl.core.model.plan import Geodetic, Plan
from swarm_ctl.engine.clock import pause
from swarm_ctl.engine.interrupts import Interrupts
from swarm_ctl.errors import InputError, StartError
from swarm_ctl.mission.sections.simulation_section import SimulationSection

_READY_AFTER_S = 3.0


def simulator_config(
    plan: Plan, vehicles: Sequence[FleetAgent], simulation: SimulationSection
) -> dict[str, Any]:
    """Geodetic starts, weather and faults of the mission; each vehicle listens where its entry's
    endpoint says."""
    return {
        "version": 1,
        "origin": place(plan.origin),
        "truth_rate_hz": 10,
        "sensing_range_m": plan.law.r * plan.unit_m,
        "sim_parameters": simulation.parameters.given(),
        "faults_since": simulation.since,
        "faults": simulation.timetable({vehicle.id: vehicle.sysid for vehicle in vehicles}),
        "vehicles": [_vehicle(plan, vehicle) for vehicle in vehicles],
    }


def grid_config(count: int, persona: str, origin: Geodetic, spacing_m: float) -> dict[str, Any]:
    """`count` vehicles on a square grid whose first place is the origin; no mission, no faults."""
    vehicles = [
        vehicle_config(sysid, persona, "", start, origin)
        for sysid, start in enumerate(grid(count, spacing_m), start=1)
    ]
    return {"version": 1, "origin": place(origin), "sim_parameters": {}, "vehicles": vehicles}


def grid(count: int, spacing_m: float) -> list[tuple[float, float]]:
    """North and east [m] of `count` places in a square."""
    side = math.isqrt(count - 1) + 1
    return [(i // side * spacing_m, i % side * spacing_m) for i in range(count)]


def place(at: Any) -> dict[str, float]:
    """A point on the ellipsoid, as the simulator wants it."""
    return {"lat_deg": at.lat_deg, "lon_deg": at.lon_deg, "alt_m": at.alt_m}


def vehicle_config(
    sysid: int, persona: str, endpoint: str, ne_m: tuple[float, float], origin: Geodetic
) -> dict[str, Any]:
    """One vehicle that stands at `ne_m` [m] north and east of the origin and is ready soon."""
    at = place(geodetic_from_ned((*ne_m, 0.0), origin))
    return {
        "sysid": sysid,
        "persona": persona,
        "endpoint": endpoint,
        "ready_after_s": _READY_AFTER_S,
    } | at


def _vehicle(plan: Plan, vehicle: FleetAgent) -> dict[str, Any]:
    north, east = plan.agent(vehicle.id).start
    port = (vehicle.endpoint or "").rpartition(":")[2]
    start = (north * plan.unit_m, east * plan.unit_m)
    true = vehicle.simulated_response
    lag = true and {
        "dead_time_s": true.dead_time_s,
        "lag_s": true.lag_s,
        "acceleration_mps2": true.acceleration_mps2,
    }
    return {"response": lag or "persona"} | vehicle_config(
        vehicle.sysid, vehicle.autopilot, f"udpin:127.0.0.1:{port}", start, plan.origin
    )


_POLL_WALL_S: Final = 0.05


def serve(settings: dict[str, Any], ready: Callable[[], None]) -> None:
    """Simulate until Ctrl-C or SIGTERM; calls `ready` once the vehicles listen.

    Raises:
        InputError: the simulator refuses its settings; its reason stands on stderr.
        StartError: a port or file does not open.
    """
    with tempfile.TemporaryDirectory() as folder, Interrupts() as ctrl_c:
        path = Path(folder) / "sim.json"
        path.write_text(json.dumps(settings))
        command = [sys.executable, "-m", "swarm_sim", "--config", str(path)]
        with subprocess.Popen(
            command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            process_group=0,  # a terminal's Ctrl-C is for this process, which passes it on
        ) as child:
            if child.stdout is not None and child.stdout.readline():
                ready()
            passed_on = 0
            while (code := child.poll()) is None:
                if ctrl_c.count > passed_on:
                    passed_on = ctrl_c.count
                    child.terminate()  # once a signal: it still has to finish its truth file
                pause(_POLL_WALL_S)
    if code != 0 and not ctrl_c.count:
        error = InputError if code == 2 else StartError
        raise error(f"the simulator ended with code {code}; its reason stands above")
