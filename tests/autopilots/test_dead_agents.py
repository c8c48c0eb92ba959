"""A dead agent's vehicle always comes down, on the autopilots themselves, beside a ground station.

The real driver and link fly each vehicle; they end at a random moment, as with a killed process.
"""

from __future__ import annotations

import contextlib
import random
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import pytest

from swarm_ctl.core.model.fleet import VehicleKind
from swarm_ctl.core.model.vehicle import AirborneGoal, FlyGoal, Goal, LandGoal, StandbyGoal
from swarm_ctl.engine.vehicles.order import Started
from swarm_ctl.mavlink import outgoing
from swarm_ctl.mavlink.link import VehicleLink
from tests.autopilots.sitl import Client, standing

HEIGHT_M = 6.0
FLY_S = 8.0
WHOLE_S = 45.0
"""From the first tick of a flight to its landing."""
LIFTED_M = 1.0
"""Over what an estimate wanders on the ground."""
STANDS_S = 12.0
"""An armed vehicle that never left the ground disarms by itself: COM_DISARM_PRFLT is 10 s."""
LANDS_S = 6.0
DOWN_S = 45.0
"""ArduCopter needs 31 s from 10 m, PX4 24 s."""
LANDING = {VehicleKind.ARDUCOPTER: "LAND", VehicleKind.PX4: "AUTO.LAND"}
AUTOPILOT = {VehicleKind.ARDUCOPTER: "ardupilot", VehicleKind.PX4: "px4"}


@dataclass
class Killed:
    """What a vehicle did after its agent's end, in seconds from there."""

    goal: str
    after_s: float
    """Of the flight, the kill."""
    armed: bool
    height_m: float
    landing_s: float = 0.0
    down_s: float = 0.0
    peak_m: float = 0.0
    """The most that it rose after the kill."""

    @property
    def flew(self) -> bool:
        """It was in the air then, or left the ground afterwards."""
        return self.armed and (self.height_m > LIFTED_M or self.peak_m > LIFTED_M)


class Agent:
    """Standby, take-off, some flight, landing; `next` names the goal of the tick."""

    def __init__(self, started: Started) -> None:
        kind = AUTOPILOT[started.kind]
        self.link = VehicleLink(started.endpoint, kind, started.sysid, agent_sysid=240)
        self.begun = time.monotonic()
        self._flying_s: float | None = None
        self._ready = self.was_up = False

    def next(self, now: float) -> Goal:
        view = self.link.view()
        up = view.armed and view.local is not None and -view.local.position_ned_m[2] > HEIGHT_M - 1
        self.was_up |= up and view.controlled
        self._ready |= view.healthy  # as an agent, which does not go back to its first step
        if not self._ready:
            return StandbyGoal()
        if not self.was_up:
            return AirborneGoal(HEIGHT_M)
        self._flying_s = self._flying_s or now
        if now - self._flying_s > FLY_S:
            return LandGoal()
        ahead = now - self._flying_s < FLY_S / 2
        return FlyGoal((2.0 if ahead else -2.0, 0.0, 0.0))

    def fly(self, seconds: float) -> Goal:
        goal: Goal = StandbyGoal()
        with contextlib.closing(self.link):
            while (now := time.monotonic()) < self.begun + seconds:
                self.link.receive(now)
                goal = self.next(now)
                self.link.pursue(goal, now)
                time.sleep(0.05)
        return goal


def kill_once(started: Started, client: Client, after_s: float) -> Killed:
    goal = Agent(started).fly(after_s)
    killed = time.monotonic()
    found = Killed(type(goal).__name__, after_s, bool(client.armed), client.height_m or 0.0)

    def landing() -> bool:
        found.peak_m = max(found.peak_m, (client.height_m or 0.0) - found.height_m)
        return not client.armed or client.mode == LANDING[started.kind]

    with contextlib.suppress(AssertionError):
        time.sleep(1.0)  # a command that was on its way
        client.wait_for(landing, seconds=LANDS_S + 20.0)
        found.landing_s = time.monotonic() - killed
        client.wait_for(lambda: not client.armed, seconds=DOWN_S)
        found.down_s = time.monotonic() - killed
        return found
    found.down_s = found.landing_s = float("inf")
    return found


def kills(started: Started, moments: list[float]) -> list[Killed]:
    with Client(started) as client:
        client.beat()
        client.hear_often()
        found = []
        for moment in moments:
            found.append(kill_once(started, client, moment))
            time.sleep(2.0)
        return found


@pytest.mark.long
@pytest.mark.timeout(1500)
@pytest.mark.parametrize("kind", [VehicleKind.ARDUCOPTER, VehicleKind.PX4], ids=str)
def test_a_dead_agents_vehicle_comes_down_beside_a_ground_station(
    kind: VehicleKind, tmp_path: Path
) -> None:
    """30 random moments from the first tick to the landing: the landing mode within 6 s, then down
    as fast as it lands."""
    vehicles, each = 5, 6
    draw = random.Random(1)
    with (
        standing([kind] * vehicles, tmp_path / "vehicles") as started,
        ThreadPoolExecutor() as pool,
    ):
        moments = [[draw.uniform(0.5, WHOLE_S) for _ in range(each)] for _ in started]
        runs = pool.map(kills, started.values(), moments)
        found = [kill for run in runs for kill in run]
    for kill in found:
        print(kill)
    assert len(found) == 30
    flown = [kill for kill in found if kill.flew]
    assert len(flown) > 10, "many are killed in the air"
    assert max(kill.landing_s for kill in flown) <= LANDS_S
    assert max(kill.down_s for kill in flown) <= LANDS_S + DOWN_S
    assert max(kill.down_s for kill in found if not kill.flew) <= STANDS_S


DANGERS = {
    VehicleKind.ARDUCOPTER: ("FS_GCS_ENABLE", 0.0, 5.0),
    VehicleKind.PX4: ("COM_OF_LOSS_T", 60.0, 1.0),
}
"""What another sets in flight, and what the agent sets again."""


@pytest.mark.long
@pytest.mark.timeout(300)
@pytest.mark.parametrize("kind", DANGERS, ids=str)
def test_a_failsafe_that_a_ground_station_takes_away_in_flight_is_there_when_the_agent_dies(
    kind: VehicleKind, tmp_path: Path
) -> None:
    name, value, ours = DANGERS[kind]
    with standing([kind], tmp_path / "vehicles") as started, Client(started[1]) as client:
        agent, stop = Agent(started[1]), threading.Event()
        texts: list[str] = []

        def fly() -> None:
            with contextlib.closing(agent.link):
                while not stop.is_set():
                    now = time.monotonic()
                    agent.link.receive(now)
                    view = agent.link.view()
                    texts.extend(view.texts)
                    up = view.controlled and (client.height_m or 0.0) > HEIGHT_M - 1
                    still = FlyGoal((0.0, 0.0, 0.0))
                    agent.was_up |= up
                    ready = AirborneGoal(HEIGHT_M) if view.healthy or view.armed else StandbyGoal()
                    agent.link.pursue(still if agent.was_up else ready, now)
                    time.sleep(0.05)

        flying = threading.Thread(target=fly)
        flying.start()
        try:
            client.beat()
            client.hear_often()
            client.wait_for(lambda: agent.was_up, seconds=90.0)
            assert client.get(name) == ours
            kind_of = client.parameters[name][1]
            client.send(outgoing.set_parameter(client.sysid, name, value, kind_of))
            client.wait_for(
                lambda: any("changed in flight" in text for text in texts), seconds=20.0
            )
            client.wait_for(lambda: client.get(name) == ours, seconds=10.0)
        finally:
            stop.set()
            flying.join()
        client.wait_for(lambda: client.mode == LANDING[kind], seconds=LANDS_S + 4.0)
        client.wait_for(lambda: not client.armed, seconds=DOWN_S)
