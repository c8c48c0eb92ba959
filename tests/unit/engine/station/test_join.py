"""What a station that joins in flight has of the time before."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from swarm_ctl.core.model.messages import Ack, Command, Event, Severity
from swarm_ctl.engine.station import station_loop
from swarm_ctl.engine.station.join import Hint
from swarm_ctl.engine.station.mesh_clock import MeshClock
from swarm_ctl.recording.mcap_recorder import McapRecorder
from swarm_ctl.recording.run_recorder import RunRecorder
from swarm_ctl.rim import Rim
from swarm_ctl.runfolder.last_statuses import read_commands, read_events
from swarm_ctl.station.picture.journal import EntryKind, Journal
from tests.unit.station.pictures import PLAN
from tests.unit.station.swarm import flying_model


def test_the_run_folder_has_the_log_from_the_start(tmp_path: Path) -> None:
    """What the run's station recorded, and what this one hears again, is told once and in the order
    of its times."""
    events = [Event(i, 3.0 + i, Severity.INFO, f"word {i}") for i in (1, 2, 3)]
    command = Command("c", "hold", (), 5.5)
    recorder = RunRecorder(tmp_path, McapRecorder(tmp_path, 0, {}))
    for payload in (*events, command, Ack(1, "c", True, "")):
        recorder.take(payload, 9.0)
    recorder.close()

    notes: list[str] = []
    model, journal = flying_model(PLAN), Journal()
    model.fold(events[2], 30.0)
    for payload in (*read_events(tmp_path, notes), *read_commands(tmp_path, notes)):
        model.recall(payload)
    journal.update(model.view(30.0))
    told = [e for e in journal.entries if e.kind in (EntryKind.EVENT, EntryKind.COMMAND)]
    assert [entry.time_s for entry in told] == [4.0, 5.0, 5.5, 6.0]
    assert "hold: acknowledged by agent 1" in told[2].text
    assert notes == []


def test_without_a_run_folder_it_says_that_its_log_begins_now() -> None:
    """Once it hears an agent, and once; and that nothing is recorded, where nothing is."""
    clock = MeshClock(1.0)
    mesh: Any = SimpleNamespace(clock=clock, connect=["tcp/10.0.0.11:7447"], identity=None)
    hint, recording = Hint(mesh), Hint(mesh, records=True)
    assert hint() == ""
    clock.hear(1, 40.0)
    assert "nothing is recorded" in (told := hint())
    assert told.startswith(f"{recording()}; ")
    assert hint() == ""


class _Lines:
    """A screen of lines."""

    left = False

    def __init__(self) -> None:
        self.told: list[str] = []

    def show(self, _: object) -> None:
        pass

    def note(self, text: str) -> None:
        self.told.append(text)


class _Station:
    """As much of a station as a control asks."""

    shows = Rim("what is shown")

    @staticmethod
    def seen() -> None:
        return None


@pytest.mark.parametrize("stays", [False, True])
def test_a_guest_ends_with_the_swarm_where_no_one_closes_its_screen(
    stays: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Log lines ended with the run for the reader alone: the command went on for ever. It is told
    once, and a dashboard stays for its operator."""
    times = iter(range(100))
    monkeypatch.setattr(station_loop.wall, "wall_s", lambda: next(times))
    end, screen = "", _Lines()
    control = station_loop.GuestControl(over=lambda: end, stays=stays)
    assert not control.obey(_Station(), screen)  # type: ignore[arg-type]
    end = "runs/1-square has ended"
    assert [control.obey(_Station(), screen) for _ in range(3)] == [not stays] * 3  # type: ignore[arg-type]
    assert screen.told == [end]
