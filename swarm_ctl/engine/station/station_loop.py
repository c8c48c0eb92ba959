"""A ground station's loop: orders from the screen, messages from the mesh, views to the screen,
until its control ends it."""

from __future__ import annotations

import contextlib
import json
import math
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final, Protocol

from swarm_ctl.commands.parse import Order
from swarm_ctl.core.swarm.hearing import hears_all
from swarm_ctl.engine import clock as wall
from swarm_ctl.engine.lockstep.seat import Seat, die
from swarm_ctl.engine.script import StationScript
from swarm_ctl.engine.station.attachments import Attachments
from swarm_ctl.engine.station.ground_station import Station
from swarm_ctl.engine.station.screens import Screen
from swarm_ctl.engine.station.scripted_operator import ScriptedOperator
from swarm_ctl.errors import InputError
from swarm_ctl.rim import Rim
from swarm_ctl.runfolder.refused_orders import write_refused
from swarm_ctl.station.picture.view import AgentView, SwarmView

_LOOP_WALL_S: Final = 0.05
_SHOW_WALL_S: Final = 0.25
_SHOW_MANY_WALL_S: Final = 0.5
"""Of a large swarm: a picture of 100 agents takes up to 60 ms of a core."""
_LOOK_WALL_S: Final = 1.0
"""Between two looks whether the swarm of a guest has ended."""
_BLIND_WALL_S: Final = 5.0
_BLIND: Final = "there is no picture of the swarm now: what is shown is old; commands go out"
_SILENT_S: Final = 15.0
"""Mission time after which an orphaned station takes a silent agent's process for ended: longer
than any pause of a live one, which gives its vehicle up after 10 s."""
_TRUTH_S: Final = 100.0
"""How long an orphaned station waits for the simulator, which waits 90 s for the last vehicle to
stand."""


class Control(Protocol):
    """What a station obeys beside its operator."""

    def obey(self, station: Station, screen: Screen) -> bool:
        """Once a turn; True ends the loop."""

    def begin(self, wall_seconds: float) -> bool:
        """Wait, at most so long; whether the station may take its turn now."""
        wall.pause(wall_seconds)
        return True

    def end(self, station: Station, screen: Screen) -> None:
        """The turn is over."""
        del station, screen


def loop(station: Station, screen: Screen, control: Control, attached: Attachments) -> None:
    """Run the station until its control ends it; `attached` gets each view."""
    blind_due = 0.0
    show_due, every_s = 0.0, _SHOW_WALL_S if hears_all(station.plan) else _SHOW_MANY_WALL_S
    while not control.obey(station, screen):
        for order in screen.orders():
            give(order, station, screen)
        attached.turn()
        if control.begin(_LOOP_WALL_S):
            for text in station.turn():
                screen.note(text)
            control.end(station, screen)
        if wall.wall_s() >= show_due:
            show_due = wall.wall_s() + every_s
            view = station.seen()
            if view is not None:
                station.shows.run(screen.show, view)
                attached.show(view)
            elif wall.wall_s() >= blind_due:
                blind_due = wall.wall_s() + _BLIND_WALL_S
                screen.note(_BLIND)


def give(order: Order, station: Station, screen: Screen) -> None:
    """Send an order; why not, where it can't be sent, goes to the screen."""
    try:
        station.order(order)
    except InputError as error:
        screen.note(str(error))


class GuestControl(Control):
    """Of a station that has joined a swarm: it ends with its screen; log lines and JSON, which no
    one closes, with the swarm."""

    def __init__(
        self, hint: Callable[[], str] = str, over: Callable[[], str] = str, *, stays: bool = True
    ) -> None:
        self._hint = hint
        """What to tell the operator now; '' for nothing."""
        self._over = over
        """That the swarm has ended, for the operator; '' while it has not, or may not have."""
        self._stays = stays
        """It goes on then, for an operator who looks at what is left."""
        self._look_wall_s = 0.0
        self._told = False

    def obey(self, station: Station, screen: Screen) -> bool:
        if text := station.shows.run(self._hint):
            screen.note(text)
        return screen.left or (self._ended(station, screen) and not self._stays)

    def _ended(self, station: Station, screen: Screen) -> bool:
        if not self._told and wall.wall_s() >= self._look_wall_s:
            self._look_wall_s = wall.wall_s() + _LOOK_WALL_S
            if text := station.shows.run(self._over):
                self._told = True
                if (view := station.seen()) is not None:
                    station.shows.run(screen.show, view)
                screen.note(text)
        return self._told


class RunControl(Control):
    """Of a run's own station: `run` ends it. When `run` is killed, the station ends after the
    agents and the simulator. In a scenario, its operator has his turn at the end of each tick."""

    def __init__(
        self, pipe: ControlPipe, seat: Seat, folder: Path, script: StationScript | None = None
    ) -> None:
        self._pipe = pipe
        self._seat = seat
        self._folder = folder
        self._truth = folder / "truth.jsonl"
        self._accounts = folder / "agents"
        self._script = script
        self._operator: ScriptedOperator | None = None
        self._broken_off = False
        """`run` lands the swarm: the scenario's orders are given no more."""
        self._look_wall_s = 0.0
        self._agents_ended_s: float | None = None

    def obey(self, station: Station, screen: Screen) -> bool:
        for message in self._pipe.poll():
            if message.get("finish"):
                self._seat.leave()
                station.turn()
                if self._operator is not None:
                    self._operator.end()
                    for text in station.troubles():
                        screen.note(text)
                if (view := station.seen()) is not None:
                    station.shows.run(screen.show, view)
                return True
            self._pass_on(message, station, screen)
        if not self._pipe.closed:
            return False
        screen.close()
        if wall.wall_s() < self._look_wall_s:
            return False
        self._look_wall_s = wall.wall_s() + _SHOW_WALL_S
        return self._all_ended(station.seen(), len(station.plan.agents))

    def begin(self, wall_seconds: float) -> bool:
        return self._seat.begin(wall_seconds)

    def end(self, station: Station, screen: Screen) -> None:
        if self._script is not None:
            if self._operator is None:
                rim = Rim("the record of refused orders")
                station.tell_of([rim])
                self._operator = ScriptedOperator(
                    self._script,
                    station,
                    screen.note,
                    lambda refused: rim.run(write_refused, self._folder, refused),
                )
            if self._operator.turn(self._seat.clock.now(), orders=not self._broken_off):
                die(self._seat)
        self._seat.end()

    def _pass_on(self, message: dict[str, Any], station: Station, screen: Screen) -> None:
        if isinstance(message.get("command"), str):
            self._broken_off = True
            give(Order(message["command"]), station, screen)
        if isinstance(message.get("note"), str):
            screen.note(message["note"])

    def _all_ended(self, view: SwarmView | None, agents: int) -> bool:
        """All agents have ended, and the simulator has closed its truth file. Without a picture,
        by their accounts alone."""
        now = self._seat.clock.now()
        if view is None:
            if len(list(self._accounts.glob("*.json"))) < agents:
                return False
        elif not all(self._has_ended(agent, now) for agent in view.agents if agent.in_plan):
            return False
        if self._agents_ended_s is None:
            self._agents_ended_s = now
        late = now - self._agents_ended_s > _TRUTH_S
        return late or not self._truth.exists() or _is_closed(self._truth)

    def _has_ended(self, agent: AgentView, now: float) -> bool:
        """It has written its account, or is silent for so long that it will not any more."""
        heard_s = agent.status.time_s if agent.status else -math.inf
        return (self._accounts / f"{agent.id}.json").exists() or now - heard_s > _SILENT_S


def _is_closed(truth: Path) -> bool:
    """The file has the simulator's last line."""
    with truth.open("rb") as file:
        file.seek(max(0, file.seek(0, os.SEEK_END) - 200))
        return b'"type":"end"' in file.read().replace(b" ", b"")


class ControlPipe:
    """What `run` and its station tell each other, JSON lines: the reading end of a pipe, polled;
    never blocks. The pipe's end is the other one's end."""

    def __init__(self, descriptor: int) -> None:
        self._descriptor = descriptor
        self._rest = b""
        self.closed = False
        os.set_blocking(descriptor, False)

    def poll(self) -> list[dict[str, Any]]:
        """All whole messages since the last call; what is no JSON object is ignored. Sets `closed`
        at the end."""
        while not self.closed:
            try:
                data = os.read(self._descriptor, 65536)
            except BlockingIOError:
                break
            self._rest += data
            self.closed = not data
        *lines, self._rest = self._rest.split(b"\n")
        messages = []
        for line in lines:
            with contextlib.suppress(ValueError):
                message = json.loads(line)
                if isinstance(message, dict):
                    messages.append(message)
        return messages
