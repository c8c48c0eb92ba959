"""MAVSDK, a client from outside: connects, reads, flies, falls silent, and sees what the
vehicle makes of it."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.protocol.simulator import ORIGIN, Simulator, settings, simulator
from tests.protocol.simulator import wait_until as until

mavsdk = pytest.importorskip("mavsdk", reason="pip install mavsdk>=4", exc_type=ImportError)
from mavsdk.plugins.action import Action  # noqa: E402
from mavsdk.plugins.mission import Mission  # noqa: E402
from mavsdk.plugins.mission.mission import MissionItem, MissionPlan  # noqa: E402
from mavsdk.plugins.mission_raw import MissionRaw  # noqa: E402
from mavsdk.plugins.offboard import Offboard  # noqa: E402
from mavsdk.plugins.offboard.offboard import VelocityNedYaw  # noqa: E402
from mavsdk.plugins.param import Param  # noqa: E402
from mavsdk.plugins.telemetry import Telemetry  # noqa: E402
from mavsdk.plugins.telemetry.telemetry import FlightMode  # noqa: E402

pytestmark = pytest.mark.foreign
SPEEDUP = 3.0
"""MAVSDK sends setpoints 20 times a wall-clock second: still fast enough for a vehicle that lives
so much faster."""


class Client:
    """MAVSDK with one vehicle."""

    def __init__(self, sim: Simulator, *, further: bool = False) -> None:
        kind = mavsdk.ComponentType.GROUND_STATION
        self._mavsdk = mavsdk.Mavsdk(mavsdk.Configuration.create_with_component_type(kind))
        self._mavsdk.add_any_connection(
            sim.endpoint(further=further).replace("udpout:", "udpout://")
        )
        system = self._mavsdk.first_autopilot(30.0)
        assert system is not None, "no autopilot found"
        self.system = system
        self.telemetry = Telemetry(system)
        for rate in ("position", "home", "in_air", "velocity_ned", "landed_state", "health"):
            with contextlib.suppress(Exception):  # some have no message of their own
                getattr(self.telemetry, f"set_rate_{rate}")(5.0)

    def close(self) -> None:
        """Silent from now on."""
        self._mavsdk.destroy()


@contextlib.contextmanager
def client(sim: Simulator, *, further: bool = False) -> Iterator[Client]:
    """A connected one."""
    found = Client(sim, further=further)
    try:
        yield found
    finally:
        found.close()


def item(north: float, east: float, up: float) -> Any:
    """A waypoint."""
    return MissionItem(
        latitude_deg=ORIGIN["lat_deg"] + north / 111_200.0,
        longitude_deg=ORIGIN["lon_deg"] + east / 75_400.0,
        relative_altitude_m=up,
        speed_m_s=4.0,
        is_fly_through=True,
        acceptance_radius_m=1.0,
    )


def fly_mission(sim: Simulator, c: Client) -> None:
    mission = Mission(c.system)
    mission.set_return_to_launch_after_mission(False)
    plan = MissionPlan([item(8.0, 0.0, 4.0), item(8.0, 6.0, 5.0)])
    mission.upload_mission(plan)
    assert [i.command for i in MissionRaw(c.system).download_mission()] == [16, 178, 16, 178]
    mission.start_mission()
    until(sim, "mission finished", mission.is_mission_finished)
    position = c.telemetry.position()
    assert position.latitude_deg == pytest.approx(ORIGIN["lat_deg"] + 8.0 / 111_200.0, abs=3e-5)
    assert position.relative_altitude_m == pytest.approx(5.0, abs=1.5)


def fly_offboard(sim: Simulator, c: Client) -> None:
    offboard = Offboard(c.system)
    offboard.set_velocity_ned(VelocityNedYaw(0.0, 0.0, 0.0, 0.0))

    def started() -> bool:
        with contextlib.suppress(mavsdk.MavsdkError):  # PX4 wants a stream first
            offboard.start()
            return True
        return False

    until(sim, "offboard", started)
    offboard.set_velocity_ned(VelocityNedYaw(1.5, -1.0, 0.0, 0.0))
    until(sim, "velocity", lambda: c.telemetry.velocity_ned().north_m_s > 1.2)
    until(sim, "velocity", lambda: c.telemetry.velocity_ned().east_m_s < -0.8)


@pytest.mark.parametrize("persona", ["ardupilot", "px4"])
def test_mavsdk_flies_a_mission_then_velocities_and_its_silence_is_noticed(
    tmp_path: Path, persona: str
) -> None:
    configuration = settings(tmp_path, persona) | {"speedup": SPEEDUP}
    with simulator(tmp_path, configuration) as sim:
        with client(sim) as c:
            parameters = Param(c.system)
            name = {"ardupilot": "GUID_TIMEOUT", "px4": "COM_OF_LOSS_T"}[persona]
            parameters.set_param_float(name, 2.0)
            assert parameters.get_param_float(name) == 2.0
            assert (
                parameters.get_param_int({"ardupilot": "MAV_SYSID", "px4": "MAV_SYS_ID"}[persona])
                == 1
            )
            action = Action(c.system)
            until(
                sim,
                "health",
                lambda: c.telemetry.health().is_armable and c.telemetry.health_all_ok(),
            )
            action.set_takeoff_altitude(4.0)
            action.arm()
            action.takeoff()
            until(sim, "height", lambda: c.telemetry.position().relative_altitude_m > 3.0)
            assert c.telemetry.in_air()
            fly_mission(sim, c)
            fly_offboard(sim, c)
        # a PX4 answers its first partner's port alone
        with client(sim, further=persona == "px4") as c:
            if persona == "px4":
                until(sim, "failsafe", lambda: c.telemetry.flight_mode() == FlightMode.POSCTL)
            else:
                until(
                    sim,
                    "stop",
                    lambda: (
                        c.telemetry.in_air() and abs(c.telemetry.velocity_ned().north_m_s) < 0.1
                    ),
                )
                assert c.telemetry.armed()
                Action(c.system).land()
            until(sim, "landing", lambda: not c.telemetry.in_air())
            until(sim, "disarming", lambda: not c.telemetry.armed())
