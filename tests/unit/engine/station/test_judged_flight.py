"""When the record of a judged flight begins: on a clock that moves no more."""

from __future__ import annotations

import json
from contextlib import closing
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from swarm_ctl.core.model.messages import Outcome
from swarm_ctl.engine.station import judged_flight
from swarm_ctl.engine.station.judged_flight import _SETTLES_WALL_S, Accounts, _Flight
from swarm_ctl.engine.station.mesh_clock import MeshClock
from swarm_ctl.recording.mcap_recorder import McapRecorder
from swarm_ctl.rim import Rim
from swarm_ctl.runfolder.last_statuses import FINAL
from tests.unit.report.run_folders import manifest
from tests.unit.station.swarm import hexagon_plan, status_of

PLAN = hexagon_plan()


class Begins:
    """A flight of two agents, and whether its record has begun."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.now, self.begun = 100.0, False
        monkeypatch.setattr(judged_flight.wall, "wall_s", lambda: self.now)
        monkeypatch.setattr(_Flight, "_record", self._record)
        swarm: Any = SimpleNamespace(clock=SimpleNamespace(heard=True))
        quiet: Any = SimpleNamespace(count=0, again=False)
        monkeypatch.setattr(judged_flight, "Hint", lambda _: str)
        self._flight = _Flight(swarm, Path(), quiet, lambda: None, [])

    def _record(self, *_: object) -> None:
        self.begun = True

    def with_heard(self, *heard: bool) -> bool:
        """A turn in which these agents have told a status; whether the record has begun."""
        running = SimpleNamespace(outcome=Outcome.RUNNING)
        agents = [
            SimpleNamespace(in_plan=True, status=running if told else None, silence_s=0.0)
            for told in heard
        ]
        station: Any = SimpleNamespace(
            seen=lambda: SimpleNamespace(agents=agents), shows=Rim("what is shown")
        )
        screen: Any = SimpleNamespace(left=False)
        self._flight.obey(station, screen)
        return self.begun


def test_it_begins_when_all_agents_are_heard(monkeypatch: pytest.MonkeyPatch) -> None:
    """The clock jumps to that of an agent which is ahead of those heard before it: what was
    recorded by then would stand on another clock."""
    flight = Begins(monkeypatch)
    assert not flight.with_heard(True, False)
    assert flight.with_heard(True, True)


def test_it_begins_without_an_agent_that_does_not_come(monkeypatch: pytest.MonkeyPatch) -> None:
    flight = Begins(monkeypatch)
    assert not flight.with_heard(True, False)
    flight.now += _SETTLES_WALL_S + 0.1
    assert flight.with_heard(True, False)


def test_the_truth_stands_on_the_clock_of_the_end(monkeypatch: pytest.MonkeyPatch) -> None:
    """The clock went over to an agent's that is 21 s ahead when the record had begun: by its first
    epoch the truth seemed to have ended 21 s ago."""
    given: list[Any] = []
    monkeypatch.setattr(judged_flight, "take_truth", lambda *words: given.append(words))
    monkeypatch.setattr(judged_flight.wall, "wall_s", lambda: 100.0)
    swarm: Any = SimpleNamespace(clock=SimpleNamespace(now=lambda: 51.0, speedup=3.0))
    quiet: Any = SimpleNamespace(count=0, again=False)
    flight = _Flight(swarm, Path(), quiet, lambda: None, [], Path("truth.jsonl"))
    flight.folder, flight._manifest = Path(), manifest(epoch_s=90.0, speedup=3.0)
    flight._take_truth(SimpleNamespace())  # type: ignore[arg-type]
    ((_, _, taken, now_s),) = given
    assert (taken.epoch_s, now_s) == (83.0, 51.0)


def test_accounts_stand_on_the_clock_of_the_end(tmp_path: Path) -> None:
    """The mission's clock leaps once an agent is heard that is ahead of all; what those before it
    have told moves along, as the truth does."""
    time = SimpleNamespace(s=0.0)
    clock = MeshClock()
    clock._own = SimpleNamespace(now=lambda: time.s)  # type: ignore[assignment]
    with closing(Accounts(tmp_path, McapRecorder(tmp_path, 0, {}), clock)) as accounts:
        for k in range(40):
            time.s = 0.1 * k
            told = {1: time.s + 5.0} | ({2: time.s + 26.0} if k > 20 else {})
            for agent, told_s in told.items():
                outcome = Outcome.COMPLETED if k == 39 else Outcome.RUNNING
                status = status_of(PLAN, agent, told_s, outcome=outcome)
                clock.hear(told_s)
                accounts.take(status, clock.now())
        accounts.write_accounts()
        ends = [json.loads((tmp_path / FINAL / f"{i}.json").read_text())["time_s"] for i in (1, 2)]
    assert ends == pytest.approx([clock.now()] * 2, abs=0.1)
