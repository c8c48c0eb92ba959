"""The simulator as a process: how it starts, refuses and ends."""

from __future__ import annotations

import contextlib
import signal
import socket
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from tests.protocol.simulator import Pilot, command_line, free_port, pilot, settings, simulator


def refused(tmp_path: Path, configuration: dict[str, Any]) -> tuple[int, str, str]:
    """Exit code, stdout, stderr of one that doesn't start."""
    done = subprocess.run(
        command_line(tmp_path, configuration),
        input="",
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    return done.returncode, done.stdout, done.stderr


def test_says_once_that_it_is_ready_and_where_it_listens(tmp_path: Path) -> None:
    configuration = settings(tmp_path, "ardupilot", n=3)
    with simulator(tmp_path, configuration) as sim:
        listed = [
            {"sysid": v["sysid"], "endpoint": v["endpoint"]} for v in configuration["vehicles"]
        ]
        assert sim.ready == {"ready": True, "vehicles": listed}
        sim.cut_lifeline()
        assert sim.end() == 0
        assert sim.process.stdout is not None
        assert sim.process.stdout.read() == ""
    assert [line["type"] for line in sim.truth()][0 :: 10**6] == ["header"]
    assert sim.truth()[-1]["type"] == "end"


def test_a_bad_configuration_is_one_clear_line_and_exit_code_2(tmp_path: Path) -> None:
    configuration = settings(tmp_path, "ardupilot")
    configuration["vehicles"][0]["persona"] = "betaflight"
    code, out, err = refused(tmp_path, configuration)
    assert (code, out) == (2, "")
    assert len(err.splitlines()) == 1
    assert "vehicles[0].persona" in err
    assert "'ardupilot' or 'px4'" in err


def test_a_busy_port_names_its_endpoint_and_exits_with_3(tmp_path: Path) -> None:
    configuration = settings(tmp_path, "ardupilot", n=2)
    endpoint = configuration["vehicles"][1]["endpoint"]
    with contextlib.closing(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) as other:
        other.bind(("127.0.0.1", int(endpoint.split(":")[2])))
        code, out, err = refused(tmp_path, configuration)
    assert (code, out) == (3, "")
    assert len(err.splitlines()) == 1
    assert endpoint in err


def test_a_further_endpoint_is_left_out_where_its_port_is_taken(tmp_path: Path) -> None:
    configuration = settings(tmp_path, "px4")
    taken, free = free_port(), free_port()
    configuration["vehicles"][0]["also"] = [f"udpin:127.0.0.1:{taken}", f"udpin:127.0.0.1:{free}"]
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind(("127.0.0.1", taken))
        with simulator(tmp_path, configuration) as sim:
            configuration["vehicles"][0]["endpoint"] = f"udpin:127.0.0.1:{free}"
            with contextlib.closing(Pilot(sim)) as pilot:
                assert pilot.wait("HEARTBEAT").get_srcSystem() == 1
            sim.cut_lifeline()
            assert sim.end() == 0
            assert sim.process.stderr is not None
            assert f"udpin:127.0.0.1:{taken}: can't be opened" in sim.process.stderr.read()


def test_a_truth_file_that_can_not_be_written_exits_with_3(tmp_path: Path) -> None:
    configuration = settings(tmp_path, "ardupilot")
    (tmp_path / "file").write_text("")
    configuration["truth_path"] = str(tmp_path / "file" / "truth.jsonl")
    code, _, err = refused(tmp_path, configuration)
    assert code == 3
    assert err == f"sim: {tmp_path / 'file'}: File exists\n"


def test_without_a_configuration_it_says_what_it_wants() -> None:
    done = subprocess.run(
        [sys.executable, "-m", "swarm_sim"], capture_output=True, text=True, timeout=60, check=False
    )
    assert done.returncode == 2
    assert "--config" in done.stderr


def test_sigterm_ends_it_at_once_with_a_finished_truth_file(tmp_path: Path) -> None:
    with simulator(tmp_path, settings(tmp_path, "ardupilot")) as sim, pilot(sim):
        sim.process.send_signal(signal.SIGTERM)
        assert sim.end() == 0
    assert sim.truth()[-1]["type"] == "end"


def test_sigint_is_not_for_it(tmp_path: Path) -> None:
    """The terminal's Ctrl-C reaches the whole process group; landing the swarm needs the
    vehicles."""
    with simulator(tmp_path, settings(tmp_path, "ardupilot")) as sim, pilot(sim) as p:
        sim.process.send_signal(signal.SIGINT)
        p.wait("HEARTBEAT")
        p.wait("HEARTBEAT")
        assert sim.process.poll() is None


def test_sigkill_in_flight_leaves_a_readable_truth_file(tmp_path: Path) -> None:
    with simulator(tmp_path, settings(tmp_path, "ardupilot", n=2)) as sim, pilot(sim) as p:
        p.stream(1, 2.0)
        p.stream(33, 5.0)
        p.wait("SYS_STATUS", lambda m: bool(m.onboard_control_sensors_health & 0x10000000))
        assert p.command(176, 1, 4) == 0
        assert p.command(400, 1) == 0
        assert p.command(22, 0, 0, 0, 0, 0, 0, 5.0) == 0
        p.wait("GLOBAL_POSITION_INT", lambda m: m.relative_alt > 1000)
        at = sim.now()
        sim.process.kill()
        sim.process.wait()
    lines = sim.truth()
    assert lines[0]["type"] == "header"
    assert {"state", "event", "min"} <= {line["type"] for line in lines}
    assert lines[-1]["type"] != "end"
    assert lines[-1]["t"] == pytest.approx(at, abs=2.0)


def test_a_bad_key_is_one_line_and_exit_code_2(tmp_path: Path) -> None:
    (tmp_path / "key").write_bytes(b"sesame")
    configuration = settings(tmp_path, "ardupilot")
    configuration["vehicles"][0]["signing_key_path"] = str(tmp_path / "key")
    code, out, err = refused(tmp_path, configuration)
    assert (code, out, len(err.splitlines())) == (2, "", 1)
    assert "key" in err
    assert "sesame" not in err
