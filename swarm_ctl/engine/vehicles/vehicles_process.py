"""`python -m swarm_ctl.engine.vehicles.vehicles_process FOLDER`: starts autopilots and ends them.

It reads the orders in FOLDER, starts each autopilot as its child in a folder of its own, writes
where each is, and says when all may be armed. At its lifeline's end it waits until no vehicle is
armed any more, then ends them. SIGTERM ends them at once. If it is killed, the
kernel (PX4, on Linux), ArduCopter itself or its container's lifeline ends them.

Exit codes: 0 done, 1 an autopilot ended before it was told to, 3 one did not start.
"""

from __future__ import annotations

import contextlib
import ctypes
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Final, Self

from swarm_ctl.engine.clock import pause, wall_s
from swarm_ctl.engine.forked import serve
from swarm_ctl.engine.lifeline import READY, PipeLifeline
from swarm_ctl.engine.vehicles.autopilots import MAKERS, Sitl
from swarm_ctl.engine.vehicles.instances import Instances
from swarm_ctl.engine.vehicles.order import (
    ORDERS,
    ORDERS_JSON,
    STARTED,
    STARTED_JSON,
    Started,
    VehicleOrder,
)
from swarm_ctl.errors import StartError
from swarm_ctl.mavlink.onlooker import Onlooker
from swarm_ctl.signals import ENDING, hears

READY_WALL_S: Final = 180.0
"""Six ArduCopters boot in 10 to 30 s on two cores; other people's work may take most of them."""
_POLL_WALL_S: Final = 0.02
_NICE: Final = 5
"""An autopilot that is kept waiting has a slower clock, an agent that is kept waiting is late."""
_DOWN_S: Final = 90.0
"""Vehicle's own time to come down once every agent has gone: its failsafes land it in 35 s."""
_DOWN_HEARTBEATS: Final = 2
"""Heartbeats without the armed flag, one after another, that show a vehicle to be down."""
_ASKED_WALL_S: Final = 1.0
"""Between asking an autopilot to end and killing it."""


class Vehicle:
    """One autopilot that runs: its process and what is seen of it."""

    def __init__(self, sitl: Sitl) -> None:
        self.sitl = sitl
        sitl.folder.mkdir()
        command = sitl.prepare()
        with sitl.output.open("wb") as output:
            self.process = subprocess.Popen(
                command,
                cwd=sitl.folder,
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=subprocess.STDOUT,
                env=os.environ | sitl.environment,
                process_group=0,  # a terminal's Ctrl-C is for `run`
                preexec_fn=_as_child,
            )
        self.seen = Onlooker(sitl.onlooker, sitl.order.sysid)
        self._down_since: int | None = None

    @property
    def started(self) -> Started:
        order, sitl = self.sitl.order, self.sitl
        where = (sitl.instance, self.process.pid, sitl.endpoint, sitl.ground_station)
        return Started(order.agent, order.sysid, order.kind, *where)

    def set_up(self, now: float) -> bool:
        """To be called until True; StartError when it has ended."""
        self.seen.listen(now)
        if self.process.poll() is not None:
            raise StartError(f"{self.end}; see {self.sitl.output}")
        return self.sitl.set_up(self.seen, now)

    @property
    def end(self) -> str:
        """How it ended, in words; '' while it runs."""
        code, order = self.process.poll(), self.sitl.order
        return "" if code is None else f"{order.kind} of agent {order.agent} ended, code {code}"

    def is_down(self) -> bool:
        """It has ended, or several heartbeats since the last armed one say that it is disarmed."""
        if self.process.poll() is not None:
            return True
        if self.seen.armed:
            self._down_since = None
        elif self._down_since is None:
            self._down_since = self.seen.heartbeats
        since = self._down_since
        return since is not None and self.seen.heartbeats >= since + _DOWN_HEARTBEATS

    def finish(self) -> None:
        """End it (PX4 closes its log on SIGINT), take its exit code, remove what it left."""
        self.seen.close()
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGINT)
            with contextlib.suppress(subprocess.TimeoutExpired):
                self.process.wait(_ASKED_WALL_S)
            self.process.kill()
        self.process.wait()
        self.sitl.clean()


class Vehicles:
    """All autopilots of one run, for as long as this is entered."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder.resolve()  # each vehicle works in a folder of its own
        self._orders = ORDERS_JSON.validate_json((folder / ORDERS).read_bytes())
        self._stack = contextlib.ExitStack()
        self._all: list[Vehicle] = []

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        for vehicle in self._all:  # all at once, then one after the other
            vehicle.process.send_signal(signal.SIGINT)
        self._stack.close()

    def start(self, stop: Callable[[], bool]) -> bool:
        """Start all and bring them to where they may be armed; False when `stop` said so before.

        StartError where one does not get there.
        """
        instances = self._stack.enter_context(Instances())
        for order in self._orders.vehicles:
            self._start(order, instances.take(order.kind))
        started = STARTED_JSON.dump_json(tuple(v.started for v in self._all), indent=1)
        (self._folder / STARTED).write_bytes(started)
        until, waiting = wall_s() + READY_WALL_S, self._all
        while waiting := [each for each in waiting if not each.set_up(wall_s())]:
            if stop():
                return False
            if wall_s() > until:
                names = ", ".join(str(each.sitl.order.agent) for each in waiting)
                raise StartError(f"not ready after {READY_WALL_S:g} s: vehicles of agents {names}")
            pause(_POLL_WALL_S)
        return True

    def _start(self, order: VehicleOrder, instance: int) -> None:
        folder = self._folder / str(order.agent)
        sitl = MAKERS[order.kind](order, instance, folder, self._orders.speedup)
        vehicle = Vehicle(sitl)
        self._stack.callback(vehicle.finish)
        self._all.append(vehicle)

    def keep(self, stop: Callable[[], bool]) -> list[str]:
        """Look on until `stop`; how each ended that did before."""
        ended: dict[int, str] = {}
        while not stop():
            self._listen()
            for vehicle in self._all:
                if vehicle.end and vehicle.process.pid not in ended:
                    ended[vehicle.process.pid] = vehicle.end
                    print(vehicle.end, file=sys.stderr, flush=True)  # noqa: T201
                    vehicle.sitl.clean()  # a container outlives its engine's client
            pause(_POLL_WALL_S)
        return list(ended.values())

    def wait_down(self, stop: Callable[[], bool]) -> None:
        """Until no vehicle is armed, `stop`, or the time is over."""
        until = wall_s() + 5.0 + _DOWN_S / self._orders.speedup
        for vehicle in self._all:
            vehicle.seen.heartbeats = 0
        while [each for each in self._all if not each.is_down()] and not stop():
            if wall_s() > until:
                print("a vehicle is armed still, and is ended", file=sys.stderr)  # noqa: T201
                return
            self._listen()
            pause(_POLL_WALL_S)

    def _listen(self) -> None:
        now = wall_s()
        for vehicle in self._all:
            vehicle.seen.listen(now)


def _as_child() -> None:
    """SIGINT acts again, agents come first, and the kernel kills this child when its parent
    dies."""
    os.nice(_NICE)
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    hears(*ENDING)
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(1, signal.SIGKILL)  # PR_SET_PDEATHSIG


def fly(lifeline: PipeLifeline) -> int:
    """Start the autopilots, and end them with the lifeline; the exit code."""
    terminated = threading.Event()
    signal.signal(signal.SIGTERM, lambda *_: terminated.set())
    hears(signal.SIGTERM)

    def soon() -> bool:
        return terminated.is_set() or bool(lifeline.cut())

    try:
        with Vehicles(Path(sys.argv[1])) as vehicles:
            if not vehicles.start(soon):
                return 0
            lifeline.tell(READY)
            ended = vehicles.keep(soon)
            vehicles.wait_down(terminated.is_set)
    except OSError as error:
        raise StartError(f"{error.filename or ''}: {error.strerror}") from None
    return 1 if ended else 0


if __name__ == "__main__":
    serve(fly)
