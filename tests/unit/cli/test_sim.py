"""`swarm-ctl sim` as a user calls it: what it starts, shows and refuses."""

from __future__ import annotations

import contextlib
import re
import signal
import socket
import subprocess
import sys
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import common

from swarm_ctl.cli.flight.sim import _from_mission, _origin, _parameter
from swarm_ctl.engine.launch.ports import free_ports
from swarm_ctl.engine.launch.sim_config import grid
from swarm_ctl.errors import InputError
from tests.unit.cli.test_main import called

HEXAGON = Path(__file__).parents[3] / "missions" / "hexagon.yaml"
COMMAND = [str(Path(sys.executable).parent / "swarm-ctl"), "sim"]


def base_port(kind: socket.SocketKind) -> int:
    return free_ports(1, kind)[0] - 1


def test_it_says_where_vehicles_listen_serves_them_and_ends_at_ctrl_c(tmp_path: Path) -> None:
    base = base_port(socket.SOCK_DGRAM)
    truth = tmp_path / "truth.jsonl"
    command = [*COMMAND, "--persona", "px4", "--base-port", str(base), "--truth", str(truth)]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as running:
        try:
            assert running.stdout is not None
            lines = [running.stdout.readline() for _ in range(3)]
            assert re.search(
                rf"1 +px4 +udpin:127.0.0.1:{base + 1} +udpout:127.0.0.1:{base + 1}", lines[1]
            )
            with contextlib.closing(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) as client:
                client.settimeout(20.0)
                hello = common.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3).pack(
                    common.MAVLink(None, 255, 190)
                )
                client.sendto(hello, ("127.0.0.1", base + 1))
                assert client.recv(2000)[0] == 0xFD
            running.send_signal(signal.SIGINT)
            assert running.wait(20) == 0
        finally:
            running.kill()
    assert truth.read_text().splitlines()[-1].startswith('{"type":"end"')


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["--home", "here"], "LAT,LON,ALT"),
        (["--parameter", "SIM_LOSS"], "NAME=NUMBER"),
        (["--parameter", "SIM_NOTHING=1"], "SIM_WIND_SPD"),
        (["--endpoint", "serial:/dev/ttyS0"], "endpoint"),
        (["--endpoint", "udpin:0.0.0.0:14601"], "any computer could command vehicle 1"),
        (["--endpoint", "udpin:127.0.0.1:1", "--endpoint", "udpin:127.0.0.1:2"], "one a vehicle"),
    ],
)
def test_bad_input_is_one_message_and_exit_code_2(
    arguments: list[str],
    told: str,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> None:
    """The simulator's own process says some of them."""
    assert called(monkeypatch, "sim", *arguments) == 2
    said = capfd.readouterr().err
    assert told in said
    assert "Traceback" not in said


def test_a_busy_port_is_exit_code_3() -> None:
    with contextlib.closing(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) as other:
        other.bind(("127.0.0.1", 0))
        endpoint = f"udpin:127.0.0.1:{other.getsockname()[1]}"
        done = subprocess.run(
            [*COMMAND, "--endpoint", endpoint],
            capture_output=True,
            text=True,
            timeout=60,
            check=False,
        )
    assert done.returncode == 3
    assert endpoint in done.stderr


def test_starts_come_from_a_grid_or_a_mission() -> None:
    assert grid(5, 2.0) == [(0.0, 0.0), (0.0, 2.0), (0.0, 4.0), (2.0, 0.0), (2.0, 2.0)]
    assert len(set(grid(250, 5.0))) == 250
    settings = _from_mission(HEXAGON, None)
    starts = settings["vehicles"]
    assert [(start["persona"], start["sysid"]) for start in starts] == [
        ("ardupilot", i) for i in range(1, 7)
    ]
    assert settings["origin"]["lat_deg"] != 0.0
    assert len({(start["lat_deg"], start["lon_deg"]) for start in starts}) == 6
    assert _origin("47.5,8.5,400").alt_m == 400.0
    assert _parameter("SIM_WIND_SPD=2.5") == ("SIM_WIND_SPD", 2.5)
    with pytest.raises(InputError):
        _origin("1,2")
