"""From nothing to flying in one line: empty home, empty folder, no cache, packages from a folder.

    python -m tests.bench.bench_start [--wheels FOLDER]

Builds the wheel, downloads what it needs (into `--wheels`, where that is not there yet), and times
each way that is installed here (pip, uvx, pipx) from the command until six drones are airborne.
"""

from __future__ import annotations

import argparse
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Final

from tests.unit.test_house import ROOT

RUN: Final = "swarm-ctl run hexagon --headless"
FROM: Final = "'swarm-ctl[ground]'"
WAYS: Final = {
    "python3": f"python3 -m venv v && v/bin/pip install -q {FROM} && v/bin/{RUN}",
    "uvx": f"uvx --from {FROM} {RUN}",
    "pipx": f"pipx run --spec {FROM} {RUN}",
}
DRONES: Final = 6
_LONGEST_S: Final = 300.0


def wheels(folder: Path) -> None:
    """The project's wheel and all that it needs."""
    pip = [sys.executable, "-m", "pip"]
    subprocess.run([*pip, "wheel", "-q", "--no-deps", "-w", folder, ROOT], check=True)
    (wheel,) = folder.glob("swarm_ctl-*.whl")
    subprocess.run([*pip, "download", "-q", "-d", folder, f"{wheel}[ground]"], check=True)


def airborne_s(command: str, folder: Path) -> float:
    """Seconds from the command until all are in the air, by the simulator's truth."""
    with tempfile.TemporaryDirectory() as home, tempfile.TemporaryFile("w+") as told:
        offline = {"NO_INDEX": "1", "FIND_LINKS": str(folder)}
        env = {f"{tool}_{name}": value for tool in ("PIP", "UV") for name, value in offline.items()}
        env |= {"PATH": os.environ["PATH"], "HOME": home, "LANG": "C.UTF-8", "UV_OFFLINE": "1"}
        begin = time.monotonic()
        process = subprocess.Popen(
            ["/bin/sh", "-c", command], cwd=home, env=env, stdout=told, stderr=told, process_group=0
        )
        try:
            while time.monotonic() - begin < _LONGEST_S and process.poll() is None:
                truth = list(Path(home).glob("runs/*/truth.jsonl"))
                if truth and truth[0].read_text().count("liftoff") == DRONES:
                    return time.monotonic() - begin
                time.sleep(0.1)
            told.seek(0)
            raise RuntimeError(f"{command}: not airborne: {told.read()[-2000:]}")
        finally:
            if process.poll() is None:
                os.killpg(process.pid, signal.SIGINT)  # lands
                process.wait()


def main() -> None:
    """All ways that are here."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--wheels", type=Path)
    with tempfile.TemporaryDirectory() as made:
        folder = (parser.parse_args().wheels or Path(made)).absolute()
        if not list(folder.glob("swarm_ctl-*.whl")):
            wheels(folder)
        for program, command in WAYS.items():
            if shutil.which(program):
                print(f"{airborne_s(command, folder):5.1f} s  {command}", flush=True)


if __name__ == "__main__":
    main()
