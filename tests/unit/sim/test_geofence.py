"""The fence that a vehicle was sent: it acts once the vehicle is where that forbids it."""

from __future__ import annotations

from typing import Any

import pytest

from swarm_sim.firmware.ardupilot_persona import ArdupilotPersona
from swarm_sim.firmware.px4_persona import Px4Persona
from tests.unit.sim.harness import IN_AIR, Rig
from tests.unit.sim.test_missions import item, upload

BOX = [item(5001, n, e, 0.0, 4.0) for n, e in ((-50, -50), (50, -50), (50, 50), (-50, 50))]
POND = [item(5004, 30.0, 5.0, 0.0, 6.0)]


def flying(persona: Any, **parameters: float) -> Rig:
    """Armed and in the air, 10 m north of the origin, with a fence and a pond."""
    rig = Rig(persona, ready_after_s=0.0, start=IN_AIR)
    for name, value in parameters.items():
        rig.firmware.parameters.set(name, value)
    assert upload(rig, BOX + POND, 1) == [0]
    rig.firmware.set_armed()
    rig.run(1.0, gcs=True)
    return rig


def at(rig: Rig, north: float, east: float) -> None:
    rig.said.clear()
    rig.move(position_ned_m=(north, east, -10.0))
    rig.run(0.2, gcs=True)


@pytest.mark.parametrize(("action", "mode"), [(0, None), (1, "RTL"), (2, "LAND")])
@pytest.mark.parametrize("place", [(30.0, 3.0), (60.0, 0.0)])
def test_an_arducopter_acts_once(action: int, mode: str | None, place: tuple[float, float]) -> None:
    rig = flying(ArdupilotPersona, FENCE_ENABLE=1, FENCE_ACTION=action)
    before = rig.firmware.mode.name
    at(rig, 10.0, 5.0)
    assert rig.texts() == []
    at(rig, *place)
    assert rig.texts()[0] == "Polygon fence breached"
    assert rig.firmware.mode.name == (mode or before)
    at(rig, *place)
    assert "Polygon fence breached" not in rig.texts()


@pytest.mark.parametrize("parameters", [{"FENCE_ENABLE": 0}, {"FENCE_ENABLE": 1, "FENCE_TYPE": 3}])
def test_a_fence_that_is_off_does_nothing(parameters: dict[str, float]) -> None:
    rig = flying(ArdupilotPersona, **parameters)
    at(rig, 60.0, 0.0)
    assert rig.texts() == []


@pytest.mark.parametrize(
    ("action", "mode"), [(2, "AUTO.LOITER"), (3, "AUTO.RTL"), (5, "AUTO.LAND")]
)
def test_a_px4_acts_by_its_parameter(action: int, mode: str) -> None:
    rig = flying(Px4Persona, GF_ACTION=action)
    at(rig, 60.0, 0.0)
    assert "Geofence violation" in rig.texts()
    assert rig.firmware.mode.name == mode
