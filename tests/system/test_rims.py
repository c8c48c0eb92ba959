"""A whole flight in which all that only shows fails at random, in every process: it is flown to its
end, and the summary names what failed."""

from __future__ import annotations

import contextlib
import os
from pathlib import Path

import pytest

from tests.protocol.qgroundcontrol import QGroundControl
from tests.system.running import LOW, Running
from tests.system.terminal import Terminal, needs_tmux

pytestmark = [pytest.mark.lockstep, pytest.mark.timeout(300)]

PLUG = """
import importlib.abc
import importlib.util
import random
import sys

PARTS = {parts!r}
RANDOM = random.Random(3)


def plugged(part, share, after):
    calls = [0]

    def plug(*args, **named):
        calls[0] += 1
        if calls[0] > after and RANDOM.random() < share:
            raise RANDOM.choice([IndexError("plugged"), RecursionError("plugged"), MemoryError()])
        return part(*args, **named)

    return plug


class Finder(importlib.abc.MetaPathFinder):
    def find_spec(self, name, path, target=None):
        if name not in PARTS:
            return None
        # ours aside, so that the usual finders are asked
        sys.meta_path.remove(self)
        spec = importlib.util.find_spec(name)
        sys.meta_path.insert(0, self)
        run = spec.loader.exec_module

        def exec_module(module):
            run(module)
            for name, share, after in PARTS[module.__name__]:
                owner, _, last = name.rpartition(".")
                at = getattr(module, owner) if owner else module
                setattr(at, last, plugged(getattr(at, last), share, after))

        spec.loader.exec_module = exec_module
        return spec


sys.meta_path.insert(0, Finder())
"""
SHOWS = {
    "swarm_ctl.station.picture.model": [("Model.view", 0.3, 20), ("Model.fold", 0.05, 100)],
    "swarm_ctl.station.output.log_lines": [("log_lines", 0.3, 5)],
    "swarm_ctl.station.foxglove.desk": [("Desk.hear", 0.01, 50)],
    "swarm_ctl.recording.mcap_recorder": [("Recorder._record", 0.1, 50)],
    "swarm_ctl.recording.run_recorder": [("RunRecorder.take", 0.02, 100)],
    "swarm_ctl.engine.vehicle_memory": [
        ("SwarmMemory.hear", 0.2, 5),
        ("Remembering.serve", 0.2, 5),
    ],
    "swarm_ctl.mavlink.link": [("VehicleLink.share", 0.2, 20)],
    "swarm_ctl.report.page.html_page": [("make_report", 1.0, 0)],
}
"""(function, share of its calls that fail, calls that go well before), by module."""


def plug(folder: Path, parts: dict[str, list[tuple[str, float, int]]]) -> dict[str, str]:
    """The environment of a command whose processes have the plug in these parts."""
    folder.mkdir()
    (folder / "sitecustomize.py").write_text(PLUG.replace("{parts!r}", repr(parts)))
    path = os.environ.get("PYTHONPATH", "")
    return {"PYTHONPATH": os.pathsep.join([str(folder), *([path] if path else [])])}


def test_a_flight_in_which_all_that_shows_fails_at_random(tmp_path: Path) -> None:
    """Completed, with exit code 0, all agents at their pace; each trouble is told once, in flight
    and in the summary's warnings; a report that fails changes nothing. Nor does the end of the
    relay to a ground control software, which is told, too."""
    env, run = plug(tmp_path / "plug", SHOWS), ("run", LOW, "--lockstep", "--speedup", "5")
    with (
        contextlib.closing(QGroundControl()) as qgc,
        Running(*run, "--headless", "--gcs", str(qgc.port), cwd=tmp_path, env=env) as running,
    ):
        running.wait_for_event("step 2:")  # of one agent: the record loses some
        running.kill("gcs")
        assert running.wait() == 0, running.output
        running.assert_nothing_left()
        summary, output = running.summary(), running.output
    assert summary["outcome"] == "completed"
    assert {agent["outcome"] for agent in summary["agents"]} == {"completed"}
    assert summary["setpoint_rate_hz"] > 9  # of 10
    warnings = "; ".join(summary["warnings"])
    for part in ("the picture of the swarm", "the record of a message", "Foxglove's view"):
        assert part in warnings
        assert 1 <= warnings.count(part) <= 2
    said = output.replace("\n", " ")
    assert "the picture of the swarm failed" in said
    assert "ground control software is not served any more" in said
    assert "the page can't be made: " in said
    assert "Traceback" not in output


@needs_tmux
def test_a_dashboard_that_fails_gives_way_to_log_lines_in_flight(tmp_path: Path) -> None:
    """An error where no rim of ours is, in a widget's own drawing: the flight is flown to its end,
    and the terminal has the log of it."""
    parts = {"swarm_ctl.station.dashboard.drawing.widgets": [("Painted.render_line", 1.0, 100)]}
    env = plug(tmp_path / "plug", parts)
    words = [f"{name}={value}" for name, value in env.items()]
    command = ("run", LOW, "--lockstep", "--speedup", "8", "--no-report")
    swarm_ctl = Terminal.__init__.__kwdefaults__["program"]
    with Terminal(*command, cwd=tmp_path, program=("env", *words, *swarm_ctl)) as terminal:
        terminal.wait_for("the dashboard ended by an error", 200.0)
        terminal.wait_for("ended: completed", 200.0)
        code, shown = terminal.wait_for_end()
    assert code == 0, shown
