"""The `swarm` fixture that users write tests with: the same interface on the virtual clock and with
real processes."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from swarm_ctl.testing.plugin import Fly
from swarm_ctl.testing.process_flight import ProcessFlight
from tests.scenarios.test_steps import TEXT

PAIR = TEXT + "  - hold: {duration_s: 20}\n  - land\n"


@pytest.mark.timeout(300)
@pytest.mark.parametrize("virtual", [True, False], ids=["virtual", "real"])
def test_a_test_as_a_user_writes_it(swarm: Fly, virtual: bool) -> None:
    flight = swarm(PAIR, virtual=virtual, speedup=4)
    flight.wait_step("hold")
    assert flight.command("hold").accepted
    assert flight.form("row").accepted
    refused = flight.move(9000, 0)
    assert "outside the geofence" in refused.reasons[1]
    flight.wait_s(5)
    flight.kill_agent(3)
    run = flight.finish()
    assert {run.outcomes[i] for i in (1, 2, 4)} == {"failed"}
    assert 3 not in run.outcomes
    assert run.closest_m > 2.5
    assert run.all_down
    assert "agent 3 has not been heard" in run.texts


@pytest.mark.timeout(120)
def test_nothing_is_left_behind_by_a_test_that_fails(swarm: Fly, tmp_path: Path) -> None:
    """`close` in the middle of a flight ends every process."""
    flight = swarm(PAIR, speedup=4)
    assert isinstance(flight, ProcessFlight)
    flight.wait_step("takeoff")
    flight.close()
    for pid in flight._pids.values():
        with pytest.raises(ProcessLookupError):
            os.kill(pid, 0)


def test_a_step_that_is_not_there(swarm: Fly) -> None:
    """A misspelt step is named with the ones there are."""
    with pytest.raises(ValueError, match="allowed: prepare, takeoff, form square"):
        swarm(PAIR, virtual=True).wait_step("form circle")
