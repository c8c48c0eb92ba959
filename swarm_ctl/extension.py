"""What attaches to a ground station: the contract of an extension, and which ones are installed.

A package brings an extension by an entry point of the group `GROUP`: a class that is an
`Extension`. `swarm-ctl run` and `swarm-ctl station` attach it by `--attach NAME[=ARGUMENT]`, where
NAME is the entry point's. It then gets what the station sees and hears, and may give orders.

An extension never ends a flight. It works in a thread of its own: one that is slow, or hangs,
misses views and messages, and delays no turn of the station. Its errors are caught, told to the
operator, counted, and noted in the run; after ten in a row it is closed. What it refuses at its
start (InputError, StartError) is told before anything flies.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from importlib import metadata
from typing import Final, Protocol, TypeAlias

from swarm_ctl.commands.parse import Order
from swarm_ctl.commands.send import SentCommand
from swarm_ctl.core.model.plan import Plan
from swarm_ctl.errors import InputError, StartError, SwarmError
from swarm_ctl.recording.mcap_recorder import Sink
from swarm_ctl.rim import explained
from swarm_ctl.station.picture.view import SwarmView

GROUP: Final = "swarm_ctl.extensions"

Answer: TypeAlias = SentCommand | InputError
"""What came of an order: the command with the agents' answers, once it is `over`, or as it stands
when the station ends; or why no such command can be sent."""


class StationHandle(Protocol):
    """What an extension has of its station. All of it may be used by any thread."""

    @property
    def plan(self) -> Plan:
        """What the swarm flies. A view's `plan` is the same one."""

    @property
    def name(self) -> str:
        """The station's name on the mesh."""

    @property
    def agent(self) -> int | None:
        """The one on whose drone's computer it is: then a view has the swarm as that agent knows
        it, and no order can be given. None: it is an operator's."""

    @property
    def speedup(self) -> float:
        """Mission seconds per second of the wall clock."""

    @property
    def stepped(self) -> bool:
        """The swarm flies in lockstep: mission time has no pace."""

    def now(self) -> float:
        """Mission time [s]."""

    def tell(self, text: str) -> None:
        """Say a line to the station's operator."""

    def order(self, order: Order, answered: Callable[[Answer], None] | None = None) -> None:
        """Give an operator's order; returns at once. The station sends it in a turn of its own, an
        order a turn (50 ms), as if its operator had given it. `answered` gets the answer, in the
        extension's thread: up to ten seconds later, so never wait for it in `take` or in the sink.

        `commands.parse.parse(line, plan)` makes an order of a line such as `move 0 20 @scouts`. An
        answer is an InputError where the order can't be sent: the swarm can't do it, the station
        may only watch, or a hundred orders of this extension wait already.
        """


class Extension:
    """One extension at one station. A subclass has what it needs of these methods; of one
    attachment none runs beside another, and all but `check` and the start run in its own thread.

    Args:
        argument: what follows NAME= on the command line; '' where nothing does.
        station: to which it is attached.

    Raises:
        InputError: there can't be such an argument; says what is allowed.
        StartError: it can't start here (a port is taken, a package is missing); says what to do.
    """

    sink: Sink | None = None
    """Set it at the start to get the messages, too: all that the station hears and sends (the
    topics of `recording.topics`, as JSON), what Foxglove's panels show of them, and the simulator's
    truth where it is there. The times that it gets are mission time, as Unix times of the run's
    start and on [ns]. It gets each message once, in order, or, where it is more than 20,000
    behind, misses some. Its `abandon` is not called."""

    def __init__(self, argument: str, station: StationHandle) -> None:
        """Attach it."""

    @classmethod
    def check(cls, argument: str) -> None:
        """Raise what the start would raise. Called before anything flies, in another process than
        the station's where `run` starts that."""

    @classmethod
    def port(cls, argument: str) -> int | None:
        """The port of 127.0.0.1 that it serves at, which no other one of the station may have;
        None: it serves at none. InputError as `check`."""
        del argument
        return None

    def take(self, view: SwarmView) -> None:
        """Get the newest view: about four a second of the wall clock, two of a large swarm, and the
        last one of the flight. A view never changes. One that waited too long is missed."""

    def close(self) -> None:
        """The station ends, or ten errors in a row ended this extension. Two seconds later the
        station goes on without it. Not called where the start raised."""


def found_extensions() -> dict[str, str]:
    """The extensions that are installed, and where each is, by name."""
    return {point.name: point.value for point in sorted(metadata.entry_points(group=GROUP))}


def wanted(word: str) -> tuple[str, type[Extension], str]:
    """Of `NAME[=ARGUMENT]`: the name, the extension of this name, and the argument. InputError
    where none is installed, or what is installed is no extension; StartError where it lacks a
    package."""
    name, _, argument = word.partition("=")
    points = [*metadata.entry_points(group=GROUP, name=name)]
    if not points:
        names = ", ".join(found_extensions()) or "none, no package here brings any"
        raise InputError(f"--attach {word}: no such extension is installed; allowed: {names}")
    where = " and ".join(point.value for point in points)
    if len(points) > 1:
        raise InputError(f"--attach {word}: {name} is there more than once: {where}; allowed: once")
    try:
        kind = points[0].load()
    except ModuleNotFoundError as error:
        raise StartError(
            f"--attach {name} needs {error.name}, which is not installed{_install(points[0])}"
        ) from None
    except Exception as error:  # a module runs whatever its author wrote
        raise InputError(
            f"--attach {word}: {where}: {explained(error)}; allowed: a class that is an Extension"
        ) from None
    if not (isinstance(kind, type) and issubclass(kind, Extension)):
        raise InputError(
            f"--attach {word}: {where}: is no Extension; allowed: a subclass of"
            " swarm_ctl.extension.Extension"
        )
    return name, kind, argument


def refuse_shared_ports(options: Sequence[tuple[str, str]]) -> None:
    """InputError where two extensions would serve at one port, and what `wanted` raises. `options`:
    each as it was typed, and its `NAME[=ARGUMENT]`."""
    taken: dict[int, str] = {}
    for option, word in options:
        _, kind, argument = wanted(word)
        port = kind.port(argument)
        if port in taken:
            raise InputError(
                f"{taken[port]} and {option}: both would serve at 127.0.0.1:{port}; allowed: a port"
                " of its own for each"
            )
        if port is not None:
            taken[port] = option


def check(words: Sequence[str]) -> None:
    """Raise what attaching these (`NAME[=ARGUMENT]`) would raise."""
    for word in words:
        name, kind, argument = wanted(word)
        try:
            kind.check(argument)
        except SwarmError:
            raise
        except Exception as error:
            home = kind.__module__.partition(".")[0]
            raise StartError(f"--attach {name}: {explained(error, home)}") from error


def _install(point: metadata.EntryPoint) -> str:
    """How to, where the package has an extra of the extension's name."""
    about = point.dist.metadata if point.dist is not None else None
    if about is None or point.name not in (about.get_all("Provides-Extra") or ()):
        return ""
    return f"; install with: pip install '{about['Name']}[{point.name}]'"
