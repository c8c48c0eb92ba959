"""The images, built, and the hexagon in containers, flown: `python -m pytest -m long tests/docker`.

podman and podman-compose are found on the PATH. SWARM_CTL_PODMAN_BUILD has more arguments for
`podman build`, where packages come from somewhere else than the internet; CONTAINERS_CONF is
podman's own.
"""

from __future__ import annotations

import json
import os
import shlex
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
COMPOSE = ROOT / "docker" / "compose.yaml"
PODMAN = "podman"
PROJECT = "swarm-ctl-test"
AGENT, GROUND = f"localhost/{PROJECT}-agent", f"localhost/{PROJECT}"
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


@pytest.fixture
def runs(tmp_path: Path) -> Iterator[Path]:
    """The folder of a flight's runs; nothing of the flight is left behind."""
    folder = tmp_path / "runs"
    folder.mkdir()
    folder.chmod(0o1777)
    yield folder
    _compose(folder, "down", "-t", "5", "-v")


def _compose(runs: Path, *words: str) -> subprocess.CompletedProcess[str]:
    env = os.environ | {
        "RUNS": str(runs),
        "SWARM_CTL_IMAGE": GROUND,
        "SWARM_CTL_AGENT_IMAGE": AGENT,
    }
    command = ["podman-compose", "-p", PROJECT, "-f", COMPOSE, *words]
    return subprocess.run(command, env=env, capture_output=True, text=True, check=False)


def test_sizes(images: dict[str, int]) -> None:
    """An agent's image has less than 200 MB, the whole one less than 400 MB."""
    assert images[AGENT] < 200
    assert images[GROUND] < 400


@pytest.mark.parametrize("time", ["first", "second"])
def test_the_hexagon_flies_from_nothing(images: dict[str, int], runs: Path, time: str) -> None:
    """`up` ends with the mission's exit code, and the folder on the host has the whole run, flown
    with keys; no private key is in it."""
    done = _compose(runs, "up", "--exit-code-from", "station")
    assert done.returncode == 0, done.stdout[-4000:] + done.stderr[-4000:]
    (run,) = runs.glob("*-hexagon")
    assert {path.name for path in run.iterdir()} >= {"report.html", "recording.mcap", "run.json"}
    summary = json.loads((run / "summary.json").read_text())
    assert summary["outcome"] == "completed"
    assert summary["min_distance_m"] > summary["r_in_m"]
    protection = summary["protection"]
    assert len(protection["authenticated"]) == len(protection["signed"]) == 6
    assert not any("PRIVATE KEY" in path.read_text(errors="replace") for path in run.rglob("*.*"))
