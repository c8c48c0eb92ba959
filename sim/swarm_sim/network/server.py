"""Runs a world in real time (times the speed-up) behind one socket a vehicle.

A simulator that was not scheduled for a while catches up slowly: its clients live by the clock, and
between two of their setpoints a vehicle must not see so much time that it takes its link for lost.
"""

from __future__ import annotations

import contextlib
import json
import logging
import os
import selectors
import signal
import socket
import struct
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from operator import itemgetter
from typing import IO, Any, Self

from swarm_sim.clock import SimClock
from swarm_sim.config import SimConfig, VehicleConfig
from swarm_sim.network.hub import Hub
from swarm_sim.network.signing import VehicleSigning, read_key
from swarm_sim.network.sockets import Address, VehicleSocket, open_socket
from swarm_sim.world.truth_recorder import TruthFile, TruthRecorder
from swarm_sim.world.world import STEP_S

log = logging.getLogger("sim")

DRAIN_S = 90.0
"""Mission time granted to vehicles to come down after the lifeline is cut."""
_STANDS_S = 10.0
"""Mission time after which vehicles that stand have landed: none takes off again so late."""
_BATCH = 50
"""Steps done at a stretch while catching up, before sockets are looked at again."""
_STOP_S, _STOP_WALL_S, _SPRINT = 0.5, 0.2, 1.25
"""After a stop of so much mission time and wall-clock time, the world goes on at most so many times
as fast as the clock until it has caught up. A PX4 waits 1 s for a setpoint: an agent that wakes
later than the simulator has 0.8 s for it. At twice the clock it had 0.5 s, and lost its vehicle on
a busy machine at `--speedup 2`."""
_GATHER_S = 0.005
"""Wall-clock time for which datagrams gather after a first one; none waits beyond the next step."""
_REST_WALL_S, _LATE_WALL_S = 2e-4, 2.0
"""For a datagram that a client says it has sent."""
_LATE_S, _SAY_AGAIN_S = 1.0, 10.0


class EndpointError(Exception):
    """An endpoint can't be opened; the text names it."""


class Server:
    """Serves until told to stop. A context manager: opens the ports, and leaves none behind."""

    def __init__(
        self,
        config: SimConfig,
        clock: SimClock,
        lifeline: IO[Any] | None,
        tell: Callable[[str], None] = log.warning,
    ) -> None:
        """`tell`: where words for an operator go, a few in a flight."""
        self._config = config
        self._tell = tell
        self._tell_at: defaultdict[int, int] = defaultdict(lambda: 1)
        """By link: the number of refused frames that is told next."""
        self._clock = clock
        self._lifeline = lifeline
        self._drain_until_s: float | None = None
        self._flew_s: float | None = None
        """When a vehicle was last in the air or armed, once one has flown."""
        self._stopping = False
        self._barrier: Barrier | None = None
        self._arrived: list[tuple[int, bytes, Address]] = []
        """Datagrams that wait for a tick of lockstep."""
        self._owed: Counter[int] = Counter()
        """Datagrams that clients have sent and that have not come, by the clients' ports."""
        if config.lockstep is not None:
            clock.stand(0.0)
        self._said_late_s = -_SAY_AGAIN_S
        self._looked_s = clock.now()
        """When the sockets were last looked at, mission time."""
        self._resumed = (self._looked_s, self._looked_s)
        """When this process went on after its last stop: by the clock, and in the world."""
        self._sockets: list[VehicleSocket | None] = []
        """Of each link; None where a further endpoint's port is taken."""
        self._taken: list[str] = []
        """What is told when all is ready."""
        self.hub: Hub
        self._selector: selectors.BaseSelector

    def __enter__(self) -> Self:
        with contextlib.ExitStack() as stack:
            self._selector = stack.enter_context(selectors.DefaultSelector())
            vehicles = self._config.vehicles
            for vehicle in vehicles:
                self._serve(_open(vehicle.endpoint), stack)
            for vehicle in vehicles:
                for endpoint in vehicle.also:
                    self._serve(self._open_if_free(vehicle, endpoint), stack)
            if self._lifeline is not None:
                with contextlib.suppress(PermissionError):  # a plain file: no lifeline
                    self._selector.register(self._lifeline, selectors.EVENT_READ, None)
            self.hub = Hub(self._config, self._clock.now(), self._transmit, self._signing)
            for link, opened in enumerate(self._sockets):
                if opened is not None:
                    self.hub.listen(link, opened.peers())
            if self._config.truth_path is not None:
                file = TruthFile(self._config.truth_path)
                clocked = self._config.lockstep is None
                self.hub.recorder = TruthRecorder(
                    self.hub.world, self._config, file, clocked=clocked
                )
                stack.callback(self.hub.recorder.close)
            if self._config.lockstep is not None:
                self._barrier = Barrier(self._config.lockstep)
                stack.callback(self._barrier.close)
            self._stack = stack.pop_all()
        return self

    def _serve(self, opened: VehicleSocket | None, stack: contextlib.ExitStack) -> None:
        if opened is not None:
            stack.callback(opened.close)
            self._selector.register(opened.fileno(), selectors.EVENT_READ, len(self._sockets))
        self._sockets.append(opened)

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    def stop(self) -> None:
        """Ends `serve` at once; safe to call from a signal handler."""
        self._stopping = True

    def _open_if_free(self, vehicle: VehicleConfig, endpoint: str) -> VehicleSocket | None:
        """Another program may have taken the port since it was seen free."""
        try:
            return _open(endpoint)
        except EndpointError as error:
            log.warning("%s; the vehicle goes without it", error)
            self._taken.append(f"simulated vehicle {vehicle.sysid} goes without {error}")
            return None

    def serve(self) -> None:
        """Until stopped, or until the lifeline is cut and all vehicles are parked; with `once`,
        until all that flew have landed. In lockstep, until no client takes part and all vehicles
        are parked."""
        for words in self._taken:
            self._tell(words)
        if self._barrier is not None and self._serve_in_step(self._barrier):
            return
        while not self._stopping and not self._drained():
            heard = self._poll(self._clock.wall_until(self.hub.world.next_s))
            self._catch_up()
            if heard:  # others are likely to follow: take them together
                self._clock.rest(min(_GATHER_S, self._clock.wall_until(self.hub.world.next_s)))

    def _serve_in_step(self, barrier: Barrier) -> bool:
        """Until the end; False when the keeper is gone: then the system clock goes on."""
        try:
            while not self._stopping:
                tick = barrier.wait()
                if tick is not None and self._step_up_to(tick, barrier):
                    return True
        except KeeperGoneError as gone:
            log.warning("the run's clock: %s; on by the system clock", gone)
            self._clock.run()
            self._looked_s = self._clock.now()
            self._resumed = (self._looked_s, self._looked_s)
            return False
        return True

    def _step_up_to(self, tick: TickWord, barrier: Barrier) -> bool:
        """Hear what belongs to the tick, do the world up to it; whether that was the last tick."""
        self._clock.stand(tick.tick * barrier.tick_s)
        self._owed = Counter() if tick.anew else self._owed + Counter(tick.sent)
        self._take_arrivals(barrier)
        world = self.hub.world
        while world.next_s <= self._clock.now() + STEP_S / 2:
            self.hub.step()
        if tick.agents:
            self._drain_until_s = None
        elif self._drain_until_s is None:
            self._drain_until_s = world.time_s + DRAIN_S
        last = self._drained()
        barrier.done(last=last)
        return last

    def _take_arrivals(self, barrier: Barrier) -> None:
        """All that clients say they have sent, in the order of the links."""
        rests = 0
        self._collect()
        while any(left > 0 for left in self._owed.values()):
            if rests > _LATE_WALL_S / _REST_WALL_S:
                barrier.note("a datagram of an agent is lost or late")
                self._owed.clear()
                break
            rests += 1
            self._clock.rest(_REST_WALL_S)
            self._collect()
        arrived, self._arrived = self._arrived, []
        for link, data, sender in sorted(arrived, key=itemgetter(0)):
            self._hear(link, data, sender)

    def _hear(self, link: int, data: bytes, sender: Address) -> None:
        self.hub.receive(link, data, sender)
        refused = self.hub.codecs[link].unsigned
        if refused >= self._tell_at[link]:
            self._tell_at[link] = 10 ** len(str(refused))
            vehicle = self._config.vehicles[self.hub.links[link][0]].sysid
            words = f"{refused} frame{'s' * (refused > 1)} without a good signature"
            self._tell(f"simulated vehicle {vehicle}: {words} refused, the last from {sender[0]}")

    def _collect(self) -> None:
        for key, _ in self._selector.select(0):
            opened = self._sockets[key.data] if key.data is not None else None
            if key.data is None:
                self._read_lifeline()
            elif opened is not None:
                for data, sender in opened.receive():
                    self._owed[sender[1]] -= 1
                    self._arrived.append((key.data, data, sender))
                self.hub.listen(key.data, opened.peers())

    def report(self) -> None:
        """Logs what was counted."""
        codecs = self.hub.codecs
        if refused := sum(codec.unsigned for codec in codecs):
            log.warning("frames refused for want of a good signature: %d", refused)
        good, bad = sum(codec.frames for codec in codecs), sum(codec.bad for codec in codecs)
        ignored = sum(vehicle.firmware.ignored for vehicle in self.hub.world.vehicles)
        unsent = sum(each.unsent for each in self._sockets if each is not None)
        text = "frames in: %d good, %d bad, %d not for us; datagrams not sent: %d"
        log.info(text, good, bad, ignored, unsent)

    def _signing(self, vehicle: VehicleConfig) -> VehicleSigning:
        path = vehicle.signing_key_path
        return VehicleSigning(None if path is None else read_key(path), self._clock.signing_10us)

    def _transmit(self, link: int, data: bytes, to: Address) -> None:
        opened = self._sockets[link]
        if opened is not None:
            opened.send(data, to)
            if self._barrier is not None:
                self._barrier.sent[to[1]] += 1

    def _poll(self, timeout_s: float) -> bool:
        ready = self._selector.select(timeout_s)
        for key, _ in ready:
            if key.data is None:
                self._read_lifeline()
                continue
            opened = self._sockets[key.data]
            if opened is not None:
                for data, sender in opened.receive():
                    self._hear(key.data, data, sender)
                self.hub.listen(key.data, opened.peers())
        return bool(ready)

    def _read_lifeline(self) -> None:
        lifeline = self._lifeline
        if lifeline is not None and not os.read(lifeline.fileno(), 4096):
            self._selector.unregister(lifeline)
            self._drain_until_s = self.hub.world.time_s + DRAIN_S
            log.info("lifeline cut: waiting for the vehicles to come down")

    def _drained(self) -> bool:
        if self._config.once and self._has_flown():
            return True
        if self._drain_until_s is None:
            return False
        world = self.hub.world
        return world.parked() or world.time_s >= self._drain_until_s

    def _has_flown(self) -> bool:
        """A vehicle was in the air, and all have stood disarmed since."""
        world = self.hub.world
        if any(world.airborne()) or (self._flew_s is not None and not world.parked()):
            self._flew_s = world.time_s
        return self._flew_s is not None and world.time_s > self._flew_s + _STANDS_S

    def _catch_up(self) -> None:
        """Does the steps that are due; after a stop of this process, no faster than `_SPRINT`."""
        now, world = self._clock.now(), self.hub.world
        if now - self._looked_s > max(_STOP_S, _STOP_WALL_S * self._config.speedup):
            self._resumed = now, world.time_s
        self._looked_s = now
        resumed_s, from_s = self._resumed
        until_s = min(now, from_s + _SPRINT * (now - resumed_s))
        for _ in range(_BATCH):
            if world.next_s > until_s:
                break
            self.hub.step()
        self._say_late(now, now - world.time_s)
        if world.next_s > until_s and until_s < now:
            self._clock.rest(self._clock.wall_until(now + _STOP_S / 10))

    def _say_late(self, now: float, behind_s: float) -> None:
        if behind_s > _LATE_S and now - self._said_late_s > _SAY_AGAIN_S:
            self._said_late_s = now
            text = "%.1f s of mission time behind the clock: machine too slow for the speed-up"
            log.warning(text, behind_s)


def _open(endpoint: str) -> VehicleSocket:
    try:
        return open_socket(endpoint)
    except (OSError, OverflowError) as error:
        reason = getattr(error, "strerror", None) or error
        raise EndpointError(f"{endpoint}: can't be opened: {reason}") from error


@contextlib.contextmanager
def signals(server: Server) -> Iterator[None]:
    """SIGTERM ends the server at once; SIGINT (the terminal's Ctrl-C) is ignored. What was blocked
    before this process began stays so: then its lifeline alone ends it."""
    before_int = signal.signal(signal.SIGINT, signal.SIG_IGN)
    before_term = signal.signal(signal.SIGTERM, lambda *_: server.stop())
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before_int)
        signal.signal(signal.SIGTERM, before_term)


_LONGEST = 1 << 16
_WAIT_WALL_S, _SILENT_WALL_S = 1.0, 20.0
"""The keeper speaks every second; after so long it is given up, by all members at once."""


class KeeperGoneError(Exception):
    """The keeper has ended, or hangs."""


@dataclass(frozen=True, slots=True)
class TickWord:
    """The world up to this tick is to be done."""

    tick: int
    anew: bool
    """What was counted before is void."""
    agents: int
    """Clients that take part."""
    sent: Mapping[int, int]
    """So many datagrams were sent from each client's port in the tick before."""


class Barrier:
    """Lockstep: the line to a keeper of mission time, who grants us tick after tick, over
    a socket at `address` (of Linux's abstract name space) that keeps packets apart. Both ends count
    datagrams by the clients' UDP ports, so that a tick has exactly those of the tick before.

    A packet is a JSON object: `join` (answered with `tick_s`), then `tick` and `done` in turn, and
    `note` for the operator; the keeper lives as long as it says anything.
    """

    def __init__(self, address: str) -> None:
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        wait = struct.pack("@ll", int(_WAIT_WALL_S), 0)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVTIMEO, wait)
        self._silent_s = 0.0
        self.sent: Counter[int] = Counter()
        """Datagrams of this tick by client's port."""
        self._tick = 0
        about: dict[str, Any] = {}
        try:
            self._socket.connect("\0" + address)
            self._send(join="simulator", phase=0, port=0)
            while "tick_s" not in about:
                about = self._receive()
        except (OSError, KeeperGoneError) as error:
            self._socket.close()
            raise ConnectionError(f"the run's clock does not answer: {error}") from None
        self.tick_s: float = about["tick_s"]

    def wait(self) -> TickWord | None:
        """The next tick; None after a second without. KeeperGoneError at the keeper's end, or when
        it is silent."""
        word = self._receive()
        if "tick" not in word:
            return None
        self._tick = word["tick"]
        sent = {int(port): count for port, count in word["sent"].items()}
        return TickWord(word["tick"], word["anew"], word["agents"], sent)

    def done(self, *, last: bool) -> None:
        """The tick is done; `last`: the simulator ends."""
        self._send(done=self._tick, said={}, sent=self.sent, last=last)
        self.sent.clear()

    def note(self, text: str) -> None:
        """A line for the operator."""
        self._send(note=text)

    def close(self) -> None:
        self._socket.close()

    def _receive(self) -> dict[str, Any]:
        try:
            data = self._socket.recv(_LONGEST)
        except BlockingIOError:
            self._silent_s += _WAIT_WALL_S
            if self._silent_s >= _SILENT_WALL_S:
                raise KeeperGoneError("it is silent") from None
            return {}
        except OSError:
            data = b""
        if not data:
            raise KeeperGoneError("it has ended")
        self._silent_s = 0.0
        word: dict[str, Any] = json.loads(data)
        return word

    def _send(self, **word: Any) -> None:
        try:
            self._socket.send(json.dumps(word).encode())
        except OSError as error:
            raise KeeperGoneError(str(error)) from None
