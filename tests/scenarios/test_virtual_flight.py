"""What a test's author gets of a flight on the virtual clock: the verdict of `run`, orders in
bursts, an observer, a bound, and what befalls a scenario."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
import yaml

from swarm_ctl.api.flight import FlightError, FlightResult, loaded
from swarm_ctl.api.process_flight import ProcessFlight
from swarm_ctl.api.virtual_flight import VirtualFlight
from swarm_ctl.commands.parse import parse
from swarm_ctl.errors import InputError, MissionError
from swarm_ctl.testing.plugin import Fly
from swarm_ctl.virtual import virtual_swarm
from swarm_ctl.virtual.scenario import scenario_of
from tests.system.running import HEXAGON, LOW
from tests.unit.cli.test_validate import CHANGED

SCENARIO = f"""
version: 1
mission: {LOW}
seed: 3
happens:
  - {{at_s: 12, vehicle: {{agents: [1], set: {{SIM_MOTOR_STOP: 1}}}}}}
"""


def test_a_virtual_flight_is_judged(swarm: Fly) -> None:
    """A vehicle that falls is a finding, as in a run; the truth is there; the same seed has the
    same digest, another one another."""

    def flown(seed: int | None) -> FlightResult:
        return swarm(SCENARIO, virtual=True, seed=seed).finish()

    run = flown(None)
    assert run.summary is not None
    assert run.truth is not None
    assert run.summary.outcome == "failed"
    assert "fell" in " ".join((run.summary.reason, *map(str, run.summary.findings)))
    assert len(run.truth.time_s) > 100
    assert run.digest == flown(3).digest != flown(4).digest


def test_side_by_side_is_as_one_after_the_other(
    swarm: Fly, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In lockstep all agents go through a tick part by part; each message is the same as if one
    agent ended its tick before the next one began."""
    beside = swarm(SCENARIO, virtual=True).finish().digest

    def in_turn(turns: Sequence[Iterator[None]]) -> None:
        for turn in turns:
            list(turn)

    monkeypatch.setattr(virtual_swarm, "_side_by_side", in_turn)
    assert swarm(SCENARIO, virtual=True).finish().digest == beside


def test_orders_in_one_tick(swarm: Fly) -> None:
    """None of them waits: all go out before the next tick, and are answered later."""
    flight = swarm(LOW, virtual=True)
    flight.wait_step("form hexagon")
    flight.wait_s(0.5)
    sent = [flight.give(parse(line, flight.plan)) for line in ("hold @1", "hold @2", "hold @3")]
    assert [order.acks for order in sent] == [{}, {}, {}]
    began = flight.now
    flight.wait_s(1.0)
    assert all(order.accepted for order in sent)
    assert [order.command.time_s for order in sent] == [began] * 3


def test_an_observer_sees_each_tick_and_a_flight_has_a_bound(swarm: Fly) -> None:
    flight = swarm(LOW, virtual=True)
    times: list[float] = []
    flight.watch(lambda seen: times.append(seen.now))
    with pytest.raises(FlightError, match="did not end within 5 s: agents 1-3 did not"):
        flight.finish(5.0)
    assert flight.up == (1, 2, 3)
    flight.finish()
    assert flight.up == ()
    steps = [b - a for a, b in itertools.pairwise(times)]
    assert max(steps) == pytest.approx(flight.plan.tick_s)
    assert times[-1] < flight.bound_s < 3600


def test_what_run_refuses_is_refused(swarm: Fly, tmp_path: Path) -> None:
    """A forecast under r_in; a scenario's real time, and what processes can't do."""
    text = HEXAGON.read_text().replace("slots: nearest", "slots: fixed")
    for old, new in CHANGED:
        text = text.replace(old, new)
    with pytest.raises(MissionError, match="are forecast"):
        loaded(text, tmp_path)
    with pytest.raises(InputError, match="a scenario flies in lockstep; allowed: no speedup"):
        swarm(SCENARIO, speedup=5)
    again = SCENARIO + "  - {at_s: 13, restart: [1]}\n"
    with pytest.raises(InputError, match="allowed here: all but restart"):
        swarm(again)


@pytest.mark.parametrize(
    ("happens", "refused"),
    [
        ("{at_s: 5.01, order: next}", [5.01]),
        ("{at_s: 5.01, order: next, may_be_refused: true}", []),
        ("{at_s: 39.5, order: next}", []),
        ("{at_s: 12, order: expel @3}, {at_s: 13, order: hold}, {at_s: 14, order: hold @3}", [14]),
    ],
)
def test_an_order_that_the_swarm_refuses_fails_its_scenario(
    happens: str, refused: list[float], swarm: Fly
) -> None:
    """A CI that flies it has to learn of it, unless the scenario says that it may be, or all have
    ended, as in a run, or only those refuse an order to all that it has expelled; it is told at the
    time that the scenario has."""
    text = f"version: 1\nmission: {LOW}\nhappens: [{happens}]\n"
    summary = swarm(text, virtual=True).finish().summary
    assert [order.time_s for order in summary.refused_orders] == refused
    assert (summary.outcome == "failed") == bool(refused)
    assert all(f"` at {at_s:g} s: agent" in summary.reason for at_s in refused)


@pytest.mark.parametrize(
    ("happens", "told"),
    [
        ("kill: [1], may_be_refused: true", "kill with may_be_refused; allowed: beside an order"),
        ("kill: [1], order: hold", "order and kill at 13 s; allowed: exactly one of order, kill, "),
        ("stop: [1]", "a stop without for_s; allowed: for_s, the seconds until they go on"),
        ("order: hold @9", "no agent 9 in this mission; allowed: 1, 2, 3"),
    ],
)
def test_a_mistake_in_what_happens_is_told_in_its_own_words(happens: str, told: str) -> None:
    """With its line, and once with what is allowed."""
    with pytest.raises(MissionError) as refused:
        scenario_of(SCENARIO + f"  - {{at_s: 13, {happens}}}\n")
    assert f":7: happens#2: {told}" in str(refused.value)
    assert str(refused.value).count("allowed:") == 1


@pytest.mark.long
@pytest.mark.lockstep
@pytest.mark.timeout(120)
def test_a_scenario_that_a_test_flies_twice(tmp_path: Path) -> None:
    """The mission stands in the scenario: a test's processes leave the virtual truth, as those of
    `run` do (`test_as_processes.py`)."""
    inline = yaml.safe_load(SCENARIO) | {"mission": yaml.safe_load(LOW.read_text())}
    scenario, mission = scenario_of(yaml.safe_dump(inline))
    one = VirtualFlight(mission, scenario=scenario).finish()
    with closing(
        ProcessFlight(mission, tmp_path, None, scenario=scenario, report=False, tlog=False)
    ) as flight:
        other = flight.finish()
    assert one.truth is not None
    assert other.truth is not None
    assert len(one.truth.position_ned_m) > 100
    assert np.array_equal(one.truth.position_ned_m, other.truth.position_ned_m)
    assert one.outcomes == other.outcomes
