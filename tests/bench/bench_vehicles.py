"""Each ready mission on the simulated vehicles and on the autopilots themselves, side by side.

    python -m tests.bench.bench_vehicles [--missions hexagon,crossing] [--speedup 1]
        [--vehicles simulated,arducopter,px4]

Prints, as a Markdown table, the time of each step [s], the time to form, the smallest distance and
the formation error [m]. Distances of simulated vehicles are true; those of autopilots are by their
own estimates, with the doubt. A cell of another figure than the simulator's has the difference.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any, Final

MISSIONS: Final = Path(__file__).parents[2] / "missions"
READY: Final = ("hexagon", "crossing", "square", "letters", "sweep")
KINDS: Final = ("simulated", "arducopter", "px4")


def main() -> int:
    """Fly all and print the table; 1 where a flight was not completed."""
    parser = argparse.ArgumentParser(formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--missions", default=",".join(READY))
    parser.add_argument("--vehicles", default=",".join(KINDS))
    parser.add_argument("--speedup", default="1")
    asked = parser.parse_args()
    kinds = asked.vehicles.split(",")
    print("| mission | figure |", " | ".join(kinds), "|")
    print("|---|---|" + "---|" * len(kinds))
    completed = True
    for mission in asked.missions.split(","):
        found = {kind: _fly(mission, kind, asked.speedup) for kind in kinds}
        for name in dict.fromkeys(name for figures in found.values() for name in figures):
            cells = [_cell(figures.get(name), found[kinds[0]].get(name))
                     for figures in found.values()]  # fmt: skip
            print(f"| {mission} | {name} |", " | ".join(cells), "|", flush=True)
        completed &= all(figures["outcome"] == "completed" for figures in found.values())
    return int(not completed)


def _fly(mission: str, kind: str, speedup: str) -> dict[str, Any]:
    """The figures of one flight, by name."""
    with tempfile.TemporaryDirectory() as runs:
        command = [sys.executable, "-m", "swarm_ctl.cli.main", "run"]
        command += [str(MISSIONS / f"{mission}.yaml"), "--vehicles", kind, "--speedup", speedup]
        command += ["--headless", "--no-report", "--no-tlog", "--runs", runs]
        flown = subprocess.run(command, capture_output=True, text=True, check=False)
        summaries = list(Path(runs).glob("*/summary.json"))
        if not summaries:
            return {"outcome": flown.stdout.strip().splitlines()[-1]}
        return _figures(json.loads(summaries[0].read_text()))


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


def _cell(value: Any, first: Any) -> str:
    if not isinstance(value, float):
        return "-" if value is None else str(value)
    if not isinstance(first, float) or value is first or first == 0.0:
        return f"{value:.2f}"
    return f"{value:.2f} ({100 * (value / first - 1):+.0f} %)"


if __name__ == "__main__":
    sys.exit(main())
