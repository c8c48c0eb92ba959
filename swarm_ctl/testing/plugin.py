"""The pytest plugin: one fixture, `swarm`, and what a failing test shows of its flights.

pytest loads it in every run of its environment, so this module imports nothing of the project until
the fixture flies.
"""

from __future__ import annotations

from collections.abc import Generator, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Protocol

import pytest

if TYPE_CHECKING:
    from swarm_ctl.api.flight import Mission, SwarmFlight


_FLIGHTS: Final = pytest.StashKey[list["SwarmFlight"]]()
"""The flights of a test."""


class Fly(Protocol):
    """The fixture: a function that starts a flight."""

    def __call__(
        self,
        mission: Mission,
        *,
        speedup: float | None = None,
        virtual: bool = False,
        seed: int | None = None,
    ) -> SwarmFlight:
        """Start a flight.

        Args:
            mission: a file, also one beside the test's; its text, of more than one line; or what
                is built in Python (`MissionFile`, `LoadedMission`); or a scenario, in each of
                these forms.
            speedup: with real processes, so many mission seconds per second of the wall clock;
                None: in lockstep, which no busy machine changes.
            virtual: in this process on a virtual clock: as fast as it computes, and the same in
                every run; else with real processes.
            seed: of all random numbers (wind, GPS noise, losses). None: 1, or the scenario's own.

        Raises:
            MissionError: the mission has mistakes.
        """


@pytest.fixture
def swarm(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Fly]:
    """A function that starts a flight: `swarm(mission, speedup=None, virtual=False, seed=None)`.

    Flights have `wait_step`, `wait_s`, `command`, `form`, `move`, `kill_agent`, `finish` and more
    (the page "Tests of your own missions"). One that is not over when the test ends is ended, with
    all its processes.
    """
    flights: list[SwarmFlight] = request.node.stash.setdefault(_FLIGHTS, [])

    def fly(
        mission: Mission,
        *,
        speedup: float | None = None,
        virtual: bool = False,
        seed: int | None = None,
    ) -> SwarmFlight:
        __tracebackhide__ = True
        from swarm_ctl.installed import require

        require("ground", "the fixture `swarm`")
        from swarm_ctl.api.flight import loaded
        from swarm_ctl.errors import MissionError

        try:
            checked, scenario = loaded(mission, request.path.parent, seed)
        except MissionError as error:
            raise MissionError(error.problems) from None  # without the way through the parser
        if virtual:
            from swarm_ctl.api.virtual_flight import VirtualFlight

            flight: SwarmFlight = VirtualFlight(checked, seed or 1, scenario)
        else:
            from swarm_ctl.api.process_flight import ProcessFlight

            folder = tmp_path / f"flight-{len(flights) + 1}"
            flight = ProcessFlight(checked, folder, speedup, seed or 1, scenario=scenario)
        flights.append(flight)
        return flight

    yield fly
    for flight in flights:
        flight.close()


@pytest.hookimpl(hookwrapper=True)
def pytest_runtest_makereport(
    item: pytest.Item, call: pytest.CallInfo[None]
) -> Generator[None, Any, None]:
    """A failing test's report has a section for each flight: how far it was, and, once it was ended
    for that, where its report lies. Under `--pdb` it flies on."""
    report: pytest.TestReport = (yield).get_result()
    flights = item.stash.get(_FLIGHTS, [])
    if call.when != "call" or not report.failed or not flights:
        return
    from swarm_ctl.testing.account import account

    for number, flight in enumerate(flights, start=1):
        told = account(flight)
        if not item.config.getoption("usepdb"):
            flight.close()
        section = f"{told}\n\n{flight.where}"
        report.sections.append((f"flight {number}: {flight.plan.name}", section))
