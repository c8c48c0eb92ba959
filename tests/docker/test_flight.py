"""The images, built, and the hexagon in containers, flown: `python -m pytest -m long tests/docker`.

podman and podman-compose are found on the PATH. SWARM_CTL_PODMAN_BUILD has more arguments for
`podman build`, where packages come from somewhere else than the internet; CONTAINERS_CONF is
podman's own. SWARM_CTL_ARDUCOPTER is the autopilot of compose.ardupilot.yaml: a binary, which is
put into an image here, or `container:IMAGE`.
"""

from __future__ import annotations

import json
import os
import shlex
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parents[2]
PODMAN = "podman"
PROJECT = "swarm-ctl-test"
AGENT, GROUND = f"localhost/{PROJECT}-agent", f"localhost/{PROJECT}"
RELAY = Path(__file__).with_name("arducopter_relay.py")
FILE = """\
FROM docker.io/library/python:3.12-slim
COPY --chmod=755 arducopter arducopter.bin /usr/local/bin/
"""
pytestmark = [pytest.mark.long, pytest.mark.timeout(900)]


@pytest.fixture(scope="module")
def images() -> dict[str, int]:
    """Both images; their sizes [MB]."""
    for program in ("podman", "podman-compose"):
        if shutil.which(program) is None:
            pytest.skip(f"{program} is not on the PATH")
    more = shlex.split(os.environ.get("SWARM_CTL_PODMAN_BUILD", ""))
    for target, tag in {"agent": AGENT, "ground": GROUND}.items():
        # fmt: off
        done = subprocess.run(
            [PODMAN, "build", "--format", "docker", *more, "-f", ROOT / "docker" / "Dockerfile",
             "--target", target, "-t", tag, ROOT],
            capture_output=True, text=True, check=False,
        )
        # fmt: on
        assert done.returncode == 0, done.stderr[-4000:]
    asked = shlex.split("podman image inspect --format {{.Size}}")
    sizes = [subprocess.check_output([*asked, tag]) for tag in (AGENT, GROUND)]
    return {tag: int(size) // 1_000_000 for tag, size in zip((AGENT, GROUND), sizes, strict=True)}


@pytest.fixture(scope="module")
def autopilot(images: dict[str, int], tmp_path_factory: pytest.TempPathFactory) -> str:
    """An image with `arducopter`."""
    said = os.environ.get("SWARM_CTL_ARDUCOPTER")
    if not said:
        pytest.skip("no ArduCopter; SWARM_CTL_ARDUCOPTER names a binary or container:IMAGE")
    if said.startswith("container:"):
        return said.removeprefix("container:")
    folder, tag = tmp_path_factory.mktemp("arducopter"), f"localhost/{PROJECT}-arducopter"
    shutil.copy(said, folder / "arducopter.bin")
    shutil.copy(RELAY, folder / "arducopter")
    (folder / "Dockerfile").write_text(FILE)
    more = shlex.split(os.environ.get("SWARM_CTL_PODMAN_BUILD", ""))
    subprocess.run([PODMAN, "build", *more, "-t", tag, folder], capture_output=True, check=True)
    return tag


@pytest.fixture
def runs(tmp_path: Path) -> Iterator[Path]:
    """The folder of a flight's runs; nothing of the flight is left behind."""
    folder = tmp_path / "runs"
    folder.mkdir()
    folder.chmod(0o1777)
    yield folder
    for file in ("compose.yaml", "compose.ardupilot.yaml"):
        _compose(file, folder, "down", "-t", "5", "-v")


def _compose(
    file: str, runs: Path, *words: str, autopilot: str = ""
) -> subprocess.CompletedProcess[str]:
    env = os.environ | {
        "RUNS": str(runs),
        "SWARM_CTL_IMAGE": GROUND,
        "SWARM_CTL_AGENT_IMAGE": AGENT,
        "SWARM_CTL_ARDUPILOT_IMAGE": autopilot,
    }
    command = ["podman-compose", "-p", PROJECT, "-f", ROOT / "docker" / file, *words]
    # Into a file: podman-compose leaves children that hold its output for as long as the containers
    # run, and the end of a pipe would be waited for.
    output = runs.with_name("compose.log")
    with output.open("w") as log:
        done = subprocess.run(command, env=env, stdout=log, stderr=log, check=False)
    return subprocess.CompletedProcess(command, done.returncode, output.read_text())


def test_sizes(images: dict[str, int]) -> None:
    """An agent's image has less than 200 MB, the whole one less than 400 MB."""
    assert images[AGENT] < 200
    assert images[GROUND] < 400


@pytest.mark.parametrize("time", ["first", "second"])
def test_the_hexagon_flies_from_nothing(images: dict[str, int], runs: Path, time: str) -> None:
    """`up` ends with the mission's exit code, and the folder on the host has the whole run, flown
    with keys; no private key is in it."""
    done = _compose("compose.yaml", runs, "up", "--exit-code-from", "station")
    assert done.returncode == 0, done.stdout[-4000:]
    protection = _completed(runs)["protection"]
    assert len(protection["authenticated"]) == len(protection["signed"]) == 6


@pytest.mark.parametrize("time", ["first", "second"])
def test_the_hexagon_flies_on_arducopters_from_nothing(
    autopilot: str, runs: Path, time: str
) -> None:
    """The same on real autopilots, by their own estimates; their links are not signed."""
    words = ("up", "--exit-code-from", "station")
    done = _compose("compose.ardupilot.yaml", runs, *words, autopilot=autopilot)
    assert done.returncode == 0, done.stdout[-4000:]
    protection = _completed(runs)["protection"]
    assert len(protection["authenticated"]) == 6
    assert not protection["signed"]


def _completed(runs: Path) -> dict[str, Any]:
    """The summary of the one run in a folder, which has all that a run leaves and no key."""
    (run,) = runs.glob("*-hexagon")
    assert {path.name for path in run.iterdir()} >= {"report.html", "recording.mcap", "run.json"}
    summary: dict[str, Any] = json.loads((run / "summary.json").read_text())
    assert summary["outcome"] == "completed"
    assert summary["min_distance_m"] > summary["r_in_m"]
    assert not any("PRIVATE KEY" in path.read_text(errors="replace") for path in run.rglob("*.*"))
    return summary
