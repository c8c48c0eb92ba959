"""Terminals and pipes that are not read: they miss views; the station beacons, hears and records as
before."""

from __future__ import annotations

import fcntl
import itertools
import json
import os
import termios
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from swarm_ctl.core.model.messages import Event, Severity
from swarm_ctl.engine.clock import Clock
from swarm_ctl.engine.lockstep.seat import Seat
from swarm_ctl.engine.station.attachments import Attachments
from swarm_ctl.engine.station.ground_station import Station
from swarm_ctl.engine.station.printers import write as write_lines
from swarm_ctl.engine.station.recorders import run_mcap
from swarm_ctl.engine.station.screens import Screen, Show, present
from swarm_ctl.engine.station.station_loop import ControlPipe, RunControl, loop
from swarm_ctl.mesh import keys
from swarm_ctl.mesh.memory_transport import MemoryHub, MemoryTransport
from swarm_ctl.mesh.node import Node
from swarm_ctl.recording.run_recorder import RunRecorder
from swarm_ctl.station.picture.view import SwarmView
from tests.unit.report.run_folders import PLAN, manifest
from tests.unit.station.swarm import flying_model

ROOM = 4096


@pytest.fixture
def pipe(monkeypatch: pytest.MonkeyPatch) -> Iterator[tuple[int, int]]:
    """A pipe with little room, and little patience at the end."""
    monkeypatch.setattr("swarm_ctl.engine.station.screens._END_WALL_S", 0.3)
    read, write = os.pipe()
    fcntl.fcntl(write, fcntl.F_SETPIPE_SZ, ROOM)
    yield read, write
    os.close(read)
    os.close(write)


def views(count: int) -> list[SwarmView]:
    """Each with something new to say."""
    model, found = flying_model(PLAN, 30.0), []
    for k in range(count):
        model.fold(Event(1 + k % 6, 30.0 + k, Severity.INFO, f"event {k}: " + "x" * 60), 30.0 + k)
        found.append(model.view(30.0 + k))
    return found


@pytest.mark.parametrize("show", [Show.LOG, Show.JSON])
def test_an_output_that_is_not_read(show: Show, pipe: tuple[int, int]) -> None:
    """Showing never waits, and the end waits only a moment."""
    slowest = 0.0

    def watch(screen: Screen) -> None:
        nonlocal slowest
        for view in views(200):
            begun = time.monotonic()
            screen.show(view)
            screen.note("a note " * 10)
            slowest = max(slowest, time.monotonic() - begun)
            time.sleep(0.001)

    begun = time.monotonic()
    present(show, PLAN, None, watch, out=pipe[1])
    assert slowest < 0.2
    assert time.monotonic() - begun < 5.0


def test_a_terminal_that_is_stopped(monkeypatch: pytest.MonkeyPatch) -> None:
    """Ctrl-S: the log stands still, the station does not; it says what was skipped when it goes
    on."""
    monkeypatch.setattr("swarm_ctl.engine.station.screens._END_WALL_S", 0.3)
    ours, theirs = os.openpty()
    termios.tcsetwinsize(theirs, (24, 80))
    slowest, got = 0.0, b""

    def watch(screen: Screen) -> None:
        nonlocal slowest, got
        made = views(400)  # more than the terminal keeps
        for view in made[:-1]:
            begun = time.monotonic()
            screen.show(view)
            slowest = max(slowest, time.monotonic() - begun)
            time.sleep(0.002)
        screen.show(made[-1])
        until = time.monotonic() + 10
        while b"views were skipped" not in got and time.monotonic() < until:
            got += os.read(ours, ROOM)

    present(Show.LOG, PLAN, None, watch, out=theirs)
    os.close(ours)
    os.close(theirs)
    assert slowest < 0.2
    assert b"form hexagon" in got
    assert b"views were skipped" in got


def test_who_reads_again_is_told_what_was_missed(pipe: tuple[int, int]) -> None:
    """Whole lines, and how many views were skipped; nothing that happened meanwhile is left out of
    the log."""
    read, write = pipe
    got = b""

    def watch(screen: Screen) -> None:
        nonlocal got
        made = views(120)
        for view in made[:-1]:
            screen.show(view)
            time.sleep(0.001)
        screen.show(made[-1])
        while b"event 119" not in got:
            got += os.read(read, ROOM)

    present(Show.LOG, PLAN, None, watch, out=write)
    lines = got.decode().splitlines()
    assert any("station: this output was blocked" in line for line in lines)
    assert sum(": event " in line for line in lines) == 120


def test_json_lines_say_how_many_were_skipped_and_end_with_the_last(pipe: tuple[int, int]) -> None:
    """The first line comes at once, the last one at the end; in between one a second."""
    read, write = pipe
    fcntl.fcntl(write, fcntl.F_SETPIPE_SZ, 16 * ROOM)
    made = views(4)

    def watch(screen: Screen) -> None:
        for view in made:
            screen.show(view)
            time.sleep(0.02)

    present(Show.JSON, PLAN, None, watch, out=write)
    lines = [json.loads(line) for line in os.read(read, 10 * ROOM).decode().splitlines()]
    assert [line["time_s"] for line in lines] == [30.0, 33.0]
    assert lines[-1]["skipped"] == 0


def test_a_reader_that_left_ends_a_watching_station() -> None:
    """As in `swarm-ctl station --json | head -1`; nothing is raised."""
    reader, writer = os.pipe()
    os.close(reader)
    seen: list[bool] = []

    def watch(screen: Screen) -> None:
        until = time.monotonic() + 5
        while not screen.left and time.monotonic() < until:
            screen.show(made)
            time.sleep(0.01)
        seen.append(screen.left)

    made = views(1)[0]
    present(Show.JSON, PLAN, None, watch, out=writer)
    os.close(writer)
    assert seen == [True]


def test_text_goes_out_whole(pipe: tuple[int, int]) -> None:
    """Even where the descriptor does not block and takes only a part."""
    read, write = pipe
    os.set_blocking(write, False)
    text = "äöü" * 3000
    writer = threading.Thread(target=write_lines, args=(write, [text]))
    writer.start()
    got = b""
    while len(got) <= len(text.encode()):
        got += os.read(read, ROOM)
    writer.join(5)
    assert got.decode() == text + "\n"


def test_the_station_beacons_and_records_while_its_output_is_blocked(
    pipe: tuple[int, int], tmp_path: Path
) -> None:
    """What would otherwise happen: the agents miss the station, and land."""
    made = manifest(speedup=10.0, epoch_s=time.monotonic())
    clock = Clock(made.epoch_s, made.speedup)
    hub = MemoryHub(clock.now)
    agent = Node(MemoryTransport(hub), "swarm", 1)
    agent.listen(keys.BEACON)
    recorder = RunRecorder(tmp_path, run_mcap(tmp_path, made, "station"))
    node = Node(MemoryTransport(hub), "swarm", "station")
    station = Station(PLAN, node, clock, recorder)
    orders, control = os.pipe()

    def watch(screen: Screen) -> None:
        obeys = RunControl(ControlPipe(orders), Seat(clock), tmp_path)
        loop(station, screen, obeys, Attachments((), station))

    worker = threading.Thread(
        target=lambda: present(Show.LOG, PLAN, None, watch, out=pipe[1]), daemon=True
    )
    worker.start()
    heard: list[float] = []
    for k in range(50):
        for j in range(5):
            agent.send(
                keys.EVENT, Event(1, clock.now(), Severity.INFO, f"event {k}.{j}: " + "x" * 60)
            )
        heard += [received_s for _, received_s in agent.take(keys.BEACON)]
        time.sleep(0.02)
    os.write(control, b'{"finish": true}\n')
    worker.join(10)
    recorder.close()
    os.close(control)
    os.close(orders)
    assert (
        max(b - a for a, b in itertools.pairwise(heard)) < 0.5 * PLAN.policies.station_lost_after_s
    )
    assert heard[-1] > 8.0
    assert (tmp_path / "events.jsonl").read_text().count("event ") == 250
