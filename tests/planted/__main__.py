"""Plants faults into copies of this tree, one at a time, and flies drawn scenarios in each until an
invariant breaks.

    python -m tests.planted                            # all, up to 1,000 flights each: hours
    python -m tests.planted filter-half --flights 200

This tree flies the scenarios first: what breaks something here is no find. Of each fault those are
flown that it may touch, by the words of the scenario's file. The folder (`--out`) has a journal of
all, so the same command goes on where it was ended. The exit code is 0 where all were found, 1
where one was not, 2 for bad input.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Final, NamedTuple

from swarm_ctl.fuzz.campaign import Campaign, fly
from swarm_ctl.virtual.scenario import load_scenario, scenario_text
from tests.planted.faults import FAULTS, Fault

ROOT: Final = Path(__file__).parents[2]


def main(words: list[str] | None = None) -> int:
    """Its exit code."""
    parser = argparse.ArgumentParser(prog="python -m tests.planted", description=__doc__)
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.add_argument("names", nargs="*", metavar="FAULT", help="default: all")
    parser.add_argument("--flights", type=int, default=1000, help="drawn; default: 1000")
    parser.add_argument("--seed", type=int, default=1, help="default: 1")
    parser.add_argument("--out", type=Path, default=Path("planted"), help="default: planted")
    parser.add_argument("--here", nargs=3, help=argparse.SUPPRESS)
    given = parser.parse_args(words)
    if given.here is not None:  # what the command says to itself in the copy
        _fly_here(*given.here)
        return 0
    unknown = sorted(set(given.names) - {fault.name for fault in FAULTS})
    if unknown or given.flights < 1:
        allowed = ", ".join(fault.name for fault in FAULTS)
        said = f"{', '.join(unknown)}; allowed: {allowed}" if unknown else "--flights; allowed: > 0"
        sys.stderr.write(f"{said}\n")
        return 2
    out = given.out.resolve()
    drawn = _drawn(Campaign(given.seed, out / "clean"), given.flights)
    chosen = [fault for fault in FAULTS if not given.names or fault.name in given.names]
    found = 0
    for fault in chosen:
        trial = _tried(fault, drawn, given.flights, out / fault.name)
        found += trial.number is not None
        sys.stdout.write(f"{trial}\n")
        sys.stdout.flush()
    sys.stdout.write(f"{found} of {len(chosen)} found\n")
    return 0 if found == len(chosen) else 1


class Trial(NamedTuple):
    """How one fault fared."""

    fault: str
    drawn: int
    flown: int
    """Of those drawn, the ones that it may touch."""
    number: int | None
    """Of the flight that found it."""
    broken: str

    def __str__(self) -> str:
        found = f"not found in {self.drawn}"
        if self.number is not None:
            found = f"found by flight {self.number}"
        return f"{self.fault:18} {found:19} {self.flown:4} flown  {self.broken}".rstrip()


def plant(fault: Fault, folder: Path) -> None:
    """Copy this tree to a folder, which is not there yet, and change the copy. ValueError: the text
    is not in its file exactly once."""
    source = (ROOT / fault.path).read_text(encoding="utf-8")
    if (times := source.count(fault.was)) != 1:
        raise ValueError(f"{fault.name}: {fault.path} has its text {times} times; allowed: once")
    ignored = shutil.ignore_patterns("__pycache__")
    for part in ("swarm_ctl", "sim", "missions", "tests/planted"):
        shutil.copytree(ROOT / part, folder / part, ignore=ignored)
    shutil.copy(ROOT / "tests" / "__init__.py", folder / "tests")
    text = source.replace(fault.was, fault.becomes)
    (folder / fault.path).write_text(text, encoding="utf-8")


def _drawn(campaign: Campaign, flights: int) -> dict[int, Path]:
    """The scenarios that break nothing in this tree, by number."""
    campaign.load()
    for flight in campaign.fly(flights, processes=1):
        for each in flight.broken:
            said = each.text.strip().splitlines()[-1]
            sys.stdout.write(f"without a fault, flight {flight.number}: {each.invariant}: {said}\n")
            sys.stdout.flush()
    folder = campaign.folder / "scenarios"
    folder.mkdir(exist_ok=True)
    good = [number for number in range(flights) if not campaign.done[number].broken]
    paths = {number: folder / f"{number}.yaml" for number in good}
    for number, path in paths.items():
        if not path.exists():
            path.write_text(scenario_text(campaign.scenario(number)[0]), encoding="utf-8")
    return paths


def _tried(fault: Fault, drawn: dict[int, Path], flights: int, journal: Path) -> Trial:
    meant = [path for path in drawn.values() if re.search(fault.meets, path.read_text("utf-8"))]
    known = _read(journal)
    missing = [path for path in meant if int(path.stem) not in known]
    if missing and not any(known.values()):
        with tempfile.TemporaryDirectory() as temporary:
            _flown_with(fault, missing, journal, Path(temporary))
        known = _read(journal)
    number = min((number for number, broken in known.items() if broken), default=None)
    return Trial(fault.name, flights, len(known), number, "" if number is None else known[number])


def _flown_with(fault: Fault, scenarios: Sequence[Path], journal: Path, temporary: Path) -> None:
    plant(fault, temporary / "tree")
    names = temporary / "scenarios"
    names.write_text("".join(f"{path}\n" for path in scenarios), encoding="utf-8")
    here = fault.name, str(names), str(journal)
    command = [sys.executable, "-m", "tests.planted", "--here", *here]
    paths = os.pathsep.join((str(temporary / "tree"), str(temporary / "tree" / "sim")))
    environment = os.environ | {"PYTHONPATH": paths}
    subprocess.run(command, cwd=temporary / "tree", env=environment, check=True)


def _fly_here(name: str, names: str, journal: str) -> None:
    """These scenarios, until one breaks something; each leaves a line."""
    (lockstep,) = (fault.lockstep for fault in FAULTS if fault.name == name)
    for path in map(Path, Path(names).read_text(encoding="utf-8").split()):
        _, found = fly(*load_scenario(path), lockstep=lockstep)
        words = [f"{each.invariant}: {each.text.strip().splitlines()[-1]}" for each in found]
        with Path(journal).open("a", encoding="utf-8") as file:
            file.write(json.dumps([int(path.stem), "; ".join(words)]) + "\n")
        if found:
            return


def _read(journal: Path) -> dict[int, str]:
    """What each flight broke, by number; ''."""
    lines = journal.read_text(encoding="utf-8").splitlines() if journal.exists() else []
    return dict(json.loads(line) for line in lines)


if __name__ == "__main__":
    sys.exit(main())
