"""A pilot's ground station takes a vehicle by its mode and gives it back; a vehicle is disarmed in
the air. On the autopilots themselves, with two agents that hold their formation."""

from __future__ import annotations

import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from swarm_ctl.mavlink import outgoing
from tests.autopilots.sitl import Client, Flight
from tests.system.running import SWARM_CTL

PAIR = Path(__file__).with_name("pair.yaml")
HOLD = 3
FLOWN = {"arducopter": "GUIDED", "px4": "OFFBOARD"}
PILOTS = {"arducopter": "BRAKE", "px4": "AUTO.LOITER"}
"""Modes that hold a place without a pilot's sticks."""

pytestmark = pytest.mark.long
rows = pytest.mark.parametrize("kind", ["arducopter", "px4"])


@contextmanager
def holding(kind: str, folder: Path) -> Iterator[tuple[Flight, Client]]:
    """Two agents hold for 20 s; a peer that is lost makes the other wait."""
    mission = folder / "pair.yaml"
    text = PAIR.read_text().replace("duration_s: 5", "duration_s: 20")
    mission.write_text(f"{text}policies: {{agent_lost: hold}}\n")
    with Flight(mission, kind, cwd=folder) as flight:
        flight.wait_for_step(HOLD)
        with flight.client(2) as pilot:
            yield flight, pilot


def resume(folder: Path) -> str:
    command = [str(SWARM_CTL), "send", "resume", "--agents", "2"]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    return done.stdout + done.stderr


@rows
def test_a_pilot_takes_a_vehicle_and_gives_it_back(kind: str, tmp_path: Path) -> None:
    """The agent yields within 3 s of the vehicle's new mode, asks for none for 10 s, refuses
    `resume` in the pilot's mode, and goes on by it in its own; both complete."""
    with holding(kind, tmp_path) as (flight, pilot):
        pilot.take_mode(PILOTS[kind])
        taken_s = time.monotonic()
        flight.wait_for(lambda: "yield: the vehicle was switched to" in flight.output)
        print(f"{kind}: yielded after {time.monotonic() - taken_s:.1f} s")
        assert time.monotonic() - taken_s < 3.0
        until = time.monotonic() + 10.0
        while time.monotonic() < until:
            assert pilot.mode == PILOTS[kind]
            time.sleep(0.1)
        assert f"is in {PILOTS[kind]}; set {FLOWN[kind]}" in resume(tmp_path)
        pilot.take_mode(FLOWN[kind])
        time.sleep(4.0)
        assert pilot.mode == FLOWN[kind]
        assert "accepted" in resume(tmp_path)
        flight.assert_completed()
        assert "takes its vehicle again; goes on at step 3" in flight.output


@rows
def test_a_vehicle_that_is_disarmed_in_the_air_fails_its_agent(kind: str, tmp_path: Path) -> None:
    """By that reason, whatever its mode; the other comes down."""
    with holding(kind, tmp_path) as (flight, pilot):
        pilot.wait_for(
            lambda: pilot.armed is False,
            lambda: pilot.command(outgoing.ARM_DISARM, 0.0, outgoing.FORCE),
        )
        flight.wait_for(lambda: "fall: the vehicle was disarmed in the air" in flight.output)
        flight.interrupt()
        flight.wait(240.0)
        assert flight.outcomes()[2] == "failed"
        assert "disarmed in the air" in flight.reasons()[2]
