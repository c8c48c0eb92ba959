"""Arguments and options that several commands share."""

from __future__ import annotations

import contextlib
import errno
import inspect
import os
import re
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from functools import wraps
from pathlib import Path
from typing import Annotated, Any, Final, NamedTuple

import typer

from swarm_ctl.core.model.fleet import plain_endpoint
from swarm_ctl.engine.vehicles.instances import GCS_PORT
from swarm_ctl.errors import InputError, StartError
from swarm_ctl.files import locked, read_bytes
from swarm_ctl.mission.ready import named


def option(metavar: str, text: str, *names: str, **more: Any) -> Any:
    """An option with a value that the help calls `metavar`; `more`: as typer has it."""
    return typer.Option(*names, metavar=metavar, help=text, **more)


def switch(name: str, text: str) -> Any:
    """An option that is either given or not."""
    return typer.Option(name, help=text)


def endpoint_option(text: str) -> Any:
    """A vehicle's endpoint, in either spelling."""
    return option("URL", text, callback=lambda given: given and plain_endpoint(given))


def mission_option(text: str) -> Any:
    """A mission's file, or a ready mission's name."""
    return option("FILE", text, callback=lambda given: given and named(given))


def runs_in(folder: Path) -> list[Path]:
    """The run folders in a folder, the newest first."""
    return sorted((path.parent for path in folder.glob("*/run.json")), reverse=True)


def complete_runs(incomplete: str) -> list[str]:
    """For the shell's tab: run folders, the newest first."""
    folder = Path(incomplete).parent if "/" in incomplete else Path("runs")
    return [str(run) for run in runs_in(folder) if str(run).startswith(incomplete)]


MissionFile = Annotated[
    Path,
    typer.Argument(
        metavar="MISSION",
        help="The mission file, or a ready mission's name, e.g. hexagon (swarm-ctl missions).",
        callback=named,
    ),
]
FleetFile = Annotated[Path | None, option("FILE", "A fleet file instead of the mission's own.")]
_VEHICLES = (
    "What to fly where the fleet names no endpoint: simulated, arducopter or px4; several in turn"
    " (arducopter,px4), or by agent (1-3=arducopter,4-6=px4).  [default: the fleet's]"
)
VehicleKinds = Annotated[str | None, option("KIND", _VEHICLES)]
RunFolder = Annotated[
    Path | None,
    typer.Argument(
        metavar="RUN",
        help="The run folder.  [default: newest in runs/]",
        autocompletion=complete_runs,
    ),
]
_RUN_NAME = "Its folder, or its mission.  [default: the only run in runs/ that flies]"
RunName = Annotated[str | None, option("RUN", _RUN_NAME, autocompletion=complete_runs)]
_ELSEWHERE = "A mission or plan file, not a run: for a swarm on other hosts."
SwarmElsewhereFile = Annotated[Path | None, mission_option(_ELSEWHERE)]
FlownFleet = Annotated[Path | None, option("FILE", "With --mission: the fleet file that is flown.")]
_IDENTITY = (
    "The folder with the own keys (swarm-ctl trust).  [default: the only operator of the fleet's"
    " trust]"
)
IdentityFolder = Annotated[Path | None, option("FOLDER", _IDENTITY, "--identity")]
_OF_AGENT = "The folder of one agent's keys, on its host.  [default: agent-ID in the fleet's trust]"
AgentIdentity = Annotated[Path | None, option("FOLDER", _OF_AGENT, "--identity")]
_OPEN_MESH = "Fly without keys on a network that other computers reach: any of them may command."
OpenMesh = Annotated[bool, switch("--open-mesh", _OPEN_MESH)]
_ZENOH = (
    "zenoh's own settings (JSON5), for what has no option here. Endpoints, keys and bounds stay"
    " those of swarm-ctl."
)
ZenohConfig = Annotated[Path | None, option("FILE", _ZENOH, "--zenoh-config")]
Headless = Annotated[bool, switch("--headless", "Plain log lines instead of the dashboard.")]
Json = Annotated[bool, switch("--json", "One line of JSON a second on stdout.")]
_ATTACH = (
    "Attach an extension to the station; repeat it for another. A name that is not installed is"
    " answered by those that are."
)
Attach = Annotated[list[str] | None, option("NAME[=ARGUMENT]", _ATTACH)]
_FOXGLOVE = (
    "Serve Foxglove on this port of 127.0.0.1 (8765 is its own default): map, 3-D scene, plots,"
    " log. Needs the extra `foxglove`."
)
_ROS2 = (
    "Be a node of ROS 2 in this domain, over rmw_zenoh: topics, and orders as services. Needs the"
    " extra `ros2`.  [default: ROS_DOMAIN_ID, or 0]"
)
_WEB = (
    "Serve a live map for web browsers on this port of 127.0.0.1; the station tells the link. Who"
    " has it may look, and nothing else.  [8700 where no port follows]"
)
_SPEEDUP = "Mission seconds per second of the wall clock."
Speedup = Annotated[float, option("FACTOR", _SPEEDUP, min=0.1, max=100.0)]
Seed = Annotated[int, option("NUMBER", "Seed of all random numbers.", min=0)]
_ZENOH_BYTES = 1_000_000
_LOCK: Final = ".lock"
"""In a folder that one command alone may write, or at the end of the name of what it writes."""
_NO_LINK: Final = getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0)
_ELSE: Final = "allowed: another --out"
_PROCESSES = "Processes to fly with.  [default: one per core]"
Processes = Annotated[int | None, option("NUMBER", _PROCESSES, min=1)]


class ShortWord(NamedTuple):
    """An option `--OPTION ARGUMENT` for `--attach EXTENSION=ARGUMENT`."""

    option: str
    extension: str
    metavar: str
    text: str
    alone: str | None = None
    """The argument where the option stands without a number; None: it needs one."""


SHORT_WORDS = (
    ShortWord("metrics", "prometheus", "PORT", "Prometheus metrics on this port of 127.0.0.1."),
    ShortWord("web", "browser", "PORT", _WEB, alone="8700"),
    ShortWord("foxglove", "foxglove", "PORT", _FOXGLOVE),
    ShortWord("ros2", "ros2", "DOMAIN", _ROS2, alone=""),
)
_ALONE = {"--gcs": str(GCS_PORT), "--web-dashboard": "8701"} | {
    f"--{each.option}": each.alone for each in SHORT_WORDS if each.alone is not None
}


def attaching(command: Callable[..., None]) -> Callable[..., None]:
    """The command, which has a parameter `attach`, with an option for each short word, too."""
    signature = inspect.signature(command, eval_str=True)

    @wraps(command)
    def with_short_words(*words: Any, **given: Any) -> None:
        typed = [(f"--attach {word}", word) for word in given.pop("attach", None) or ()]
        for each in SHORT_WORDS:
            typed += [
                (f"--{each.option} {argument}", f"{each.extension}={argument}")
                for argument in given.pop(each.option, None) or ()
            ]
        if len(typed) > 1:
            from swarm_ctl.extension import refuse_shared_ports

            refuse_shared_ports(typed)
        command(*words, **given, attach=[word for _, word in typed])

    parameters = [
        inspect.Parameter(
            each.option,
            inspect.Parameter.KEYWORD_ONLY,
            default=None,
            annotation=Annotated[list[str] | None, option(each.metavar, each.text)],
        )
        for each in SHORT_WORDS
    ]
    taken = [each.replace(kind=each.KEYWORD_ONLY) for each in signature.parameters.values()]
    place = [each.name for each in taken].index("attach")
    taken[place:place] = parameters
    with_short_words.__signature__ = signature.replace(parameters=taken)  # type: ignore[attr-defined]
    with_short_words.__annotations__ = {each.name: each.annotation for each in taken}
    return with_short_words


_VALUE: Final = re.compile(r"[\d.]+|\d+,\S+|[^\s-]\S*:\S*")
"""What follows an option that may stand alone and is no other argument: a number, an address, a
domain and more; also one with a mistake, so that it is named."""


def filled(arguments: Sequence[str]) -> list[str]:
    """The command line in which each option that may stand alone has its value."""
    following = [*arguments, ""][1:]
    return [
        f"{each}={_ALONE[each]}" if each in _ALONE and not _VALUE.fullmatch(after) else each
        for each, after in zip(arguments, following, strict=True)
    ]


def without(arguments: Sequence[str], name: str) -> list[str]:
    """The command line without an option that has a value."""
    given = filled(arguments)
    while name in given:
        at = given.index(name)
        del given[at : at + 2]
    return [each for each in given if not each.startswith(f"{name}=")]


def zenoh_settings(file: Path | None, *, guarded: bool) -> dict[str, Any]:
    """What a zenoh file sets; `guarded`: the mesh has keys, or other computers may reach it.
    InputError where it can't be used."""
    if file is None:
        return {}
    from swarm_ctl.mesh.zenoh_config import read_settings

    try:
        text = read_bytes(file, _ZENOH_BYTES).decode()
    except (OSError, UnicodeDecodeError) as error:
        why = error.strerror if isinstance(error, OSError) else "is no text"
        raise InputError(f"--zenoh-config {file}: can't be read: {why}") from None
    return read_settings(text, str(file), guarded=guarded)


def recorded_run(given: Path | None, say: Callable[[str], None]) -> Path:
    """The run folder that was given, else the newest in `runs` with a recording; `say` hears of
    newer ones without. InputError where there is none, or a folder of run folders was given."""
    found = runs_in(given or Path("runs"))
    if given is None:
        if not found:
            raise InputError("no run in runs/; name a run folder")
        for run in found:
            if (run / "recording.mcap").is_file():
                return run
            say(f"{run} has no recording; the one before it is taken")
        raise InputError("no run in runs/ has a recording; name a run folder or a recording")
    if (given / "run.json").exists() or not given.is_dir():
        return given
    if found:
        raise InputError(f"{given} is no run folder, it has {len(found)}; the newest: {found[0]}")
    if not (given / "recording.mcap").exists():
        allowed = "a run folder with one, or a recording.mcap"
        raise InputError(f"{given}: has no recording; allowed: {allowed}")
    return given


_GCS_ADDRESS: Final = re.compile(r"(?:(?P<host>[^:\s-][^:\s]*):)?(?P<port>\d+)")


def gcs_addresses(given: Sequence[str]) -> tuple[tuple[str, int], ...]:
    """Host and port of each `--gcs`, once; InputError where one is not an address."""
    return tuple(dict.fromkeys(_address(text) for text in given))


def _address(text: str) -> tuple[str, int]:
    found = _GCS_ADDRESS.fullmatch(text)
    if found is None or not 1 <= int(found["port"]) <= 65535:
        raise InputError(f"--gcs {text!r}: not an address; allowed: PORT or HOST:PORT, 1..65535")
    return found["host"] or "127.0.0.1", int(found["port"])


def require_writable(path: Path, choose: str) -> None:
    """Raise StartError where neither a file `path` nor a folder of this name can be written, or
    made with the folders that it needs; `choose` says how to name another place."""
    try:
        there = next(each for each in (path, *path.parents) if each.exists())
        if there.is_dir():
            with tempfile.TemporaryFile(dir=there):
                return
        if there != path:
            raise NotADirectoryError(errno.ENOTDIR, os.strerror(errno.ENOTDIR))
        with path.open("ab"):
            return
    except OSError as error:
        raise StartError(f"{path}: can't be written: {error.strerror}; {choose}") from None


@contextlib.contextmanager
def alone_in(folder: Path) -> Iterator[None]:
    """Make the folder where it is not there, and let no other command do the same until the block
    ends, or this process dies, whatever kills it; StartError where another one is in it."""
    with _locked(folder / _LOCK, folder):
        yield


@contextlib.contextmanager
def alone_at(path: Path) -> Iterator[None]:
    """As `alone_in`, of a file or a folder that need not be there: the lock is beside it."""
    with _locked(path.with_name(f".{path.name}{_LOCK}"), path):
        yield


@contextlib.contextmanager
def _locked(lock: Path, what: Path) -> Iterator[None]:
    lock.parent.mkdir(parents=True, exist_ok=True)
    # a stranger's folder may have a link or a FIFO there
    flags = os.O_WRONLY | os.O_CREAT | _NO_LINK
    try:
        descriptor = os.open(lock, flags, 0o666)
    except OSError as error:
        raise StartError(f"{lock}: can't be locked: {error.strerror}; {_ELSE}") from None
    try:
        if not locked(descriptor) and sys.platform != "win32":
            raise StartError(
                f"{what}: another swarm-ctl writes here now; {_ELSE}, or this command again when"
                " that one has ended"
            )
        yield
    finally:
        os.close(descriptor)
