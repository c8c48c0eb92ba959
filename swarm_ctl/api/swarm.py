"""A swarm in flight, as a program commands and reads it: `Swarm`, and `AsyncSwarm` for asyncio."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable, Coroutine, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial, wraps
from typing import TYPE_CHECKING, Any, Concatenate, Final, Never, ParamSpec, TypeVar

from swarm_ctl.api.flight import (
    FlightError,
    FlightResult,
    Named,
    SwarmFlight,
    turn_before,
    turns_for,
    turns_to_step,
)
from swarm_ctl.commands.answers import refusals
from swarm_ctl.commands.parse import Order, parse
from swarm_ctl.commands.send import SentCommand
from swarm_ctl.core.model.messages import CommandKind, Event
from swarm_ctl.core.model.plan import Plan
from swarm_ctl.core.model.text import agents_named
from swarm_ctl.errors import InputError
from swarm_ctl.station.picture.alarms import Alarm, alarms
from swarm_ctl.station.picture.view import SwarmView

P = ParamSpec("P")
T = TypeVar("T")
_STEP_S: Final = 300.0
_END_S: Final = 900.0


_NOW_CALLED: Final = {"send_home": "return_(*agents)", "land_only": "land(*agents)"}
"""Calls of earlier versions. The words are the shell's: `return` alone can be no name here."""


def _no_call(swarm: object, name: str) -> str:
    """Why a swarm has no such attribute."""
    now = f"; it is called {_NOW_CALLED[name]}" if name in _NOW_CALLED else ""
    return f"{type(swarm).__name__!r} object has no attribute {name!r}{now}"


class OrderError(FlightError):
    """An order that not all agents accepted, with their reasons."""

    def __init__(self, sent: SentCommand) -> None:
        self.sent: Final = sent
        whys = list(refusals(sent))
        if sent.silent:
            whys.append(f"{agents_named(sent.silent)}: no answer")
        super().__init__(f"{sent.asked or sent.command.kind}: {sent.failed or '; '.join(whys)}")


def _refuse_still(every_s: float) -> None:
    """InputError where mission time would not go on between two views."""
    if not every_s > 0:
        raise InputError(f"views: every_s={every_s:g}; allowed: over 0 s")


def _accepted(sent: SentCommand) -> SentCommand:
    if not sent.accepted:
        raise OrderError(sent)
    return sent


class Swarm:
    """A swarm that flies a mission. Times are mission seconds, lengths metres.

    Orders wait for the agents' answers. One that an agent refuses, or does not answer, raises
    `OrderError`; a word that can be no order raises `InputError`, and nothing is sent.
    """

    def __init__(self, flight: SwarmFlight) -> None:
        self.flight: Final = flight
        """What the fixture's tests work with: agents killed, frozen, thawed."""

    @property
    def plan(self) -> Plan:
        """What is flown: `agents`, `steps`, `law`, ..."""
        return self.flight.plan

    @property
    def now(self) -> float:
        """Mission time [s]."""
        return self.flight.now

    # --- waiting ---

    def step(self, step: int | str, within_s: float = _STEP_S, *, group: str = "") -> None:
        """Wait until every agent that flies the mission, or each of a group (`"@scouts"`), is in
        this step or beyond: its number from 1, or its name (`form hexagon`). FlightError when that
        takes longer or the flight ends before; ValueError lists the steps where there is no such
        one."""
        self.flight.wait_step(step, within_s, group=group)

    def wait(self, seconds: float) -> None:
        """Let the swarm fly for so long."""
        self.flight.wait_s(seconds)

    def until(self, condition: Callable[[SwarmView], bool], within_s: float = _STEP_S) -> SwarmView:
        """The first view for which the condition holds; FlightError when that takes longer."""
        end = self.now + within_s
        while not condition(view := self.view()):
            turn_before(self.flight, end, f"not so within {within_s:g} s")
        return view

    # --- what is known ---

    def view(self) -> SwarmView:
        """The swarm now, as a ground station sees it: `agents` (each with `state`, `status`,
        `sigma`, `link`), `pairs` in the avoidance region, `links`, `step`, `error_m`, ..."""
        return self.flight.view()

    def views(self, every_s: float = 0.1) -> Iterator[SwarmView]:
        """A view each `every_s`, over 0, until the flight is over."""
        _refuse_still(every_s)
        while not self.flight.over:
            yield self.view()
            self.wait(every_s)

    def alarms(self) -> tuple[Alarm, ...]:
        """What an operator would have to be told now, the worst first."""
        return alarms(self.view())

    def events(self) -> Sequence[Event]:
        """What agents have logged so far."""
        return self.flight.events()

    # --- orders ---

    def send(self, text: str) -> SentCommand:
        """Any order as `swarm-ctl send` takes it, e.g. `land @3`, `tune h=0.04`."""
        return self._order(parse(text, self.plan))

    def hold(self, *agents: Named) -> SentCommand:
        """Stop in the air; these agents alone, by id or by group (`hold("@scouts", 7)`), or all."""
        return _accepted(self.flight.command(CommandKind.HOLD, agents))

    def resume(self, *agents: Named) -> SentCommand:
        """Go on with the mission."""
        return _accepted(self.flight.command(CommandKind.RESUME, agents))

    def next(self, *agents: Named) -> SentCommand:
        """End the current step."""
        return _accepted(self.flight.command(CommandKind.NEXT, agents))

    def form(self, shape: str, *, group: str = "") -> SentCommand:
        """Fly into another shape of the mission; a group's, where one is named (`"@scouts"`)."""
        return _accepted(self.flight.form(shape, group=group))

    def move(
        self,
        north_m: float,
        east_m: float,
        speed_mps: float | None = None,
        *,
        by: bool = False,
        group: str = "",
    ) -> SentCommand:
        """Move the centre of the formation, or of a group's, to a point, in metres from the origin;
        or by so much."""
        return _accepted(self.flight.move(north_m, east_m, speed_mps, by=by, group=group))

    def goto(
        self, north_m: float, east_m: float, *agents: Named, speed_mps: float | None = None
    ) -> SentCommand:
        """Send these agents alone to a point, in metres from the origin; `resume` joins them to the
        others again. By latitude and longitude: `send("goto 47.3977,8.5456 @3")`."""
        return _accepted(self.flight.goto(north_m, east_m, *agents, speed_mps=speed_mps))

    def launch(self, *agents: Named) -> SentCommand:
        """Send up agents that wait on the ground (`waits` in the mission); they join the others."""
        return _accepted(self.flight.command(CommandKind.LAUNCH, agents))

    def follow(
        self,
        target: str,
        north_m: float = 0.0,
        east_m: float = 0.0,
        *,
        in_course: bool = False,
        group: str = "",
    ) -> SentCommand:
        """Keep the formation, or a group's, so far from a target of the mission; `in_course`: ahead
        of it, and to its right."""
        follow = self.flight.follow
        return _accepted(follow(target, north_m, east_m, in_course=in_course, group=group))

    def tune(self, /, **values: float) -> SentCommand:
        """Change the law of all agents at one time, e.g. `tune(h=0.04, kappa=15)`."""
        words = tuple(f"{name}={value!r}" for name, value in values.items())
        return self._order(parse(" ".join((CommandKind.TUNE, *words)), self.plan))

    def zone(
        self,
        /,
        verb: str,
        name: str,
        *,
        circle: tuple[float, float, float] | None = None,
        polygon: Sequence[tuple[float, float]] = (),
        **heights: float,
    ) -> SentCommand:
        """Add or lift a zone that no vehicle enters, for all agents at one time: `zone("add",
        "pond", circle=(north, east, radius))`, or `polygon` of corners (north, east), and `floor`,
        `ceiling`, `clearance` as wanted, in metres; `zone("lift", "pond")`."""
        if circle is not None and polygon:
            raise InputError(f"zone {name}: a circle and a polygon; allowed: one of them")
        shape = [] if verb == "lift" else ["polygon" if circle is None else "circle"]
        numbers = [x for corner in polygon for x in corner] if circle is None else list(circle)
        words = [*shape, *(f"{number!r}" for number in numbers)]
        words += [f"{key}={value!r}" for key, value in heights.items()]
        return self._order(parse(" ".join((CommandKind.ZONE, verb, name, *words)), self.plan))

    def land(self, *agents: Named) -> SentCommand:
        """Land where they are: these agents, and the others do as the mission's policy says; or
        all. `finish` waits for the end."""
        return _accepted(self.flight.command(CommandKind.LAND, agents))

    def return_(self, *agents: Named) -> SentCommand:
        """Fly home, all at once, and land: these agents alone, or all."""
        return _accepted(self.flight.command(CommandKind.RETURN, agents))

    if not TYPE_CHECKING:  # which knows all calls

        def __getattr__(self, name: str) -> Never:
            raise AttributeError(_no_call(self, name), name=name, obj=self)

    def _order(self, order: Order) -> SentCommand:
        return _accepted(self.flight.order(order))

    # --- the end ---

    def finish(self, within_s: float = _END_S) -> FlightResult:
        """Fly the mission to its end; FlightError when that takes longer."""
        return self.flight.finish(within_s)


def _awaited(
    call: Callable[Concatenate[Swarm, P], T],
) -> Callable[Concatenate[AsyncSwarm, P], Coroutine[Any, Any, T]]:
    """A call of `Swarm` for asyncio, with its parameters and its text."""

    @wraps(call)
    async def later(self: AsyncSwarm, /, *args: P.args, **kwargs: P.kwargs) -> T:
        return await self._do(partial(call, self._swarm, *args, **kwargs))

    return later


class AsyncSwarm:
    """A `Swarm` for asyncio: the same calls, awaited. They take turns, each on one thread, so that
    a task that waits for a step keeps no other from giving an order."""

    def __init__(self, swarm: Swarm) -> None:
        self._swarm, self._flight = swarm, swarm.flight
        self._thread = ThreadPoolExecutor(1, "swarm")

    async def _do(self, call: Callable[[], T]) -> T:
        return await asyncio.get_running_loop().run_in_executor(self._thread, call)

    async def _take(self, turns: Iterator[None]) -> None:
        """Between two of them, other calls have their turn."""
        while not await self._do(partial(next, turns, True)):
            pass

    async def _end(self, within_s: float) -> float:
        return await self._do(lambda: self._flight.now) + within_s

    @property
    def plan(self) -> Plan:
        """What is flown: `agents`, `steps`, `law`, ..."""
        return self._swarm.plan

    async def step(self, step: int | str, within_s: float = _STEP_S, *, group: str = "") -> None:
        """`Swarm.step`."""
        await self._take(turns_to_step(self._flight, step, within_s, group))

    async def wait(self, seconds: float) -> None:
        """`Swarm.wait`."""
        await self._take(turns_for(self._flight, seconds))

    async def until(
        self, condition: Callable[[SwarmView], bool], within_s: float = _STEP_S
    ) -> SwarmView:
        """`Swarm.until`."""
        why, end = f"not so within {within_s:g} s", await self._end(within_s)
        while not condition(view := await self.view()):
            await self._do(partial(turn_before, self._flight, end, why))
        return view

    async def views(self, every_s: float = 0.1) -> AsyncIterator[SwarmView]:
        """`Swarm.views`."""
        _refuse_still(every_s)
        while not await self._do(lambda: self._flight.over):
            yield await self.view()
            await self.wait(every_s)

    view = _awaited(Swarm.view)
    alarms = _awaited(Swarm.alarms)
    events = _awaited(Swarm.events)
    send = _awaited(Swarm.send)
    hold = _awaited(Swarm.hold)
    resume = _awaited(Swarm.resume)
    next = _awaited(Swarm.next)
    form = _awaited(Swarm.form)
    move = _awaited(Swarm.move)
    goto = _awaited(Swarm.goto)
    launch = _awaited(Swarm.launch)
    follow = _awaited(Swarm.follow)
    tune = _awaited(Swarm.tune)
    zone = _awaited(Swarm.zone)
    land = _awaited(Swarm.land)
    return_ = _awaited(Swarm.return_)

    if not TYPE_CHECKING:  # which knows all calls
        __getattr__ = Swarm.__getattr__

    async def finish(self, within_s: float = _END_S) -> FlightResult:
        """`Swarm.finish`."""
        end = await self._end(within_s)
        await self.wait(within_s)
        return await self._do(lambda: self._swarm.finish(max(0.0, end - self._flight.now)))

    def leave(self) -> None:
        """End the thread."""
        self._thread.shutdown()
