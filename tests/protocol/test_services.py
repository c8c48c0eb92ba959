"""Simulated vehicles answer each request as the real autopilots do, disarmed and flying.

The same test asks the real ones, where SWARM_CTL_ARDUCOPTER and SWARM_CTL_PX4 name them: `pytest
-m autopilot tests/protocol/test_services.py`. A row in which the simulator differs is in `UNLIKE`,
with the reason.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from swarm_ctl.core.model.fleet import VehicleKind
from tests.autopilots.sitl import HERE, standing
from tests.protocol.services import SERVICES, Real, Simulated, Talk, play

PATH = Path(__file__).parents[1] / "data" / "services.json"
ANSWERS: dict[str, dict[str, dict[str, str]]] = json.loads(PATH.read_text())
"""By autopilot, state and request."""
STATES = ("disarmed", "flying")
UNLIKE: dict[str, dict[str, str]] = {
    "ardupilot": {"flight: mission start, without one": "a real one goes to AUTO without a list"},
    "px4": {
        "message: MISSION_CURRENT": "a real one has it in no stream; here it comes on request, too",
        "message: COMPONENT_METADATA": "there are no files to tell of",
        "message: COMPONENT_INFORMATION": "there are no files to tell of",
        "flight: orbit": "orbits are not simulated",
        "flight: height": "DO_CHANGE_ALTITUDE is not simulated",
    },
}
"""What the simulator answers otherwise, and why."""
SPEEDUP = {"ardupilot": 3.0, "px4": 1.0}


@contextmanager
def real(persona: str, folder: Path) -> Iterator[Real]:
    """An autopilot itself."""
    kind = VehicleKind.PX4 if persona == "px4" else VehicleKind.ARDUCOPTER
    with standing([kind], folder, SPEEDUP[persona]) as started:
        link = Real(started[1], SPEEDUP[persona], (HERE.lat_deg, HERE.lon_deg, HERE.alt_m))
        try:
            yield link
        finally:
            link.close()


def answers(talk: Talk, state: str, names: list[str]) -> dict[str, str]:
    """What it answers in this state, asked in the order of the table."""
    talk.prepare()
    told = {}
    for name in names:
        talk.be(state)
        told[name] = play(talk, name)
    return told


@pytest.mark.parametrize("state", STATES)
@pytest.mark.parametrize("persona", ["ardupilot", "px4"])
def test_a_simulated_vehicle_answers_as_the_real_one(persona: str, state: str) -> None:
    told = answers(Simulated(persona), state, list(SERVICES))
    real_ones = ANSWERS[persona][state]
    wrong = {name for name in real_ones if told[name] != real_ones[name]}
    unlike = set(UNLIKE[persona])
    assert {name: (told[name], real_ones[name]) for name in wrong - unlike} == {}


@pytest.mark.parametrize("persona", ["ardupilot", "px4"])
def test_the_table_is_whole(persona: str) -> None:
    assert ANSWERS[persona]["disarmed"].keys() == SERVICES.keys()
    assert ANSWERS[persona]["flying"].keys() <= SERVICES.keys()
    assert UNLIKE[persona].keys() <= SERVICES.keys()


@pytest.mark.long
@pytest.mark.autopilot
@pytest.mark.timeout(1800)
@pytest.mark.parametrize("state", STATES)
@pytest.mark.parametrize("persona", ["ardupilot", "px4"])
def test_the_real_one_answers_as_it_did(persona: str, state: str, tmp_path: Path) -> None:
    with real(persona, tmp_path) as talk:
        told = answers(talk, state, list(ANSWERS[persona][state]))
    assert told == ANSWERS[persona][state]
