"""What only shows never ends what keeps safe: a plug raises at random in each part that shows, and
beacons and commands go on."""

from __future__ import annotations

import contextlib
import itertools
import os
import random
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from swarm_ctl.core.model.messages import Command
from swarm_ctl.engine.clock import Clock
from swarm_ctl.engine.lockstep.seat import Seat
from swarm_ctl.engine.station import attachments, screens
from swarm_ctl.engine.station.attachments import Attachments
from swarm_ctl.engine.station.ground_station import Station
from swarm_ctl.engine.station.recorders import run_mcap
from swarm_ctl.engine.station.screens import DashboardScreen, Screen, Show, present
from swarm_ctl.engine.station.station_loop import ControlPipe, RunControl, loop
from swarm_ctl.extension import Extension
from swarm_ctl.mesh import keys
from swarm_ctl.mesh.memory_transport import MemoryHub, MemoryTransport
from swarm_ctl.mesh.node import Node
from swarm_ctl.recording.run_recorder import RunRecorder
from swarm_ctl.rim import Rim
from swarm_ctl.runfolder.last_statuses import read_troubles
from tests.unit.report.run_folders import PLAN, manifest
from tests.unit.station.pictures import PICTURES
from tests.unit.station.swarm import state_of, status_of

ERRORS = (
    IndexError("tuple index out of range"),
    RecursionError("too deep"),
    MemoryError(),
    OSError(28, "No space left on device"),
)
PARTS = {
    "fold": "swarm_ctl.station.picture.model.Model.fold",
    "view": "swarm_ctl.station.picture.model.Model.view",
    "lines": "swarm_ctl.engine.station.printers.log_lines",
    "screen": "swarm_ctl.engine.station.screens.StationRelay.show",
    "record": "swarm_ctl.recording.run_recorder.RunRecorder.take",
    "troubles": "swarm_ctl.recording.run_recorder.RunRecorder.note",
    "encode": "swarm_ctl.recording.mcap_recorder.Recorder._record",
    "file": "swarm_ctl.recording.mcap_writer.McapWriter.write",
    "flush": "swarm_ctl.recording.mcap_writer.McapWriter.flush",
    "desk": "swarm_ctl.station.foxglove.desk.Desk.hear",
}


class Plug:
    """Raises in a part at random, by its own seed; calls the part else."""

    def __init__(self, part: Callable[..., Any], share: float) -> None:
        self._part, self._share, self._random = part, share, random.Random(7)
        self.raised = 0

    def __get__(self, owner: object, _: object = None) -> Callable[..., Any]:
        return lambda *args, **named: self(owner, *args, **named)

    def __call__(self, *args: Any, **named: Any) -> Any:
        if self._random.random() < self._share:
            self.raised += 1
            raise self._random.choice(ERRORS)
        return self._part(*args, **named)


def plugged(monkeypatch: pytest.MonkeyPatch, path: str, share: float) -> Plug:
    """The plug in the place of what `path` names."""
    owner, _, name = path.rpartition(".")
    found: Any = None
    module, rest = owner, list[str]()
    while found is None:
        try:
            found = __import__(module, fromlist=["_"])
        except ImportError:
            module, _, last = module.rpartition(".")
            rest.insert(0, last)
    for each in rest:
        found = getattr(found, each)
    plug = Plug(getattr(found, name), share)
    monkeypatch.setattr(found, name, plug)
    return plug


@pytest.mark.parametrize("share", [0.3, 1.0])
@pytest.mark.parametrize("part", [*PARTS, "extension"])
def test_an_error_in_what_shows_leaves_beacons_and_commands(
    part: str, share: float, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each part fails now and then, and always: ten more beacons, of which none comes later than 25
    turns of an agent after another (half a second on an idle machine), a landing that is obeyed at
    once, an orderly end, and the part is named in the record and to the operator."""
    silent = part in ("troubles", "lines", "screen")
    made = manifest(speedup=10.0, epoch_s=time.monotonic())
    clock = Clock(made.epoch_s, made.speedup)
    hub = MemoryHub(clock.now)
    agent = Node(MemoryTransport(hub), "swarm", 1)
    agent.listen(keys.BEACON, keys.COMMAND)
    take = Plug(lambda _: None, share)
    monkeypatch.setattr(attachments, "wanted", lambda word: (word, Extension, ""))
    monkeypatch.setattr(Extension, "take", lambda _, view: take(view))
    if part == "troubles":  # which needs a trouble
        share = 1.0
        plugged(monkeypatch, PARTS["fold"], share)
    plug = take if part == "extension" else plugged(monkeypatch, PARTS[part], share)
    recorder = RunRecorder(tmp_path, run_mcap(tmp_path, made, "station"))
    node = Node(MemoryTransport(hub), "swarm", "station")
    station = Station(PLAN, node, clock, recorder)
    orders, control = os.pipe()
    read, write = os.pipe()
    failed: list[BaseException] = []

    def watch(screen: Screen) -> None:
        with Attachments(["any"] * (part == "extension"), station) as attached:
            pipe = ControlPipe(orders)
            loop(station, screen, RunControl(pipe, Seat(clock), tmp_path), attached)

    def work() -> None:
        try:
            present(Show.LOG, PLAN, None, watch, out=write)
        except BaseException as error:
            failed.append(error)

    worker = threading.Thread(target=work, daemon=True)
    worker.start()
    turns, before, heard, commands, said = 0, 0, list[int](), list[Command](), b""
    os.set_blocking(read, False)
    until = time.monotonic() + 60.0
    while time.monotonic() < until:
        agent.send(keys.STATE, state_of(PLAN, 1, clock.now()))
        agent.send(keys.STATUS, status_of(PLAN, 1, clock.now()))
        turns += 1
        heard += [turns for _ in agent.take(keys.BEACON)]
        before = before if plug.raised else len(heard)
        with contextlib.suppress(BlockingIOError):
            said += os.read(read, 65536)
        if len(heard) >= before + 10 and (silent or b"the flight goes on" in said):
            break
        time.sleep(0.02)
    os.write(control, b'{"command": "land"}\n')
    until = time.monotonic() + 5.0
    while not commands and time.monotonic() < until:
        commands += [command for command, _ in agent.take(keys.COMMAND)]
        time.sleep(0.02)
    os.write(control, b'{"finish": true}\n')
    worker.join(10.0)
    assert not worker.is_alive()
    recorder.close()
    os.close(write)
    os.set_blocking(read, True)
    while data := os.read(read, 65536):
        said += data
    for each in (orders, control, read):
        os.close(each)
    assert failed == []
    assert plug.raised > 0
    assert len(heard) >= before + 10
    assert max(b - a for a, b in itertools.pairwise(heard)) < 25
    assert [command.kind for command in commands[:1]] == ["land"]
    assert silent or b"the flight goes on" in said
    if part not in ("troubles", "lines"):
        assert any(word in "".join(read_troubles(tmp_path)) for word in ("failed at", "stopped at"))


def test_a_rim_tells_once_that_it_failed_and_once_that_it_is_off() -> None:
    """It counts each error; what comes well in between begins the row anew."""
    rim, calls = Rim("the alarms", most=2), list[int]()

    def part(k: int) -> int:
        calls.append(k)
        if k != 1:
            raise IndexError("out of range\nsecond line")
        return k

    assert [rim.run(part, k) for k in range(6)] == [None, 1, None, None, None, None]
    assert calls == [0, 1, 2, 3]
    assert rim.count == 3
    assert [(trouble.off, str(trouble)[:32]) for trouble in rim.troubles()] == [
        (False, "the alarms failed: IndexError: o"),
        (True, "the alarms has stopped: IndexErr"),
    ]
    assert rim.troubles() == []


def test_a_dashboard_that_ends_by_an_error_gives_way_to_log_lines(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The station goes on with its loop, as one that has not been left."""

    class Broken:
        return_code, failure = 1, "IndexError: tuple index out of range"

        def run(self) -> None:
            pass

        def leave(self) -> None:
            pass

    def init(self: DashboardScreen, *_: object) -> None:
        self.app = Broken()  # type: ignore[assignment]
        self._left, self._lines, self._out = False, None, write

    monkeypatch.setattr(DashboardScreen, "__init__", init)
    monkeypatch.setattr(screens, "possible", lambda show: show)
    read, write = os.pipe()
    seen: list[bool] = []

    def watch(screen: Screen) -> None:
        until = time.monotonic() + 10.0
        while screen._lines is None and time.monotonic() < until:  # type: ignore[attr-defined]
            time.sleep(0.01)
        screen.show(PICTURES["lost"]())
        screen.note("a word")
        seen.append(screen.left)

    present(Show.DASHBOARD, PLAN, None, watch, out=write)
    os.close(write)
    with os.fdopen(read, "rb") as file:
        said = file.read().decode()
    assert seen == [False]
    assert "the dashboard ended by an error; the station goes on" in said
    assert "IndexError: tuple index out of range" in said
    assert "a word" in said


def test_log_lines_in_the_place_of_a_dashboard_end_with_their_terminal() -> None:
    """Also where there is nothing to say: a station that watches would stay for ever."""
    ours, theirs = os.openpty()
    read, write = os.pipe()
    assert not screens._gone(theirs)
    assert not screens._gone(write)
    os.close(ours)
    os.close(read)
    assert screens._gone(theirs)
    assert screens._gone(write)
    os.close(theirs)
    os.close(write)
