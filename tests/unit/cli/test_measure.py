"""`swarm-ctl measure` as a user calls it: what it refuses before anything flies."""

from __future__ import annotations

import contextlib
import os
import re
import socket
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from swarm_ctl.cli.checks.measure import described, measure
from swarm_ctl.cli.flight.sim import Persona
from swarm_ctl.core.identification.fit import fit
from swarm_ctl.core.model.fleet import VehicleKind
from swarm_ctl.core.model.plan import Response
from swarm_ctl.engine.launch.ports import free_ports
from swarm_ctl.errors import InputError
from tests.unit.core.identification.test_fit import flown
from tests.unit.mission.example import TEXT

COMMAND = [str(Path(sys.executable).parent / "swarm-ctl"), "measure"]
FLEET = "# mine\nagents:\n  - {id: 1, sysid: 11}\n  - {id: 2, endpoint: 'udpout:127.0.0.1:1'}\n"


@pytest.fixture
def fleet(tmp_path: Path) -> Path:
    path = tmp_path / "fleet.yaml"
    path.write_text(FLEET)
    return path


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        ({}, "allowed: --fleet FILE, a mission, or --endpoint URL"),
        ({"fleet": "FLEET"}, "--id is missing; allowed: 1, 2, several of them, or all"),
        ({"fleet": "FLEET", "agent_id": "1,7"}, "--id 7 is not in the fleet; allowed: 1, 2"),
        ({"fleet": "FLEET", "agent_id": "x"}, "--id 'x'; allowed: ids and ranges"),
        (
            {"fleet": "FLEET", "agent_id": "1", "speed": 30.0},
            "--speed 30: over the limit; allowed: up to 20 m/s",
        ),
        (
            {"fleet": "FLEET", "agent_id": "1", "box": 5.0},
            "--box 5: steps of 5 m/s lead farther; allowed: 22.5 m",
        ),
        (
            {"fleet": "FLEET", "agent_id": "1", "sysid": 3},
            "--sysid: the fleet says what a vehicle is; allowed: with --endpoint",
        ),
        (
            {"fleet": "FLEET", "agent_id": "1", "autopilot": Persona.PX4},
            "--autopilot: the fleet says what a vehicle is; allowed: with --endpoint",
        ),
        (
            {"vehicles": VehicleKind.ARDUCOPTER, "autopilot": Persona.PX4},
            "--autopilot: --vehicles names what a vehicle is; allowed: with --endpoint",
        ),
        ({"fleet": Path("nowhere.yaml")}, "nowhere.yaml: (whole file): can't be read"),
        (
            {"endpoint": "udpout:127.0.0.1:1", "agent_id": "1"},
            "--endpoint is a vehicle of no fleet",
        ),
        (
            {"endpoint": "udpin:0.0.0.0:14601"},
            "agent 1 listens for its vehicle at udpin:0.0.0.0:14601, and the fleet has no keys",
        ),
        (
            {"vehicles": VehicleKind.PX4, "fleet": "FLEET"},
            "--vehicles starts a vehicle of no fleet; allowed: that alone",
        ),
        (
            {"mission": "BARE", "agent_id": "1"},
            "has no fleet to write into; allowed: --fleet FILE, a fleet section",
        ),
        (
            {"mission": "BARE", "agent_id": "1", "dry_run": True, "speed": 6.0},
            "allowed: up to 5 m/s",
        ),
        (
            {"mission": "BARE", "fleet": "FLEET", "agent_id": "3"},
            "agent 3 has no entry in the fleet",
        ),
    ],
)
def test_it_refuses_before_anything_flies(
    arguments: dict[str, Any], told: str, fleet: Path
) -> None:
    bare = fleet.with_name("bare.yaml")
    bare.write_text(TEXT[: TEXT.index("fleet:")])
    files = {"FLEET": fleet, "BARE": bare}
    given = {name: files.get(value, value) for name, value in arguments.items()}
    with pytest.raises(InputError, match=re.escape(told)):
        measure(**{"speed": None, "box": None, "height": 10.0, "speedup": 1.0} | given)
    assert fleet.read_text() == FLEET


def test_a_file_that_can_not_be_written_is_refused_before_the_flight(
    fleet: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(os, "access", lambda *_: False)
    with pytest.raises(
        InputError, match="can't be written; allowed: a file and folder that may be, or --dry-run"
    ):
        measure(fleet=fleet, agent_id="1", speed=None, box=None, height=10.0, speedup=1.0)


def test_the_figures_in_words() -> None:
    legs = flown(Response(0.4, 0.5, 2.0))
    lines = described(fit(legs, Response()), legs)
    assert (
        lines[0] == "response: {dead_time_s: 0.4, lag_s: 0.5, acceleration_mps2: 2, doubt_s: 0.1}"
    )
    assert lines[1] == (
        "dead time 0.40 s, lag 0.50 s, together known to 0.10 s; acceleration limit 2 m/s2"
    )
    assert lines[2] == "residual 0.00 m/s, 0% of the step"
    assert lines[-1] == "  3 m/s for 3 s alone (north / east): 0.40 / 0.40 s, 0.50 / 0.50 s"


def test_an_endpoint_that_does_not_open_is_exit_code_3() -> None:
    (port,) = free_ports(1, socket.SOCK_DGRAM)
    with contextlib.closing(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) as other:
        other.bind(("127.0.0.1", port))
        done = subprocess.run(
            [*COMMAND, "--endpoint", f"udpin:127.0.0.1:{port}"],
            capture_output=True,
            text=True,
            timeout=60,
            check=False,
        )
    assert done.returncode == 3
    assert str(port) in done.stderr
