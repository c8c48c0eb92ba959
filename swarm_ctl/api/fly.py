"""`fly`: starts a mission for a program, and lands it when the program is through with it."""

from __future__ import annotations

import asyncio
import tempfile
from pathlib import Path
from types import TracebackType
from typing import Final, Literal

from swarm_ctl.api.flight import FlightError, FlightResult, Mission, SwarmFlight, loaded
from swarm_ctl.api.process_flight import ProcessFlight
from swarm_ctl.api.swarm import AsyncSwarm, OrderError, Swarm
from swarm_ctl.api.virtual_flight import VirtualFlight
from swarm_ctl.errors import InputError
from swarm_ctl.mission.compile.loader import ALLOWED, LoadedMission, with_vehicles
from swarm_ctl.mission.ready import named
from swarm_ctl.virtual.scenario import MOST_SEED, Scenario

__all__ = ["AsyncSwarm", "FlightError", "FlightResult", "Flying", "OrderError", "Swarm", "fly"]
VIRTUAL: Final = "virtual"


class Flying:
    """What `fly` returns: `with` gives a `Swarm`, `async with` an `AsyncSwarm`. A swarm that still
    flies at the end of the block is landed, whatever has ended the block."""

    def __init__(
        self,
        mission: LoadedMission,
        scenario: Scenario | None,
        speedup: float | None,
        vehicles: str | None,
        seed: int,
        runs: Path,
    ) -> None:
        self._mission, self._scenario = mission, scenario
        self._speedup, self._vehicles = speedup, vehicles
        self._seed, self._runs = seed, runs
        self._flight: SwarmFlight | None = None
        self._told: tempfile.TemporaryDirectory[str] | None = None
        """What the flight's process is told, and its log, while it flies."""
        self._async: AsyncSwarm | None = None

    def __enter__(self) -> Swarm:
        self._flight = self._start()
        return Swarm(self._flight)

    def __exit__(
        self, kind: type[BaseException] | None, _: BaseException | None, __: TracebackType | None
    ) -> None:
        flight, self._flight = self._flight, None
        if flight is not None:
            try:
                flight.land()
            finally:
                flight.close()
                self._forget()

    async def __aenter__(self) -> AsyncSwarm:
        swarm = await asyncio.to_thread(self.__enter__)
        self._async = AsyncSwarm(swarm)
        return self._async

    async def __aexit__(
        self, kind: type[BaseException] | None, _: BaseException | None, __: TracebackType | None
    ) -> None:
        if self._async is not None:
            self._async.leave()
        await asyncio.shield(asyncio.to_thread(self.__exit__, None, None, None))

    def _start(self) -> SwarmFlight:
        if self._vehicles == VIRTUAL:
            return VirtualFlight(self._mission, self._seed, self._scenario)
        self._runs.mkdir(parents=True, exist_ok=True)
        # beside the run folders, which have what is looked for: this one has the mission's file
        name = f".{self._mission.plan.name}-"
        self._told = tempfile.TemporaryDirectory(prefix=name, dir=self._runs)
        try:
            return ProcessFlight(
                self._mission,
                Path(self._told.name),
                self._speedup,
                self._seed,
                vehicles=self._vehicles,
                apart=True,
                runs=self._runs,
                scenario=self._scenario,
            )
        except BaseException:
            self._forget()
            raise

    def _forget(self) -> None:
        if self._told is not None:
            self._told.cleanup()
            self._told = None


def fly(
    mission: Mission,
    *,
    speedup: float | Literal["max"] = 1.0,
    vehicles: str | None = None,
    seed: int | None = None,
    runs: Path | str = "runs",
) -> Flying:
    """A mission to fly, in a `with` or an `async with`.

    Args:
        mission: a file, the name of a ready mission (`hexagon`), a mission's text (of more than one
            line), or what is built in Python (`MissionFile`, `LoadedMission`); or a scenario, in
            lockstep or on the virtual clock.
        speedup: mission seconds per second of the wall clock; `max`: in lockstep, where mission
            time waits for every process, and for this program.
        vehicles: where the fleet names no endpoint: `simulated`, `arducopter` or `px4` (as
            `swarm-ctl run --vehicles`), or `virtual`: agents and simulated vehicles in this process
            on a virtual clock. None: the fleet's.
        seed: of all random numbers. None: 1, or the scenario's own.
        runs: where the run's folder is made, with recording and report.

    Raises:
        MissionError: the mission has mistakes.
        InputError: what is given is out of its bounds.
        FlightError: at the beginning of the block, where the run does not start.
    """
    if isinstance(mission, str) and "\n" not in mission:
        mission = Path(mission)
    if isinstance(mission, Path):
        mission = named(mission)
    factor = None if speedup == "max" else _factor(speedup)
    if seed is not None and not (isinstance(seed, int) and 0 <= seed <= MOST_SEED):
        raise InputError(f"seed={seed!r}; allowed: a whole number from 0 to {MOST_SEED}")
    checked, scenario = loaded(mission, Path(), seed)
    if scenario is not None and vehicles is None and factor is not None:
        raise InputError(
            f"speedup={speedup}: a scenario flies in lockstep; allowed: speedup='max', or"
            " vehicles='virtual'"
        )
    if vehicles not in (None, VIRTUAL):
        _check_vehicles(vehicles, checked)
    return Flying(checked, scenario, factor, vehicles, 1 if seed is None else seed, Path(runs))


def _check_vehicles(vehicles: object, mission: LoadedMission) -> None:
    if not isinstance(vehicles, str):
        raise InputError(f"vehicles={vehicles!r}; allowed: {VIRTUAL}, {ALLOWED}")
    try:
        with_vehicles(mission.file, vehicles)
    except InputError as error:
        why = str(error).removeprefix(f"--vehicles {vehicles}: ")
        raise InputError(f"vehicles={vehicles!r}: {why}; or {VIRTUAL}") from None


def _factor(speedup: object) -> float:
    if isinstance(speedup, int | float) and 0.1 <= speedup <= 100.0:
        return float(speedup)
    raise InputError(f"speedup={speedup!r}; allowed: 0.1 to 100, or 'max'")
