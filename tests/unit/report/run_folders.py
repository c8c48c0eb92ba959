"""A run folder made by hand: six agents fly from Table II into the hexagon, hold it and land.

Agents 1 to 6 have the vehicles 11 to 16, so that mixing up ids and sysids shows.
"""

from __future__ import annotations

import json
import math
from dataclasses import asdict, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Final

import pytest

from swarm_ctl.core.model.fleet import FleetAgent
from swarm_ctl.core.model.messages import (
    AgentStatus,
    Command,
    Event,
    LinkReport,
    Outcome,
    Phase,
    Severity,
    StepOutcome,
    StepResult,
)
from swarm_ctl.core.model.plan import Plan
from swarm_ctl.runfolder.manifest import Manifest, write_manifest
from tests.unit.station.swarm import HEXAGON, hexagon_plan, status_of

PLAN: Final = hexagon_plan()
SYSIDS: Final = (11, 12, 13, 14, 15, 16)
CENTRE: Final = (50.0, 70.0)
START, LIFTOFF, FORM, FORMED, HOLD, LAND, TOUCHDOWN, END = (
    0.0,
    6.0,
    20.0,
    32.0,
    37.1,
    47.1,
    60.0,
    61.0,
)
"""Mission times of the flight; the vehicles reach the shape at FORMED."""
STEPS: Final = (
    StepResult("prepare", StepOutcome.DONE, START, LIFTOFF),
    StepResult("takeoff", StepOutcome.DONE, LIFTOFF, FORM),
    StepResult("form hexagon", StepOutcome.DONE, FORM, HOLD),
    StepResult("hold", StepOutcome.DONE, HOLD, LAND),
    StepResult("land", StepOutcome.DONE, LAND, END),
)
EXIT_CODES: Final = {"sim": 0, "station": 0} | {f"agent-{i}": 0 for i in range(1, 7)}


def manifest(plan: Plan = PLAN, **changes: Any) -> Manifest:
    """The manifest of the flight."""
    fleet = tuple(
        FleetAgent(
            a.id,
            sysid,
            "ardupilot",
            f"udpout:127.0.0.1:{14600 + sysid}",
            f"tcp/127.0.0.1:{7440 + a.id}",
        )
        for a, sysid in zip(plan.agents, SYSIDS, strict=False)
    )
    made: dict[str, Any] = {
        "mission": "missions/hexagon.yaml",
        "swarm": "swarm",
        "started_at": datetime(2026, 3, 1, 12, 30, tzinfo=UTC),
        "speedup": 5.0,
        "epoch_s": 1234.5,
        "headless": True,
        "plan": plan,
        "plan_hash": plan.fingerprint(),
        "fleet": fleet,
        "station_mesh": "tcp/127.0.0.1:7440",
        "versions": {"swarm-ctl": "0.1.0"},
    }
    return Manifest(**(made | changes))


def write_routed(folder: Path, at: str, **changes: Any) -> None:
    """The manifest of a run whose router listens at this place."""
    made = manifest(**changes)
    fleet = tuple(replace(agent, mesh=None, router=at) for agent in made.fleet)
    write_manifest(folder, made.model_copy(update={"fleet": fleet}))


def account(agent: int, **changes: Any) -> AgentStatus:
    """An agent's final account of the completed flight."""
    made = status_of(
        PLAN,
        agent,
        END,
        phase=Phase.ENDED,
        step=4,
        done=True,
        outcome=Outcome.COMPLETED,
        steps=STEPS,
    )
    made = replace(
        made,
        links={p.id: LinkReport(0.03, 0.02, 0.05, 990, 10) for p in PLAN.agents if p.id != agent},
    )
    return replace(made, **changes)


def position(agent: int, t: float, wobble: float = 0.0) -> tuple[float, float, float]:
    """Where the vehicle of `agent` (1..6) is at `t`: straight from start to slot between FORM and
    FORMED."""
    (n0, e0), (zn, ze) = PLAN.agents[agent - 1].start, HEXAGON[agent - 1]
    share = min(1.0, max(0.0, (t - FORM) / (FORMED - FORM)))
    north = (1 - share) * 5 * n0 + share * (CENTRE[0] + 5 * zn) + wobble * math.sin(t)
    east = (1 - share) * 5 * e0 + share * (CENTRE[1] + 5 * ze)
    return north, east, -10.0 if LIFTOFF <= t < TOUCHDOWN else 0.0


def truth_lines(until_s: float = END) -> list[str]:
    """The truth file of the flight, 10 Hz; complete if it goes to the END."""
    lines: list[dict[str, Any]] = [
        {
            "type": "header",
            "version": 1,
            "t": 0.0,
            "origin": asdict(PLAN.origin),
            "sysids": list(SYSIDS),
        }
    ]
    lines += [
        {"type": "event", "t": LIFTOFF, "sysid": sysid, "event": "liftoff"} for sysid in SYSIDS
    ]
    closest = dict.fromkeys([(a, b) for a in range(1, 7) for b in range(a + 1, 7)], math.inf)
    for k in range(int(until_s * 10) + 1):
        t = k / 10
        where = [position(agent, t) for agent in range(1, 7)]
        flying = LIFTOFF <= t < TOUCHDOWN
        state = {"type": "state", "t": t, "ned": where, "vel": [[0.0, 0.0, 0.0]] * 6}
        lines.append(state | {"armed": [int(flying)] * 6, "airborne": [int(flying)] * 6})
        shrunk = []
        for (a, b), least in closest.items():
            distance = math.dist(where[a - 1][:2], where[b - 1][:2])
            if flying and distance < least:
                closest[a, b] = distance
                shrunk.append([SYSIDS[b - 1], SYSIDS[a - 1], distance])
        if shrunk:
            lines.append({"type": "min", "t": t, "pairs": shrunk})
    if until_s >= END:
        lines += [
            {"type": "event", "t": TOUCHDOWN, "sysid": sysid, "event": "touchdown"}
            for sysid in SYSIDS
        ]
        lines.append({"type": "end", "t": END})
    return [json.dumps(line) for line in lines]


def true_minimum() -> tuple[float, tuple[int, int]]:
    """The smallest distance of the flight and its agents, worked out apart from the truth file."""
    times = [k / 10 for k in range(int(LIFTOFF * 10), int(TOUCHDOWN * 10))]
    return min(
        (math.dist(position(a, t)[:2], position(b, t)[:2]), (a, b))
        for a in range(1, 7)
        for b in range(a + 1, 7)
        for t in times
    )


def write_status(folder: Path, status: AgentStatus) -> None:
    """An agent's final account, as the agent writes it."""
    (folder / "agents").mkdir(exist_ok=True)
    (folder / "agents" / f"{status.agent}.json").write_text(json.dumps(asdict(status)))


def write_lines(path: Path, *values: AgentStatus | Command | Event) -> None:
    """A `.jsonl` file, as the station writes it."""
    path.write_text("".join(json.dumps(asdict(value)) + "\n" for value in values))


def write_run(folder: Path) -> Path:
    """A whole, completed run."""
    write_manifest(folder, manifest())
    (folder / "truth.jsonl").write_text("\n".join(truth_lines()) + "\n")
    for agent in range(1, 7):
        write_status(folder, account(agent))
    statuses = [status_of(PLAN, agent, t) for t in (25.0, 30.0) for agent in range(1, 7)]
    write_lines(folder / "statuses.jsonl", *statuses, *(account(agent) for agent in range(1, 7)))
    events = [Event(agent, END, Severity.INFO, "ended: completed") for agent in range(1, 7)]
    write_lines(
        folder / "events.jsonl", Event(2, 25.0, Severity.WARNING, "vehicle: EKF variance"), *events
    )
    return folder


def draw_nothing(patched: pytest.MonkeyPatch) -> None:
    """Figures are made and their files written, but empty."""
    patched.setattr("swarm_ctl.report.page.drawing._lay_out", lambda made: None)
    patched.setattr("matplotlib.figure.Figure.savefig", lambda *_, **__: None)
