"""Each ready mission on the simulated vehicles and on the autopilots themselves, side by side.

    python -m tests.bench.bench_vehicles [--missions hexagon,crossing] [--speedup 1]
        [--autopilots arducopter,px4] [--runs FOLDER]

Prints, as a Markdown table, the time of each step [s], the time to form, the smallest distance and
the formation error [m], by the vehicles' own estimates where there is no truth. Each autopilot
stands beside the simulated vehicle that plays it; the difference to that one is in brackets.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from swarm_ctl.mission.compile.loader import load

MISSIONS: Final = Path(__file__).parents[2] / "missions"
READY: Final = ("hexagon", "crossing", "square", "letters", "sweep")
AUTOPILOTS: Final = ("arducopter", "px4")
SIMULATED_SPEEDUP: Final = "4"
PERSONA: Final = {"arducopter": "ardupilot", "px4": "px4"}


def main() -> int:
    """Fly all and print the table; 1 where a flight was not completed."""
    parser = argparse.ArgumentParser(formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--missions", default=",".join(READY))
    parser.add_argument("--autopilots", default=",".join(AUTOPILOTS))
    parser.add_argument("--speedup", default="1", help="of the autopilots")
    parser.add_argument("--runs", help="keep the runs' folders here")
    asked = parser.parse_args()
    autopilots = asked.autopilots.split(",")
    titles = [title for each in autopilots for title in (f"simulated {PERSONA[each]}", each)]
    print("| mission | figure |", " | ".join(titles), "|")
    print("|---|---|" + "---|" * len(titles))
    completed = True
    with tempfile.TemporaryDirectory() as scratch:
        bench = Bench(Path(scratch), Path(asked.runs or scratch), asked.speedup)
        for mission in asked.missions.split(","):
            pairs = [bench.both(mission, autopilot) for autopilot in autopilots]
            names = dict.fromkeys(name for pair in pairs for each in pair for name in each)
            for name in names:
                cells = [cell for pair in pairs for cell in _cells(*(x.get(name) for x in pair))]
                print(f"| {mission} | {name} |", " | ".join(cells), "|", flush=True)
            completed &= all(each["outcome"] == "completed" for pair in pairs for each in pair)
    return int(not completed)


@dataclass(frozen=True)
class Bench:
    """Where fleets are written, where runs go, and how fast they fly."""

    scratch: Path
    runs: Path
    speedup: str

    def both(self, mission: str, autopilot: str) -> tuple[dict[str, Any], dict[str, Any]]:
        """The figures of the simulated vehicles and of the autopilot, by name."""
        agents = load(MISSIONS / f"{mission}.yaml").file.agents
        fleet = self.scratch / f"{mission}-{autopilot}.yaml"
        rows = [f"  - {{id: {agent.id}, autopilot: {PERSONA[autopilot]}}}" for agent in agents]
        fleet.write_text("agents:\n" + "\n".join(rows) + "\n")
        simulated = self._flown(mission, fleet, "simulated", SIMULATED_SPEEDUP)
        return simulated, self._flown(mission, fleet, autopilot, self.speedup)

    def _flown(self, mission: str, fleet: Path, vehicles: str, speedup: str) -> dict[str, Any]:
        runs = self.runs / f"{fleet.stem}-{vehicles}"
        command = [sys.executable, "-m", "swarm_ctl.cli.main", "run"]
        command += [str(MISSIONS / f"{mission}.yaml"), "--fleet", str(fleet)]
        command += ["--vehicles", vehicles, "--speedup", speedup]
        command += ["--headless", "--no-report", "--no-tlog", "--runs", str(runs)]
        flown = subprocess.run(command, capture_output=True, text=True, check=False)
        summaries = sorted(runs.glob("*/summary.json"))
        if not summaries:
            return {"outcome": (flown.stdout + flown.stderr).strip().splitlines()[-1]}
        return _figures(json.loads(summaries[-1].read_text()))


def _figures(summary: dict[str, Any]) -> dict[str, Any]:
    figures: dict[str, Any] = {"outcome": summary["outcome"]}
    if summary["reason"]:
        figures["outcome"] += f": {summary['reason']}"
    for step in summary["steps"][1:]:
        if step["end_s"] is not None:
            figures[f"{step['name']} [s]"] = step["end_s"] - step["start_s"]
        if step["time_to_form_s"] is not None:
            figures[f"{step['name']}: formed after [s]"] = step["time_to_form_s"]
    figures["smallest distance [m]"] = summary["min_distance_m"]
    figures["its doubt [m]"] = summary["min_distance_doubt_m"]
    figures["formation error [m]"] = summary["formation_error_m"]
    return figures


def _cells(simulated: Any, flown: Any) -> Iterator[str]:
    yield _cell(simulated)
    both = isinstance(simulated, float) and isinstance(flown, float) and simulated != 0.0
    yield _cell(flown) + (f" ({100 * (flown / simulated - 1):+.0f} %)" if both else "")


def _cell(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:.2f}"
    return "-" if value is None else str(value)


if __name__ == "__main__":
    sys.exit(main())
