"""The extensions of a ground station at work, each in a thread of its own."""

from __future__ import annotations

import queue
import sys
import threading
from collections import deque
from collections.abc import Callable, Sequence
from functools import partial
from typing import Final, Self

from swarm_ctl.commands.parse import Order
from swarm_ctl.commands.send import SentCommand
from swarm_ctl.engine.station.ground_station import Station
from swarm_ctl.errors import InputError, StartError, SwarmError
from swarm_ctl.extension import Answer, wanted
from swarm_ctl.recording.mcap_recorder import Sink
from swarm_ctl.recording.topics import Topic
from swarm_ctl.rim import Rim, explained
from swarm_ctl.station.picture.view import SwarmView

_GIVEN_UP: Final = 10
"""Errors in a row after which an extension is closed."""
_MESSAGES: Final = 20_000
"""That may wait: ten seconds of a hundred agents."""
_ORDERS: Final = 100
"""That may wait: five seconds of turns."""
_END_WALL_S: Final = 2.0


class _Handle:
    """A station as an extension has it."""

    def __init__(self, station: Station, agent: int | None) -> None:
        self.plan, self.name, self.agent = station.plan, station.name, agent
        self.speedup, self.now = station.clock.speedup, station.clock.now
        self.stepped = station.clock.stepped
        self.given = deque[tuple[Order, Callable[[Answer], None]]]()
        self.said = deque[str](maxlen=_ORDERS)
        self.post: Callable[[Callable[[], None]], None] = lambda _: None

    def tell(self, text: str) -> None:
        self.said.append(text)

    def order(self, order: Order, answered: Callable[[Answer], None] | None = None) -> None:
        answered = answered or (lambda _: None)
        if len(self.given) < _ORDERS:
            self.given.append((order, answered))
        else:
            self.post(partial(answered, InputError(f"{_ORDERS} orders wait; allowed: fewer")))


class _Attachment:
    """One extension, its thread, and what waits for it."""

    def __init__(self, word: str, station: Station, agent: int | None) -> None:
        name, kind, argument = wanted(word)
        self._station, self._handle = station, _Handle(station, agent)
        self._calls: queue.SimpleQueue[Callable[[], None] | None] = queue.SimpleQueue()
        self._lock = threading.Lock()
        self._view: SwarmView | None = None
        self._sent: list[tuple[SentCommand, Callable[[Answer], None]]] = []
        home = kind.__module__.partition(".")[0]
        self._rim = Rim(f"extension {name}", _GIVEN_UP, home)
        self._slow = Rim(f"extension {name}, which is slow,")
        self._orders = Rim(f"an order of extension {name}")
        self.rims = (self._rim, self._slow, self._orders)
        self._handle.post = self.post
        try:
            self._extension = kind(argument, self._handle)
        except SwarmError:
            raise
        except Exception as error:
            raise StartError(f"--attach {word}: {explained(error, home)}") from error
        self.sink: Sink | None = self._extension.sink and _PostedSink(self._extension.sink, self)
        self._thread = threading.Thread(target=self._work, name=f"extension {name}", daemon=True)
        self._thread.start()

    def post(self, call: Callable[[], None]) -> None:
        """Let its thread make this call, after those before."""
        if not self._rim.off:
            self._calls.put(call)

    def post_message(self, call: Callable[[], None]) -> None:
        """The same, of a message: the recorder's thread gives them."""
        if self._calls.qsize() < _MESSAGES:
            self.post(call)
        else:
            self._slow.note(queue.Full("messages are dropped"))

    def show(self, view: SwarmView) -> None:
        with self._lock:
            waiting, self._view = self._view, view
        if waiting is None:
            self.post(self._look)

    def _look(self) -> None:
        with self._lock:
            view, self._view = self._view, None
        if view is not None:
            self._extension.take(view)

    def turn(self) -> None:
        """Send one of its orders; tell it what came of those before, and the operator what it
        says."""
        while self._handle.said:
            self._station.tell(self._handle.said.popleft())
        self._answer(lambda sent: sent.over)
        if not self._handle.given or self._rim.off:
            return
        order, answered = self._handle.given.popleft()
        try:
            self._sent.append((self._station.order(order), answered))
        except InputError as error:
            self.post(partial(answered, error))
        except Exception as error:  # it may be any object, of any values
            self._orders.note(error)
            self.post(partial(answered, InputError(f"can't be sent: {explained(error)}")))

    def _answer(self, ready: Callable[[SentCommand], bool]) -> None:
        for sent, answered in self._sent:
            if ready(sent):
                self.post(partial(answered, sent))
        self._sent = [(sent, answered) for sent, answered in self._sent if not ready(sent)]

    def end(self) -> None:
        """All that waits is still given to it."""
        self._answer(lambda _: True)
        self._calls.put(None)

    def join(self, wall_s: float) -> None:
        self._thread.join(wall_s)
        told = [str(trouble) for rim in self.rims for trouble in rim.troubles()]
        if self._thread.is_alive():
            told.append(f"{self._rim.part} does not end; the station ends without it")
        sys.stderr.write("".join(f"{line}\n" for line in told))

    def _work(self) -> None:
        try:
            while not self._rim.off and (call := self._calls.get()) is not None:
                self._rim.run(call)
        finally:
            try:
                self._extension.close()
            except Exception as error:
                self._rim.note(error)


class _PostedSink:
    """A sink whose messages wait for its extension's thread."""

    def __init__(self, sink: Sink, attachment: _Attachment) -> None:
        self._sink, self._post = sink, attachment.post_message

    def write(
        self, topic: Topic, agent: int | None, heard_ns: int, said_ns: int, data: bytes
    ) -> None:
        self._post(partial(self._sink.write, topic, agent, heard_ns, said_ns, data))

    def flush(self) -> None:
        self._post(self._sink.flush)

    def close(self) -> None:
        self._post(self._sink.close)

    abandon = close


class Attachments:
    """All extensions of one station, from now on until it is closed; use it in a `with`.

    Args:
        words: each `NAME[=ARGUMENT]`.
        station: gets their orders, in its own turns, and tells their troubles.
        agent: the one that the station is beside; None: it is an operator's.

    Raises:
        InputError, StartError: one of them can't be attached; the others are closed.
    """

    def __init__(self, words: Sequence[str], station: Station, agent: int | None = None) -> None:
        self._all: list[_Attachment] = []
        try:
            for word in words:
                self._all.append(_Attachment(word, station, agent))
        except BaseException:
            self.close()
            raise
        self.sinks = tuple(each.sink for each in self._all if each.sink is not None)
        """Those that want the messages."""
        station.tell_of(rim for each in self._all for rim in each.rims)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def show(self, view: SwarmView) -> None:
        """Give all of them the newest view; never waits."""
        for each in self._all:
            each.show(view)

    def turn(self) -> None:
        """Once a turn of the station: their orders are sent, and answered; never waits."""
        for each in self._all:
            each.turn()

    def close(self) -> None:
        """End all of them; one that does not end in two seconds is left behind."""
        for each in self._all:
            each.end()
        for each in self._all:
            each.join(_END_WALL_S)
