"""Each ready mission on the simulated vehicles and on the autopilots themselves, side by side.

    python -m tests.bench.bench_vehicles [--missions hexagon,crossing] [--speedup 1]
        [--autopilots arducopter,px4] [--seeds 5] [--flights 1] [--runs FOLDER]

Prints, as a Markdown table, the time of each step [s], the time to form, the smallest distance and
the formation error [m], by the vehicles' own estimates where there is no truth. Each autopilot
stands beside the simulated vehicle that plays it, flown in lockstep with as many seeds. Of several
flights: the median, and the least and the most in brackets; then how far the autopilot's median is
from the simulated one.
"""

from __future__ import annotations

import argparse
import json
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, TypeAlias

from swarm_ctl.mission.compile.loader import load

MISSIONS: Final = Path(__file__).parents[2] / "missions"
READY: Final = ("hexagon", "crossing", "square", "letters", "sweep")
AUTOPILOTS: Final = ("arducopter", "px4")
Figures: TypeAlias = dict[str, list[Any]]
"""Of several flights, by name."""
PERSONA: Final = {"arducopter": "ardupilot", "px4": "px4"}


def main() -> int:
    """Fly all and print the table; 1 where a flight was not completed."""
    parser = argparse.ArgumentParser(formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--missions", default=",".join(READY))
    parser.add_argument("--autopilots", default=",".join(AUTOPILOTS))
    parser.add_argument("--speedup", default="1", help="of the autopilots")
    parser.add_argument("--seeds", type=int, default=5, help="of the simulated vehicles")
    parser.add_argument("--flights", type=int, default=1, help="of the autopilots")
    parser.add_argument("--runs", help="keep the runs' folders here")
    asked = parser.parse_args()
    autopilots = asked.autopilots.split(",")
    titles = [title for each in autopilots for title in (f"simulated {PERSONA[each]}", each)]
    print("| mission | figure |", " | ".join(titles), "|")
    print("|---|---|" + "---|" * len(titles))
    completed = True
    with tempfile.TemporaryDirectory() as scratch:
        runs = Path(asked.runs or scratch)
        bench = Bench(Path(scratch), runs, asked.speedup, asked.seeds, asked.flights)
        for mission in asked.missions.split(","):
            pairs = [bench.both(mission, autopilot) for autopilot in autopilots]
            names = dict.fromkeys(name for pair in pairs for each in pair for name in each)
            for name in names:
                cells = [cell for pair in pairs for cell in _cells(*(x.get(name) for x in pair))]
                print(f"| {mission} | {name} |", " | ".join(cells), "|", flush=True)
            completed &= all(set(x["outcome"]) == {"completed"} for pair in pairs for x in pair)
    return int(not completed)


@dataclass(frozen=True)
class Bench:
    """Where fleets are written, where runs go, how fast the autopilots fly, and how often all."""

    scratch: Path
    runs: Path
    speedup: str
    seeds: int
    flights: int

    def both(self, mission: str, autopilot: str) -> tuple[Figures, Figures]:
        """The figures of the simulated vehicles and of the autopilot."""
        agents = load(MISSIONS / f"{mission}.yaml").file.agents
        fleet = self.scratch / f"{mission}-{autopilot}.yaml"
        rows = [f"  - {{id: {agent.id}, autopilot: {PERSONA[autopilot]}}}" for agent in agents]
        fleet.write_text("agents:\n" + "\n".join(rows) + "\n")
        seeds, flights = range(1, self.seeds + 1), range(1, self.flights + 1)
        simulated = [self._flown(mission, fleet, "simulated", "max", seed) for seed in seeds]
        flown = [self._flown(mission, fleet, autopilot, self.speedup, k) for k in flights]
        return _together(simulated), _together(flown)

    def _flown(
        self, mission: str, fleet: Path, vehicles: str, speedup: str, seed: int
    ) -> dict[str, Any]:
        runs = self.runs / f"{fleet.stem}-{vehicles}-{seed}"
        command = [sys.executable, "-m", "swarm_ctl.cli.main", "run"]
        command += [str(MISSIONS / f"{mission}.yaml"), "--fleet", str(fleet)]
        command += ["--vehicles", vehicles, "--speedup", speedup, "--seed", str(seed)]
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


def _together(flights: list[dict[str, Any]]) -> Figures:
    """The flights' figures by name."""
    names = dict.fromkeys(name for flight in flights for name in flight)
    return {name: [flight.get(name) for flight in flights] for name in names}


def _cells(simulated: list[Any] | None, flown: list[Any] | None) -> Iterator[str]:
    yield _cell(simulated)
    before, after = _numbers(simulated), _numbers(flown)
    off = ""
    if before and after and statistics.median(before) != 0.0:
        off = f" ({100 * (statistics.median(after) / statistics.median(before) - 1):+.0f} %)"
    yield _cell(flown) + off


def _cell(values: list[Any] | None) -> str:
    numbers = _numbers(values)
    if not numbers:
        told = dict.fromkeys(str(value) for value in values or () if value is not None)
        return "; ".join(told) or "-"
    median, low, high = statistics.median(numbers), min(numbers), max(numbers)
    spread = "" if f"{low:.2f}" == f"{high:.2f}" else f" [{low:.2f} to {high:.2f}]"
    return f"{median:.2f}{spread}"


def _numbers(values: list[Any] | None) -> list[float]:
    return [value for value in values or () if isinstance(value, float)]


if __name__ == "__main__":
    sys.exit(main())
