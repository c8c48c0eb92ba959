"""ArduCopters in containers fly as those beside them, and none is left behind.

SWARM_CTL_TEST_IMAGE names an image with `arducopter` on its PATH.
"""

from __future__ import annotations

import os
import signal
import subprocess
import time
from pathlib import Path

import pytest

from swarm_ctl.engine.vehicles.containers import PREFIX, Image, find_image
from swarm_ctl.errors import StartError
from tests.autopilots.sitl import Flight

PAIR = Path(__file__).with_name("pair.yaml")
VARIABLE = "SWARM_CTL_TEST_IMAGE"


@pytest.fixture
def image(monkeypatch: pytest.MonkeyPatch) -> Image:
    if not (name := os.environ.get(VARIABLE)):
        pytest.skip(f"{VARIABLE} names no container image with arducopter")
    try:
        found = find_image(PREFIX + name)
    except StartError as error:
        pytest.skip(str(error))
    monkeypatch.setenv("SWARM_CTL_ARDUCOPTER", PREFIX + name)
    return found


def containers(image: Image) -> list[str]:
    """The names of all, also of those that have ended, and are not removed."""
    command = [image.engine, "ps", "--all", "--format", "{{.Names}}", "--filter", "name=swarm-ctl-"]
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout.split()


def assert_none_left(image: Image) -> None:
    until = time.monotonic() + 10.0
    while left := containers(image):
        assert time.monotonic() < until, left
        time.sleep(0.2)


def test_a_mission_completes(image: Image, tmp_path: Path) -> None:
    with Flight(PAIR, "arducopter", cwd=tmp_path, speedup=2) as flight:
        flight.wait_for_step(2)
        assert len(containers(image)) == 2
        flight.assert_completed()
        assert_none_left(image)
        assert (flight.folder / "vehicles" / "1" / "logs").is_dir()


@pytest.mark.long
@pytest.mark.parametrize("killed", ["vehicles", "client", "run"])
def test_a_container_ends_whichever_process_is_killed(
    image: Image, tmp_path: Path, killed: str
) -> None:
    """At 10 m; when `run` is killed, its vehicles land before their containers end."""
    with Flight(PAIR, "arducopter", cwd=tmp_path, speedup=2) as flight:
        flight.wait_for_step(3)
        client = flight.started[1].pid
        pids = {"vehicles": flight.pids["vehicles"], "client": client, "run": flight.process.pid}
        os.kill(pids[killed], signal.SIGKILL)
        begun = time.monotonic()
        while len(containers(image)) > (1 if killed == "client" else 0):
            assert time.monotonic() < begun + (60.0 if killed == "run" else 5.0)
            time.sleep(0.1)
        flight.wait(240.0)
        flight.assert_nothing_left()
        assert_none_left(image)
