"""Where an agent is in its steps, and how each of them went."""

from __future__ import annotations

from pathlib import Path

from swarm_ctl.core.agent.progress import Progress
from swarm_ctl.core.model.plan import Plan
from swarm_ctl.core.model.route import Routes
from swarm_ctl.mission.compile.loader import load

PLAN: Plan = load(Path(__file__).parents[4] / "missions" / "hexagon.yaml").plan


def test_results_tell_how_each_step_went() -> None:
    """A step that is broken off keeps its name and says how it ended."""
    progress = Progress(Routes(PLAN).of[1], 60.0, 1.0)
    progress.finish_step(2.0)
    progress.advance(3.0)
    progress.break_off("timeout", 4.0)
    progress.break_off("aborted", 9.0)
    assert [(r.name, r.result, r.start_s, r.end_s) for r in progress.results] == [
        ("prepare", "done", 1.0, 2.0),
        ("takeoff", "timeout", 3.0, 4.0),
    ]


def test_steps_have_the_mission_files_names() -> None:
    assert [PLAN.groups[0].step_name(k) for k in range(6)] == [
        "prepare",
        "takeoff",
        "form hexagon",
        "hold",
        "land",
        "?",
    ]
