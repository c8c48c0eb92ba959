"""The core alone, as on a drone's computer: an environment with no extra flies a plan file."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tarfile
import time
import zipfile
from pathlib import Path

import pytest

from swarm_ctl.mission.compile.plan_file import plan_to_json
from tests.system.pair import SPEEDUP, agent, ended, pair_mission, simulator
from tests.system.running import HEXAGON, ROOT

pytestmark = pytest.mark.timeout(180)

EXTRAS = ("textual", "matplotlib", "scipy", "mcap", "yaml", "prometheus_client")
UNREACHABLE = re.compile(
    r"No module named pip|No matching distribution|Could not find a version|Connection|Max retries"
)
"""What pip says where there is no pip, or no index that it can reach."""
ENV = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}


@pytest.fixture(scope="module")
def core(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The `bin` folder of a fresh environment with the package and no extras."""
    folder = tmp_path_factory.mktemp("core")
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", folder], check=True)
    pip = [sys.executable, "-m", "pip", "--python", str(folder / "bin" / "python"), "install"]
    done = subprocess.run(
        [*pip, "--quiet", "--no-compile", str(ROOT)],
        capture_output=True,
        text=True,
        check=False,
        env=ENV,
    )
    if done.returncode and UNREACHABLE.search(done.stderr):
        pytest.skip(f"pip can reach no packages: {done.stderr.strip().splitlines()[-1]}")
    assert done.returncode == 0, done.stderr
    return folder / "bin"


def test_the_core_has_no_extras(core: Path) -> None:
    """None of them can be imported; a command that needs them says what to install."""
    code = f"import importlib.util as u; print([m for m in {EXTRAS} if u.find_spec(m)])"
    found = subprocess.check_output([core / "python", "-c", code], text=True, env=ENV)
    assert found.strip() == "[]"
    for words in ("run", "agent --id 1", "sim --mission"):
        done = subprocess.run(
            [core / "swarm-ctl", *words.split(), HEXAGON],
            capture_output=True,
            text=True,
            check=False,
            env=ENV,
        )
        assert done.returncode == 3, done.stderr
        assert done.stderr.count("\n") == 1
        assert "install with: pip install 'swarm-ctl[ground]'" in done.stderr


def test_it_installs_no_name_that_others_may_have(core: Path) -> None:
    """Two packages alone, and the ready missions in one of them."""
    code = "from importlib import metadata as m; print(*m.files('swarm-ctl'), sep='\\n')"
    files = subprocess.check_output([core / "python", "-c", code], text=True, env=ENV).split()
    assert "swarm_ctl/ready_missions/hexagon.yaml" in files
    names = {name.split("/")[0] for name in files}
    (about,) = (name for name in names if name.endswith(".dist-info"))
    assert names == {"swarm_ctl", "swarm_sim", about, ".."}
    assert [name for name in files if name.startswith("..")] == ["../../../bin/swarm-ctl"]


def test_the_core_flies_a_plan(core: Path, tmp_path: Path) -> None:
    """Two agents take off, form, land and exit with 0; plan and simulator come from the ground."""
    mission, speedup, epoch_s = pair_mission(tmp_path), SPEEDUP, time.monotonic()
    plan = tmp_path / "plan.json"
    plan.write_text(plan_to_json(mission.plan, mission.fleet))
    agents = [agent(plan, i, epoch_s, speedup, command=core / "swarm-ctl", env=ENV) for i in (1, 2)]
    with ended([simulator(mission, epoch_s, speedup), *agents]):
        told = [each.communicate(timeout=90)[1].decode() for each in agents]
        assert [each.returncode for each in agents] == [0, 0], told
        for each in told:
            assert each.startswith("agent: ready\n")
            assert each.endswith("agent: completed\n")


def test_a_checkout_and_its_sdist_make_the_same_wheel_that_knows_its_commit(tmp_path: Path) -> None:
    """The same bytes from another folder, with other times and another umask."""
    if not (ROOT / ".git").exists():
        pytest.skip("no git here")
    source, unpacked = tmp_path / "source", tmp_path / "elsewhere" / "unpacked"
    git = str(shutil.which("git"))
    subprocess.run([git, "clone", "--quiet", ROOT, source], check=True, umask=0o077)
    (sdist,) = _built(source, "sdist")
    (wheel,) = _built(source, "wheel")
    with tarfile.open(sdist) as archive:
        archive.extractall(unpacked, filter="data")
    (again,) = _built(next(unpacked.iterdir()), "wheel")
    assert again.read_bytes() == wheel.read_bytes()
    head = subprocess.check_output([git, "-C", source, "rev-parse", "HEAD"], text=True)
    with zipfile.ZipFile(wheel) as files:
        assert files.read("swarm_ctl/commit.txt").decode() == head.strip()
        assert "swarm_ctl/build_hook.py" not in files.namelist()


def _built(source: Path, kind: str) -> list[Path]:
    folder = source / "made" / kind
    words = [sys.executable, "-m", "hatchling", "build", "-t", kind, "-d", str(folder)]
    subprocess.run(words, cwd=source, check=True, capture_output=True)
    return list(folder.glob("swarm_ctl-*"))
