"""The velocity responses against step responses recorded on running autopilots."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sim.response import Ardupilot, Px4
from sim.vehicle import Array, Demands, State, advance

DATA = Path(__file__).parents[2] / "data"
SECONDS = 6.0


def recorded(name: str) -> dict[str, Array]:
    steps: dict[str, Any] = json.loads((DATA / f"{name}_steps.json").read_text())["steps"]
    return {label: np.array(pairs) for label, pairs in steps.items()}


def airborne(response: Ardupilot | Px4, velocity: Array) -> tuple[State, Demands]:
    """One vehicle far above the ground, moving."""
    state = State.at_rest(np.zeros((1, 3)), response)
    state.landed[:] = False
    state.ground[:] = 1e6
    state.velocity[:] = velocity
    demands = Demands.idle(state)
    demands.lift[:] = True
    return state, demands


def settle(response: Ardupilot | Px4, state: State, target: Array) -> None:
    """The controller's memory after it has flown the state's velocity, wanting `target`, for long."""
    velocity = state.velocity[0]
    if isinstance(response, Ardupilot):
        per_s = response.drag_per_s[0] + response.drag_per_m[0] * np.linalg.norm(velocity[:2])
        force = velocity * [per_s, per_s, response.drag_per_s[1]]
        state.memory[0, 1] = velocity
        state.memory[0, 3:6] = force
    else:
        force = velocity * response.drag_per_s
        horizontal, vertical = response.velocity_per_s
        state.memory[0, 0] = force - [horizontal, horizontal, vertical] * (target - velocity)
        state.memory[0, 1:3] = force


def simulated(response: Ardupilot | Px4, label: str, start: float, dt: float = 0.01) -> tuple[Array, Array]:
    before, after = (float(x) for x in label.split()[1].split("->"))
    axis = 0 if label.startswith("vx") else 2
    unit = np.eye(3)[axis]
    state, demands = airborne(response, start * unit)
    settle(response, state, before * unit)
    demands.velocity[0] = after * unit
    times, speeds = [0.0], [start]
    for k in range(round(SECONDS / dt)):
        advance(state, demands, response, dt)
        times.append((k + 1) * dt)
        speeds.append(float(state.velocity[0, axis]))
    return np.array(times), np.array(speeds)


def relative_error(response: Ardupilot | Px4, label: str, record: Array, start: float) -> float:
    """Root-mean-square difference from the record, as a share of the step."""
    before, after = (float(x) for x in label.split()[1].split("->"))
    times, speeds = simulated(response, label, start)
    inside = (record[:, 0] >= 0) & (record[:, 0] <= SECONDS)
    difference = np.interp(record[inside, 0], times, speeds) - record[inside, 1]
    return float(np.sqrt(np.mean(difference**2)) / abs(after - before))


@pytest.mark.parametrize("label", recorded("ardupilot"))
def test_arducopter_steps_fit_within_5_percent(label: str) -> None:
    before = float(label.split()[1].split("->")[0])
    assert relative_error(Ardupilot(), label, recorded("ardupilot")[label], before) < 0.05


@pytest.mark.parametrize("label", recorded("px4"))
def test_px4_steps_fit_as_well_as_their_noise_allows(label: str) -> None:
    record = recorded("px4")[label]
    start = float(record[record[:, 0] < 0, 1][-20:].mean())
    assert relative_error(Px4(), label, record, start) < (0.05 if label.startswith("vx") else 0.09)


@pytest.mark.parametrize(
    ("label", "t10", "t63", "t90", "peak"),
    [("vx 0->1", 0.33, 0.74, 1.29, 1.44), ("vx 0->3", 0.47, 1.08, 1.66, 2.8), ("vz 0->-1", 0.28, 0.79, 1.04, 1.13)],
)
def test_arducopter_times_are_the_measured_ones(label: str, t10: float, t63: float, t90: float, peak: float) -> None:
    times, speeds = simulated(Ardupilot(), label, 0.0)
    share = speeds / float(label.split("->")[1])
    reached = [times[np.argmax(share >= level)] for level in (0.1, 0.63, 0.9)]
    assert reached == pytest.approx([t10, t63, t90], abs=0.13)
    assert np.abs(np.gradient(speeds, times)).max() == pytest.approx(peak, rel=0.1)


def test_a_coarse_time_step_keeps_the_fit() -> None:
    """Studies step at the control tick."""
    _, fine = simulated(Ardupilot(), "vx 0->3", 0.0, dt=0.01)
    _, coarse = simulated(Ardupilot(), "vx 0->3", 0.0, dt=0.05)
    assert np.sqrt(np.mean((fine[::5] - coarse) ** 2)) < 0.05 * 3.0
