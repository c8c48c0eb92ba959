"""The velocity responses against step responses recorded on running autopilots."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from swarm_sim.physics.kinematics import Array, Demands, MotionState, advance
from swarm_sim.physics.response import ArdupilotResponse, Px4Response
from tests.on_demand import on_demand

DATA = Path(__file__).parents[2] / "data"
SECONDS = 6.0


def recorded(name: str) -> dict[str, Array]:
    steps: dict[str, Any] = json.loads((DATA / f"{name}_steps.json").read_text())["steps"]
    return {label: np.array(pairs) for label, pairs in steps.items()}


def airborne(
    response: ArdupilotResponse | Px4Response, velocity: Array
) -> tuple[MotionState, Demands]:
    """One vehicle far above the ground, moving."""
    state = MotionState.at_rest(np.zeros((1, 3)), response)
    state.landed[:] = False
    state.ground[:] = 1e6
    state.velocity[:] = velocity
    demands = Demands.idle(state)
    demands.lift[:] = True
    return state, demands


def settle(response: ArdupilotResponse | Px4Response, state: MotionState, target: Array) -> None:
    """The controller's memory after it has flown the state's velocity, wanting `target`, for
    long."""
    velocity = state.velocity[0]
    if isinstance(response, ArdupilotResponse):
        per_s = response.drag_per_s[0] + response.drag_per_m[0] * np.linalg.norm(velocity[:2])
        force = velocity * [per_s, per_s, response.drag_per_s[1]]
        state.memory[0, 1] = velocity
        state.memory[0, 3:6] = force
    else:
        force = velocity * response.drag_per_s
        horizontal, vertical = response.velocity_per_s
        state.memory[0, 0] = force - [horizontal, horizontal, vertical] * (target - velocity)
        state.memory[0, 1:3] = force


def simulated(
    response: ArdupilotResponse | Px4Response, label: str, start: float, dt: float = 0.01
) -> tuple[Array, Array]:
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


def relative_error(
    response: ArdupilotResponse | Px4Response, label: str, record: Array, start: float
) -> float:
    """Root-mean-square difference from the record, as a share of the step."""
    before, after = (float(x) for x in label.split()[1].split("->"))
    times, speeds = simulated(response, label, start)
    inside = (record[:, 0] >= 0) & (record[:, 0] <= SECONDS)
    difference = np.interp(record[inside, 0], times, speeds) - record[inside, 1]
    return float(np.sqrt(np.mean(difference**2)) / abs(after - before))


@pytest.mark.parametrize("label", recorded("ardupilot"))
def test_arducopter_steps_fit_as_its_readme_says(label: str) -> None:
    """3 % horizontally, 1 % vertically."""
    before = float(label.split()[1].split("->")[0])
    error = relative_error(ArdupilotResponse(), label, recorded("ardupilot")[label], before)
    assert error < (0.03 if label.startswith("vx") else 0.01)


@pytest.mark.parametrize("label", recorded("px4"))
def test_px4_steps_fit_as_its_readme_says(label: str) -> None:
    """5 % horizontally. Vertically 8 %: the recorded climb sags to 0.87 of what is set, so whatever
    settles there errs by that."""
    record = recorded("px4")[label]
    start = float(record[record[:, 0] < 0, 1][-20:].mean())
    assert relative_error(Px4Response(), label, record, start) < (
        0.05 if label.startswith("vx") else 0.08
    )


@pytest.mark.parametrize(
    ("hertz", "gain", "phase_deg"),
    [(0.2, 0.613, -38), (0.5, 0.448, -76), (1.0, 0.296, -122), (1.6, 0.189, -188)],
)
def test_px4_follows_sines_as_the_real_one(hertz: float, gain: float, phase_deg: float) -> None:
    """Measured on a PX4 in SIH: setpoints of 2 m/s at 20 Hz, to the velocity that it tells, which
    comes a little later than the true one."""
    response, dt = Px4Response(), 0.02
    velocity, memory = np.zeros((1, 3)), np.zeros((1, response.memory_rows, 3))
    times = np.arange(0.0, 20.0, dt)
    speeds = []
    for time in times:
        held = np.floor(time / 0.05 + 1e-6) * 0.05
        target = np.array([[2.0 * np.sin(2 * np.pi * hertz * held), 0.0, 0.0]])
        got = response.acceleration(memory, velocity, target, np.zeros((1, 3)), dt)
        velocity = velocity + got * dt
        speeds.append(velocity[0, 0])
    later = times > 8.0
    turn = np.exp(-2j * np.pi * hertz * (times[later] + dt - 0.025))
    found = 2.0 * np.mean(np.array(speeds)[later] * turn) / 2.0 * 1j
    assert abs(found) == pytest.approx(gain, rel=0.12)
    assert np.degrees(np.angle(found)) == pytest.approx(phase_deg, abs=21)


# --- larger steps than were recorded: in any direction, many at once ---

MANY = 200


def many(
    response: ArdupilotResponse | Px4Response, phases: list[tuple[Array, float]]
) -> list[tuple[Array, Array]]:
    """Velocities (steps, MANY, 3) and ways (MANY, 3) of vehicles that want each of the `phases` for
    its seconds."""
    state = MotionState.at_rest(np.zeros((MANY, 3)), response)
    state.landed[:] = False
    state.ground[:] = 1e6
    demands = Demands.idle(state)
    demands.lift[:] = True
    flown = []
    for target, seconds in phases:
        demands.velocity[:] = target
        start, speeds = state.position.copy(), []
        for _ in range(round(seconds / 0.02)):
            advance(state, demands, response, 0.02)
            speeds.append(state.velocity.copy())
        flown.append((np.array(speeds), state.position - start))
    return flown


def horizontals(seed: int, fastest_mps: float) -> Array:
    """Random horizontal velocities, of any direction."""
    dice = np.random.default_rng(seed)
    way, speed = dice.uniform(0, 2 * np.pi, MANY), dice.uniform(0, fastest_mps, MANY)
    return np.stack([speed * np.cos(way), speed * np.sin(way), np.zeros(MANY)], axis=-1)


def test_arducopter_keeps_its_acceleration_in_steps_of_any_size() -> None:
    """From any velocity to any other, reversals too: WPNAV_ACCEL but for what feedback adds, little
    overshoot."""
    before, after = horizontals(1, 8.0), horizontals(2, 8.0)
    step = np.linalg.norm(after - before, axis=-1)
    (_, _), (speeds, _) = many(ArdupilotResponse(), [(before, 15.0), (after, 15.0)])
    acceleration = np.linalg.norm(np.diff(speeds, axis=0) / 0.02, axis=-1)
    assert acceleration.max() < 1.2 * ArdupilotResponse().acceleration_mps2
    assert np.linalg.norm(speeds[-1] - after, axis=-1).max() < 0.1
    progress = np.einsum("tni,ni->tn", speeds - before, after - before) / step**2
    assert progress.max(axis=0)[step > 1.0].max() < 1.06
    reached_s = 0.02 * np.argmax(progress > 0.9, axis=0)[step > 1.0]
    least_s = 0.9 * step[step > 1.0] / ArdupilotResponse().acceleration_mps2
    assert np.all((reached_s > least_s) & (reached_s < least_s + 1.3))


@pytest.mark.parametrize("response", [ArdupilotResponse(), Px4Response()], ids=["ardupilot", "px4"])
# 15 lies between the two
@pytest.mark.parametrize("wanted_mps", [10.0, on_demand(15.0), 30.0])
def test_what_can_not_be_flown_does_not_wind_up(
    response: ArdupilotResponse | Px4Response, wanted_mps: float
) -> None:
    """Half a minute of a speed beyond what leaning gives, then a stop: it takes no longer than from
    that speed."""
    wanted = horizontals(3, 1.0)
    wanted *= wanted_mps / np.linalg.norm(wanted, axis=-1, keepdims=True)
    (speeds, _), (_, way) = many(response, [(wanted, 30.0), (np.zeros(3), 20.0)])
    top_mps = np.linalg.norm(speeds[-1], axis=-1).max()
    assert top_mps < 11.0
    assert np.linalg.norm(way, axis=-1).max() < top_mps * 1.5 + top_mps**2 / (2 * 2.5)
