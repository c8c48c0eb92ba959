"""A vehicle serves agent after agent without a reboot: it flies again, it hears an agent that was
started again, and it is told once to take off."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path

import pytest

from swarm_ctl.core.model.fleet import VehicleKind
from swarm_ctl.core.model.vehicle import (
    AirborneGoal,
    FlyGoal,
    Goal,
    LandGoal,
    ReleaseGoal,
    StandbyGoal,
    VehicleView,
)
from swarm_ctl.mavlink.link import VehicleLink
from tests.autopilots.sitl import standing

TICK_S = 0.05
NAMES = {VehicleKind.ARDUCOPTER: "ardupilot", VehicleKind.PX4: "px4"}


class Flown:
    """A link that pursues goals in real time."""

    def __init__(self, link: VehicleLink) -> None:
        self.link, self.begun = link, time.monotonic()
        self.texts: list[str] = []

    def until(self, goal: Goal, met: Callable[[VehicleView], bool], seconds: float) -> VehicleView:
        end = time.monotonic() + seconds
        while True:
            now = time.monotonic() - self.begun
            self.link.receive(now)
            view = self.link.view()
            self.texts += view.texts
            if met(view):
                return view
            assert time.monotonic() < end, (goal, view.mode, view.health_reason, self.texts)
            self.link.pursue(goal, now)
            time.sleep(TICK_S)

    def fly(self) -> None:
        """Up, under our control, down."""
        start = self.until(StandbyGoal(), lambda v: v.healthy and v.local is not None, 60.0)
        assert start.local is not None
        ground_m = start.local.position_ned_m[2]
        self.until(
            AirborneGoal(5.0),
            lambda v: v.local is not None and ground_m - v.local.position_ned_m[2] > 4.0,
            60.0,
        )
        self.until(FlyGoal((0.0, 0.0, 0.0)), lambda v: v.controlled, 10.0)
        self.until(LandGoal(), lambda v: not v.armed, 60.0)
        self.until(ReleaseGoal(), lambda v: v.released and not v.controlled, 10.0)


@pytest.mark.long
@pytest.mark.parametrize("kind", NAMES)
def test_three_flights_by_three_agents_without_a_reboot(kind: VehicleKind, tmp_path: Path) -> None:
    """On PX4 over `udpout`: it answers its first partner's port alone."""
    with standing([kind], tmp_path / "vehicles") as started:
        vehicle = started[1]
        endpoint = vehicle.endpoint if kind is VehicleKind.ARDUCOPTER else vehicle.ground_station
        for _ in range(3):
            link = VehicleLink(endpoint, NAMES[kind], vehicle.sysid)
            try:
                flown = Flown(link)
                flown.fly()
                assert not [text for text in flown.texts if "refused" in text]
            finally:
                link.close()
