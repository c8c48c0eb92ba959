"""Flies drawn scenarios by the thousand, on all cores, and keeps what they broke.

A campaign has a folder: `flights.jsonl` has a line for each flight, so the same command goes on
where one was ended; `found/` has a scenario and a test for each thing that was found.
"""

from __future__ import annotations

import contextlib
import itertools
import json
import multiprocessing
import os
import re
import signal
import tempfile
import traceback
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, Final

from swarm_ctl.cores import cores
from swarm_ctl.engine.clock import cpu_s, wall_s
from swarm_ctl.engine.launch.flight_process import FlightProcess, ProgramFlight
from swarm_ctl.engine.launch.run_setup import Lockstep, RunOptions
from swarm_ctl.engine.station.screens import Show
from swarm_ctl.errors import InputError, StartError
from swarm_ctl.files import append_line
from swarm_ctl.fuzz.coverage import Coverage, CoverageCell, cells_of
from swarm_ctl.fuzz.draw.scenario import draw
from swarm_ctl.fuzz.invariants.table import Broken, Invariant, broken
from swarm_ctl.installed import version
from swarm_ctl.mission.compile.loader import LoadedMission, dumps
from swarm_ctl.runfolder.files import write_whole
from swarm_ctl.signals import deaf_children, deaf_tracker, hears
from swarm_ctl.virtual.as_processes import run_script
from swarm_ctl.virtual.scenario import Scenario
from swarm_ctl.virtual.scenario_flight import FlownScenario, fly_scenario

FLIGHTS: Final = "flights.jsonl"
FOUND: Final = "found"
BATCH: Final = 100
"""What was met so far is looked at before each batch; so no flight depends on how many processes
fly."""
_TWICE: Final = 50
"""One in so many is flown twice: the same seed has the same bytes."""
_LOOKS_S: Final = 2.0
"""Without a flight that is done, by the wall clock, it is looked whether all processes live."""
_LONGEST: Final = 2000
"""Characters of a traceback."""


def fly(
    scenario: Scenario,
    mission: LoadedMission,
    folder: Path | None = None,
    *,
    twice: bool = False,
    lockstep: bool = False,
) -> tuple[FlownScenario | None, list[Broken]]:
    """Fly a scenario, and what it broke; None: it raised an error. `folder`: for what a run leaves;
    `twice`: where nothing broke, it is flown again and has to be the same; `lockstep`: by
    processes, too, if they can."""
    try:
        flown = fly_scenario(scenario, mission, folder)
        found = broken(flown)
        if twice and not found:
            # A folder keeps fewer statuses, so what its verdict tells of a killed agent may be
            # older.
            first = flown if folder is None else fly_scenario(scenario, mission)
            if fly_scenario(scenario, mission).digest != first.digest:
                found = [Broken(Invariant.SAME, "flown twice, it was not the same")]
        if lockstep and not found and (unlike := unlike_as_processes(scenario, mission)):
            found = [Broken(Invariant.ALIKE, unlike)]
    except Exception:  # what is looked for: an error of any kind
        words = traceback.format_exc()[-_LONGEST:]
        return None, [Broken(Invariant.RAISES, words)]
    return flown, found


@dataclass(frozen=True, slots=True)
class DrawnFlight:
    """One line of the journal."""

    number: int
    outcome: str
    flown_s: float
    """Mission time."""
    cpu_s: float
    cells: tuple[CoverageCell, ...]
    broken: tuple[Broken, ...]

    def line(self) -> str:
        """As JSON."""
        found = [[each.invariant.name, each.text] for each in self.broken]
        values = {
            "number": self.number,
            "outcome": self.outcome,
            "flown_s": self.flown_s,
            "cpu_s": self.cpu_s,
            "cells": [list(cell) for cell in self.cells],
            "broken": found,
        }
        return json.dumps(values, separators=(",", ":"))

    @classmethod
    def by_number(cls, lines: Iterable[str | bytes]) -> dict[int, DrawnFlight]:
        """Of these lines, but for what was cut off: that is flown again."""
        flights = dict[int, DrawnFlight]()
        for line in lines:
            with contextlib.suppress(ValueError, KeyError, TypeError):
                flight = cls.of(line)
                flights[flight.number] = flight
        return flights

    @classmethod
    def of(cls, line: str | bytes) -> DrawnFlight:
        """ValueError, KeyError or TypeError where the line is none."""
        values = json.loads(line)
        cells = tuple(CoverageCell(*cell) for cell in values["cells"])
        found = tuple(Broken(Invariant[name], text) for name, text in values["broken"])
        return cls(
            values["number"], values["outcome"], values["flown_s"], values["cpu_s"], cells, found
        )


@dataclass(slots=True)
class Campaign:
    """Flights from one seed."""

    seed: int
    folder: Path
    mission: dict[str, Any] | None = None
    """A user's own, as data."""
    lockstep: int = 0
    """One in so many is flown by processes in lockstep, too; 0: none is."""
    done: dict[int, DrawnFlight] = field(default_factory=dict)

    def load(self) -> None:
        """Take up what was flown before. InputError where the folder is another campaign's."""
        path = self.folder / FLIGHTS
        if not path.exists():
            self.folder.mkdir(parents=True, exist_ok=True)
            write_whole(path, json.dumps(self._head()) + "\n")
            return
        head, *lines = path.read_text(encoding="utf-8").splitlines() or [""]
        if head != json.dumps(self._head()):
            raise InputError(
                f"{path}: is of another seed, mission or version; allowed: another --out"
            )
        self.done |= DrawnFlight.by_number(lines)

    def _head(self) -> dict[str, Any]:
        return {"version": version(), "seed": self.seed, "mission": self.mission}

    def fly(
        self, flights: int, processes: int | None = None, until_s: float = float("inf")
    ) -> Iterator[DrawnFlight]:
        """Fly those that are missing of so many, each as it is done. At `until_s` of `wall_s` it
        ends; flights that are not done by then are lost. StartError: a process that flies died."""
        workers = processes or cores()
        with _pool(workers) as each:
            for first in range(0, flights, BATCH):
                numbers = range(first, min(first + BATCH, flights))
                missing = [number for number in numbers if number not in self.done]
                if not missing:
                    continue
                wanted = self.coverage(first)
                drawn = self.seed, wanted, self.mission
                for flight in each(partial(_flight, *drawn, self.lockstep), missing):
                    append_line(self.folder / FLIGHTS, flight.line())
                    self.done[flight.number] = flight
                    yield flight
                    if wall_s() >= until_s:
                        return

    def coverage(self, before: int | None = None) -> Coverage:
        """What the flights with a lower number have met; None: all."""
        flights = (f for n, f in self.done.items() if before is None or n < before)
        return Coverage(cell for flight in flights for cell in flight.cells)

    def found(self) -> dict[tuple[Invariant, str], list[DrawnFlight]]:
        """The flights that broke something, by what it was: its words without their figures."""
        kinds: dict[tuple[Invariant, str], list[DrawnFlight]] = {}
        for _, flight in sorted(self.done.items()):
            for invariant, text in {each.invariant: each.text for each in flight.broken}.items():
                kinds.setdefault((invariant, kind_of(text)), []).append(flight)
        return kinds

    def scenario(self, number: int) -> tuple[Scenario, LoadedMission]:
        """The scenario of a flight again."""
        return draw(self.seed, number, self.coverage(number - number % BATCH), self.mission)


def kind_of(text: str) -> str:
    """The last line of what broke, without its figures."""
    return re.sub(r"[-\d.]+", "#", text.strip().splitlines()[-1])


def _flight(
    seed: int, wanted: Coverage, of: dict[str, Any] | None, lockstep: int, number: int
) -> DrawnFlight:
    began_s = cpu_s()
    scenario, mission = draw(seed, number, wanted, of)
    twice, too = number % _TWICE == 0, lockstep > 0 and number % lockstep == 0
    flown, found = fly(scenario, mission, twice=twice, lockstep=too)
    if flown is None:
        return DrawnFlight(number, "raised", 0.0, cpu_s() - began_s, (), tuple(found))
    outcome, cells = str(flown.summary.outcome), tuple(cells_of(flown.met))
    took_s = round(cpu_s() - began_s, 3)
    return DrawnFlight(number, outcome, flown.end_s, took_s, cells, tuple(found))


@contextlib.contextmanager
def _pool(workers: int) -> Iterator[Callable[..., Iterator[DrawnFlight]]]:
    """A map over so many processes; over this one alone where there is one."""
    if workers == 1:
        yield map
        return
    context = multiprocessing.get_context("spawn")
    deaf_tracker()
    with deaf_children():
        others = set(multiprocessing.active_children())
        pool = context.Pool(workers, hears, (signal.SIGTERM,))
        mine = set(multiprocessing.active_children()) - others

    def each(work: Callable[[int], DrawnFlight], numbers: list[int]) -> Iterator[DrawnFlight]:
        flown = pool.imap_unordered(work, numbers)
        with contextlib.suppress(StopIteration):
            while True:
                try:
                    yield flown.next(timeout=_LOOKS_S)
                except multiprocessing.TimeoutError:
                    # a pool starts another one and waits for ever for what the first one flew
                    if not mine <= set(multiprocessing.active_children()):
                        raise StartError(
                            "a process that flies was killed, for want of memory perhaps; allowed:"
                            " fewer --processes, the same command goes on"
                        ) from None

    with pool:  # ends its workers by SIGTERM
        yield each


def write_found(folder: Path, name: str, text: str, scenario: str) -> tuple[Path, Path]:
    """The scenario's file and a test of it, in the campaign's folder."""
    where = folder / FOUND
    where.mkdir(exist_ok=True)
    path, test = where / f"{name}.yaml", where / f"test_{name.replace('-', '_')}.py"
    said = "".join(f"# {line}\n" for line in text.strip().splitlines()[-3:])
    write_whole(path, said + scenario)
    words = text.strip().splitlines()[-1].translate({ord(mark): "'" for mark in '"\\'})
    write_whole(test, _TEST.format(text=words, name=name))
    return path, test


_TEST: Final = '''"""{text}"""

from pathlib import Path

from swarm_ctl.fuzz.campaign import fly
from swarm_ctl.virtual.scenario import load_scenario


def test_it_is_mended() -> None:
    scenario = Path(__file__).with_name("{name}.yaml")
    assert fly(*load_scenario(scenario), twice=True)[1] == []
'''


_TRUTH: Final = "truth.jsonl"
_ENDS_WALL_S: Final = 900.0
"""Many times what eight agents take on a quiet machine."""
_PATIENCE_WALL_S: Final = 120.0
"""However busy the machine is, no process takes so long for a tick."""
_LINES: Final = 20


def unlike_as_processes(scenario: Scenario, mission: LoadedMission) -> str:
    """What became otherwise, or '', of a drawn scenario as processes in lockstep: they have to
    leave the truth of the virtual clock, byte for byte. '' also where something in the scenario
    can't happen to processes, and where a flight reaches its bound, which they do not have."""
    try:
        script = run_script(scenario, mission.plan)
    except InputError:
        return ""
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        virtual = fly_scenario(scenario, mission, folder / "virtual")
        if virtual.up:
            return ""
        options = RunOptions(
            show=Show.LOG,
            runs=folder / "runs",
            seed=scenario.seed,
            lockstep=Lockstep(patience_wall_s=_PATIENCE_WALL_S),
            script=script,
        )
        named = str(mission.source)
        said = _flown(folder, ProgramFlight(dumps(mission.file), named, options, report=False))
        if said is None:
            return f"processes had not ended after {_ENDS_WALL_S:g} s"
        runs = [*(folder / "runs").glob("*")]
        if len(runs) != 1 or not (runs[0] / _TRUTH).exists():
            return f"processes left no truth: {said.strip()[-500:]}"
        lines, flown = (
            (each / _TRUTH).read_text(encoding="utf-8").splitlines()
            for each in (folder / "virtual", runs[0])
        )
    pairs = itertools.zip_longest(lines, flown, fillvalue="none")
    other = next((line for known, line in pairs if known != line), "")
    return f"truth is another one, first by this line: {other[:200]}" if other else ""


def _flown(folder: Path, flight: ProgramFlight) -> str | None:
    """What its process said; None: it did not end, and was killed with its children."""
    running = FlightProcess(folder, flight, apart=True)
    try:
        return running.said(_LINES) if running.wait(_ENDS_WALL_S) else None
    finally:
        if not running.over:  # also where this process is ended meanwhile
            os.killpg(running.pid, signal.SIGKILL)
        running.kill()
