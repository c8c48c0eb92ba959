"""The driver against the simulator, both personas. Every wait is for an observed state, bounded in
mission time.

The whole way up and down again goes over UDP to the simulator's own process, `SPEEDUP` times faster
than the wall clock; what else may happen is played in memory on a virtual clock.
"""

from __future__ import annotations

import contextlib
import json
import math
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import common

from swarm_ctl.core.model.vehicle import (
    AirborneGoal,
    FlyGoal,
    Goal,
    LandGoal,
    ReleaseGoal,
    StandbyGoal,
    VehicleView,
    YieldGoal,
)
from swarm_ctl.mavlink.link import VehicleLink
from swarm_ctl.mavlink.wires import MemoryWire, memory_wires
from swarm_sim.config import SimConfig
from swarm_sim.network.hub import Hub

SPEEDUP = 3.0
"""Slow enough that a busy machine (0.3 s without us) does not cost a setpoint time-out of 1 s."""
TICK_S = 0.05
WITHIN_S = 90.0
SYSID = 7
ORIGIN = {"lat_deg": 47.397742, "lon_deg": 8.545594, "alt_m": 488.0}
DEFAULTS = {
    "ardupilot": {
        "GUID_TIMEOUT": 3.0,
        "MAV_GCS_SYSID": 255.0,
        "MAV_GCS_SYSID_HI": 0.0,
        "FS_GCS_TIMEOUT": 5.0,
        "FS_GCS_ENABLE": 0.0,
    },
    "px4": {"COM_OF_LOSS_T": 1.0, "COM_OBL_RC_ACT": 0.0},
}
CONTROLLED = {"ardupilot": "GUIDED", "px4": "OFFBOARD"}

both = pytest.mark.parametrize("persona", DEFAULTS)


class Flight:
    """One simulated vehicle and its link, in this process: bytes carried in memory, on a virtual
    clock."""

    def __init__(self, persona: str, *, ready_after_s: float = 1.0, autopilot: str = "") -> None:
        near, self._far = memory_wires()
        vehicle = _vehicle(persona, 14600, ready_after_s)
        settings = {"version": 1, "epoch_s": 0.0, "origin": ORIGIN, "vehicles": [vehicle]}
        self._hub = Hub(
            SimConfig.model_validate(settings), 0.0, lambda _, data, __: self._far.write(data)
        )
        self._start(near, autopilot or persona)

    def _start(self, wire: str | MemoryWire, autopilot: str) -> None:
        self.link = VehicleLink(wire, autopilot, SYSID)
        self.texts: list[str] = []
        self._next_s = 0.0

    def now(self) -> float:
        """Mission time."""
        return self._next_s

    def _wait_for_tick(self) -> None:
        self._next_s += TICK_S
        while (data := self._far.read()) is not None:
            self._hub.receive(0, data, ("agent", 1))
        while self._hub.world.next_s <= self._next_s:
            self._hub.step()

    def tick(self, goal: Goal | None) -> VehicleView:
        """One tick of a control loop; None: it stalls, and only listens."""
        self._wait_for_tick()
        now = self.now()
        self.link.receive(now)
        view = self.link.view()
        self.texts += view.texts
        if goal is not None:
            self.link.pursue(goal, now)
        return view

    def until(self, done: Callable[[VehicleView], bool], goal: Goal | None) -> VehicleView:
        """Pursue `goal` until the view shows `done`."""
        end = self.now() + WITHIN_S
        while not done(view := self.tick(goal)):
            if self.now() > end:
                pytest.fail(f"not seen within {WITHIN_S} s: {view}; texts: {self.texts}")
        return view

    def airborne(self) -> None:
        self.until(lambda view: view.healthy, StandbyGoal())
        self.until(lambda view: height(view) > 2.5, AirborneGoal(3.0))

    def flying(self, persona: str) -> None:
        self.airborne()
        self.until(
            lambda view: view.mode == CONTROLLED[persona] and speed(view) > 1.8,
            FlyGoal((2.0, 0.0, 0.0)),
        )

    def close(self) -> None:
        self.link.close()


class RealFlight(Flight):
    """The same over UDP, with the simulator's own process, on the wall clock."""

    def __init__(self, folder: Path, persona: str) -> None:
        self.epoch_s = time.monotonic()
        port = _free_port()
        truth = {
            "truth_path": str(folder / "truth.jsonl"),
            "speedup": SPEEDUP,
            "epoch_s": self.epoch_s,
        }
        config = {
            "version": 1,
            "origin": ORIGIN,
            "vehicles": [_vehicle(persona, port, 1.0)],
        } | truth
        (folder / "sim.json").write_text(json.dumps(config))
        arguments = [sys.executable, "-m", "swarm_sim", "--config", str(folder / "sim.json")]
        self.simulator = subprocess.Popen(arguments, stdin=subprocess.PIPE, stdout=subprocess.PIPE)
        assert self.simulator.stdout is not None
        assert json.loads(self.simulator.stdout.readline())["ready"] is True
        self._start(f"udpout:127.0.0.1:{port}", persona)
        self._next_s = self.now()

    def now(self) -> float:
        """Mission time, shared with the simulator."""
        return (time.monotonic() - self.epoch_s) * SPEEDUP

    def _wait_for_tick(self) -> None:
        self._next_s = max(self._next_s + TICK_S, self.now() - 5 * TICK_S)
        time.sleep(max(0.0, (self._next_s - self.now()) / SPEEDUP))

    def close(self) -> None:
        super().close()
        self.simulator.kill()
        self.simulator.communicate()


def _vehicle(persona: str, port: int, ready_after_s: float) -> dict[str, Any]:
    where = {"endpoint": f"udpin:127.0.0.1:{port}", "ready_after_s": ready_after_s, **ORIGIN}
    return {"sysid": SYSID, "persona": persona, **where}


@contextlib.contextmanager
def flight(persona: str, **how: Any) -> Iterator[Flight]:
    with contextlib.closing(Flight(persona, **how)) as made:
        yield made


@contextlib.contextmanager
def real_flight(folder: Path, persona: str) -> Iterator[RealFlight]:
    with contextlib.closing(RealFlight(folder, persona)) as made:
        yield made


def _free_port() -> int:
    with contextlib.closing(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
        return port


def height(view: VehicleView) -> float:
    return view.global_.relative_alt_m if view.global_ else 0.0


def speed(view: VehicleView) -> float:
    return math.hypot(*view.local.velocity_ned_mps[:2]) if view.local else 0.0


def down(view: VehicleView) -> bool:
    return view.on_ground and not view.armed


@both
def test_the_whole_way_up_and_down_again(persona: str, tmp_path: Path) -> None:
    with real_flight(tmp_path, persona) as fly:
        fly.flying(persona)
        view = fly.until(down, LandGoal())
        assert not view.released
        fly.until(lambda view: view.released, ReleaseGoal())
        own = {name: each.own for name, each in fly.link._autopilot.parameters.own.items()}
        assert own == DEFAULTS[persona]
        counters = fly.link.counters
        assert (counters.lost, counters.bad_frames, counters.foreign) == (0, 0, 0)
        assert (counters.rejected, counters.errors) == (0, 0)
        assert fly.texts == [], "nothing was refused"


def test_a_slow_start_is_waited_out() -> None:
    """A real ArduCopter's cold start: ready after 42 s, no local position before although its
    stream was accepted."""
    with flight("ardupilot", ready_after_s=42.0) as fly:
        view = fly.until(lambda view: math.isfinite(view.heartbeat_s), StandbyGoal())
        assert not view.healthy
        view = fly.until(lambda view: view.healthy, StandbyGoal())
        assert fly.link._heard.boot_s >= 42.0
        assert view.local is not None
        assert view.origin is not None
        fly.until(lambda view: view.armed and not view.on_ground, AirborneGoal(3.0))


def test_a_stream_that_another_ground_station_slows_is_taken_back() -> None:
    with flight("ardupilot") as fly:
        fly.until(lambda view: view.healthy, StandbyGoal())
        message = common.MAVLink_request_data_stream_message(
            SYSID, 1, common.MAV_DATA_STREAM_ALL, 4, 1
        )
        fly.link._send(message, fly.now())
        gaps = Gaps(fly)
        fly.until(lambda view: gaps.newest() == pytest.approx(0.25, abs=0.02), None)
        fly.until(lambda view: gaps.newest() == pytest.approx(0.05, abs=0.02), StandbyGoal())


class Gaps:
    """The time between local positions, by the vehicle's own clock."""

    def __init__(self, fly: Flight) -> None:
        self._heard = fly.link._heard
        self._count, self._boot_s = self._heard.counts[32], self._heard.boot_s

    def newest(self) -> float:
        """The mean over those that came since the last call; NaN if none came."""
        came, passed_s = self._heard.counts[32] - self._count, self._heard.boot_s - self._boot_s
        self._count, self._boot_s = self._heard.counts[32], self._heard.boot_s
        return passed_s / came if came else math.nan


def test_an_ardupilot_without_setpoints_stops_in_guided_and_goes_on() -> None:
    with flight("ardupilot") as fly:
        fly.flying("ardupilot")
        view = fly.until(lambda view: speed(view) < 0.1, YieldGoal())  # heartbeats go on
        assert (view.mode, view.armed) == ("GUIDED", True)
        fly.until(lambda view: speed(view) > 1.8, FlyGoal((2.0, 0.0, 0.0)))


@both
def test_a_vehicle_whose_agent_has_died_lands_by_itself(persona: str) -> None:
    with flight(persona) as fly:
        fly.flying(persona)
        fly.until(lambda view: view.landing, None)
        fly.until(down, None)


@both
def test_a_mode_changed_by_a_pilot_is_not_fought(persona: str) -> None:
    with flight(persona) as fly:
        fly.flying(persona)
        pilots = {"ardupilot": "LOITER", "px4": "AUTO.LOITER"}[persona]
        message = fly.link._autopilot.set_mode(pilots)
        fly.link._send(message, fly.now())
        fly.until(lambda view: not view.controlled, FlyGoal((0.0, 0.0, 0.0)))
        setpoints, end = fly.link.counters.setpoints, fly.now() + 10.0
        assert (
            fly.until(
                lambda view: view.controlled or fly.now() > end, FlyGoal((0.0, 0.0, 0.0))
            ).mode
            == pilots
        )
        assert fly.link.counters.setpoints == setpoints
        end = fly.now() + 5.0
        assert (
            fly.until(lambda view: view.controlled or fly.now() > end, YieldGoal()).mode == pilots
        )


@both
def test_another_firmware_than_the_fleet_says_is_a_fault(persona: str) -> None:
    other = {"ardupilot": "px4", "px4": "ardupilot"}[persona]
    with flight(persona, autopilot=other) as fly:
        view = fly.until(lambda view: view.fault != "", StandbyGoal())
        assert f"allowed here: {other}" in view.fault
        end = fly.now() + 5.0
        assert not fly.until(lambda view: view.armed or fly.now() > end, AirborneGoal(5.0)).armed


def test_a_vehicle_that_vanishes_is_told_by_its_heartbeats_age(tmp_path: Path) -> None:
    with real_flight(tmp_path, "ardupilot") as fly:
        fly.airborne()
        fly.simulator.kill()
        fly.simulator.wait()
        view = fly.until(lambda view: fly.now() - view.heartbeat_s > 5.0, FlyGoal((1.0, 0.0, 0.0)))
        assert view.health_reason == "heartbeat lost"
        assert fly.link.counters.errors > 0
