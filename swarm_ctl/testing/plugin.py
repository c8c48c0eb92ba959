"""The pytest plugin: one fixture, `swarm`.

pytest loads it in every run of its environment, so this module imports nothing of the project until
the fixture flies.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

import pytest

if TYPE_CHECKING:
    from swarm_ctl.testing.flight import Mission, SwarmFlight


class Fly(Protocol):
    """The fixture: a function that starts a flight."""

    def __call__(
        self, mission: Mission, *, speedup: float = 5.0, virtual: bool = False, seed: int = 1
    ) -> SwarmFlight:
        """Start `mission`; `virtual`: in this process on a virtual clock, else with real processes
        at `speedup`."""


@pytest.fixture
def swarm(tmp_path: Path) -> Iterator[Fly]:
    """Flies missions; a flight that is not over when the test ends is ended, with all its
    processes."""
    flights: list[SwarmFlight] = []

    def fly(
        mission: Mission, *, speedup: float = 5.0, virtual: bool = False, seed: int = 1
    ) -> SwarmFlight:
        from swarm_ctl.cli.shared.extras import require

        require("ground", "the fixture `swarm`")
        from swarm_ctl.testing.flight import loaded

        if virtual:
            from swarm_ctl.testing.virtual_flight import VirtualFlight

            flight: SwarmFlight = VirtualFlight(loaded(mission), seed)
        else:
            from swarm_ctl.testing.process_flight import ProcessFlight

            folder = tmp_path / f"flight-{len(flights) + 1}"
            flight = ProcessFlight(loaded(mission), folder, speedup, seed)
        flights.append(flight)
        return flight

    yield fly
    for flight in flights:
        flight.close()
