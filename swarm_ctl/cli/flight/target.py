"""`swarm-ctl target`: brings a target from a receiver to the swarm that follows it."""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Callable
from contextlib import ExitStack, closing
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final

import typer

from swarm_ctl.cli.flight.agent import plan_and_fleet
from swarm_ctl.cli.shared.console import PlainConsole
from swarm_ctl.cli.shared.options import (
    FlownFleet,
    IdentityFolder,
    OpenMesh,
    RunName,
    SwarmElsewhereFile,
    ZenohConfig,
    option,
    switch,
    zenoh_settings,
)
from swarm_ctl.errors import InputError

if TYPE_CHECKING:
    from swarm_ctl.core.model.plan import Plan
    from swarm_ctl.engine.target.teller import Told
    from swarm_ctl.mesh.node import Node

_FROM: Final = (
    "nmea:ENDPOINT, gpsd:HOST:PORT, mavlink:ENDPOINT, or a .csv or .gpx file, which is played."
)
_QUIET_S: Final = 2.0
"""Without a word for longer, the line says why: the swarm says that the target is silent then."""
_LATE_S: Final = 0.2
_EVERY: Final = 10
"""Without a terminal, of so many looks one is a line."""
_ICAO: Final = "mavlink: the aircraft with this ICAO address, as an ADS-B receiver hears it."


def target(
    name: Annotated[str, typer.Argument(metavar="TARGET", help="One of the mission's targets.")],
    source: Annotated[str, option("SOURCE", _FROM, "--from")],
    run: RunName = None,
    mission: SwarmElsewhereFile = None,
    mesh: Annotated[
        list[str] | None,
        option("tcp/HOST:PORT", "With --mission: where an agent listens; repeat it for each."),
    ] = None,
    fleet: FlownFleet = None,
    late: Annotated[
        float | None,
        option(
            "S",
            "How old a position is when the receiver tells it.  [default: 0.2]",
            min=0.0,
            max=2.0,
        ),
    ] = None,
    system: Annotated[
        int | None,
        option("N", "mavlink: the system id of the vehicle.  [default: any]", min=0, max=255),
    ] = None,
    icao: Annotated[str, option("HEX", _ICAO)] = "",
    faster: Annotated[
        float | None,
        option("FACTOR", "A track is played so much faster.  [default: 1]", min=0.01, max=100.0),
    ] = None,
    identity: IdentityFolder = None,
    open_mesh: OpenMesh = False,
    zenoh_config: ZenohConfig = None,
    as_json: Annotated[bool, switch("--json", "A JSON line for each look; no display.")] = False,
) -> None:
    """Tell a swarm where the target is that its formation follows.

    From a receiver (NMEA 0183 by serial port, TCP or UDP), from gpsd, from a vehicle's MAVLink
    (GLOBAL_POSITION_INT, FOLLOW_TARGET, or ADSB_VEHICLE with --icao), or from a track that is
    played. ENDPOINT is serial:DEVICE:BAUD, tcp:HOST:PORT, tcpin:, udpin: or udpout:HOST:PORT. What
    is told is only what the source says anew: without a fix, the swarm is told nothing, and stands.
    A source that is gone is tried again. Where the swarm has keys, an operator's are needed.

    It ends with the run, with the track, or by Ctrl-C; the swarm then does as `on_lost` says.

    Exit codes: 0 ended, 2 bad input, 3 it can't be opened, or nothing was ever told.

    Examples:

    \b
        swarm-ctl target boat --from nmea:serial:/dev/ttyUSB0:9600
        swarm-ctl target boat --from nmea:tcp:10.0.0.7:10110
        swarm-ctl target boat --from gpsd:127.0.0.1:2947
        swarm-ctl target lead --from mavlink:udpin:127.0.0.1:14550 --system 7
        swarm-ctl target boat --from yesterday.gpx --faster 2
        swarm-ctl target boat --from track.csv --mission lake.yaml
    """
    from swarm_ctl.engine.interrupts import Interrupts
    from swarm_ctl.engine.target.teller import open_source, tell

    address = _address(icao)
    _check_source(source, late, system, icao, faster)
    if run is not None and mission is not None:
        raise InputError(f"both --run {run} and --mission {mission}; allowed: one of them")
    with ExitStack() as opened:
        news = open_source(
            name,
            source,
            late_s=_LATE_S if late is None else late,
            system=system or 0,
            icao=address,
            faster=faster or 1.0,
        )
        opened.callback(news.close)
        if mission is None:
            for option_name, value in {"--mesh": mesh, "--fleet": fleet}.items():
                if value:
                    raise InputError(f"{option_name} without --mission; allowed: with it")
            node, over = _in_run(opened, run, name, identity, open_mesh, zenoh_config)
        else:
            keys = identity, open_mesh, zenoh_config
            node, over = _in_swarm(opened, mission, fleet, mesh or [], name, keys)
        show: Callable[[Told], None] = _json_line if as_json else _display(opened)
        interrupts = opened.enter_context(Interrupts())
        told = tell(node, news, show, lambda: interrupts.count > 0 or over())
    if not as_json:
        PlainConsole().say(f"target {name}: {told.words} words were told")
    raise typer.Exit(0 if told.words else 3)


def _check_source(
    source: str, late: float | None, system: int | None, icao: str, faster: float | None
) -> None:
    """InputError for an option that this source would leave unread."""
    scheme = source.partition(":")[0]
    receiver = scheme in ("nmea", "gpsd", "mavlink")
    checks = (
        ("--late", late is not None, receiver, "a receiver (nmea, gpsd, mavlink)"),
        ("--system", system is not None, scheme == "mavlink", "mavlink:ENDPOINT"),
        ("--icao", bool(icao), scheme == "mavlink", "mavlink:ENDPOINT"),
        ("--faster", faster is not None, not receiver, "a .csv or .gpx track"),
    )
    for name, given, read, allowed in checks:
        if given and not read:
            raise InputError(f"{name} with --from {source}; allowed: with {allowed}")


def _address(icao: str) -> int:
    try:
        return int(icao, 16) if icao else 0
    except ValueError:
        raise InputError(f"--icao {icao}; allowed: six hexadecimal digits") from None


def _known(plan: Plan, name: str) -> None:
    """InputError for a target that the mission does not have."""
    from swarm_ctl.mission.input.near_matches import did_you_mean

    known = sorted(target.name for target in plan.targets)
    if name not in known:
        allowed = f"one of {', '.join(known)}" if known else "a mission with targets"
        hint = did_you_mean(name, known)
        raise InputError(f"{plan.name} has no target {name!r}{hint}; allowed: {allowed}")


def _in_run(
    opened: ExitStack,
    run: str | None,
    name: str,
    identity: Path | None,
    open_mesh: bool,
    zenoh_config: Path | None,
) -> tuple[Node, Callable[[], bool]]:
    """On the mesh of a run of this machine; and whether that is over."""
    from swarm_ctl.engine.flying_runs import ended, flying_run
    from swarm_ctl.engine.protection import operator_identity
    from swarm_ctl.engine.station.swarm_mesh import SwarmMesh
    from swarm_ctl.runfolder.manifest import read_manifest

    folder = flying_run(run)
    manifest = read_manifest(folder)
    _known(manifest.plan, name)
    if manifest.lockstep is not None:
        raise InputError(
            f"{folder} flies in lockstep, which has no pace; allowed: a run in real time, or a"
            " target with `along`"
        )
    guarded = open_mesh or manifest.guarded
    own = zenoh_settings(zenoh_config, guarded=guarded) if zenoh_config else None
    who = operator_identity(manifest.trust, identity or manifest.flown_by)
    node = SwarmMesh.of_run(manifest, who, own).open_node("target")
    opened.enter_context(closing(node))
    return node, lambda: bool(ended(folder, manifest))


def _in_swarm(
    opened: ExitStack,
    mission: Path,
    fleet: Path | None,
    mesh: list[str],
    name: str,
    keys: tuple[Path | None, bool, Path | None],
) -> tuple[Node, Callable[[], bool]]:
    """On the mesh of a swarm of other hosts, which does not say when it is over."""
    from swarm_ctl.engine.protection import Keys, operator_identity
    from swarm_ctl.engine.station.join import elsewhere

    identity, open_mesh, zenoh_config = keys
    plan, entries = plan_and_fleet(mission, fleet)
    _known(plan, name)
    own = zenoh_settings(zenoh_config, guarded=open_mesh or bool(identity or entries.trust))
    given = Keys(identity, open_mesh, str(fleet or mission), own)
    operator_identity(entries.trust, identity)  # a viewer's words would be dropped unseen
    node = elsewhere(plan, entries, mission, mesh, 1.0, given).open_node("target")
    opened.enter_context(closing(node))
    return node, lambda: False


def _json_line(told: Told) -> None:
    word = told.word
    line: dict[str, Any] = {
        "words": told.words,
        "silent_s": round(told.silent_s, 2),
        "bad": told.bad,
        "why": told.why,
        "agents": told.agents,
    }
    if word is not None:
        line |= {
            "target": word.name,
            "latitude_deg": word.latitude_deg,
            "longitude_deg": word.longitude_deg,
            "altitude_m": word.altitude_m,
            "velocity_ned_mps": word.velocity_ned_mps,
            "accuracy_m": word.accuracy_m,
            "age_s": word.age_s,
        }
    sys.stdout.write(json.dumps(line) + "\n")
    sys.stdout.flush()


def _display(opened: ExitStack) -> Callable[[Told], None]:
    """One line that stays in its place on a terminal; elsewhere one now and then."""
    from rich.console import Console
    from rich.live import Live
    from rich.text import Text

    if not sys.stdout.isatty():
        return _Lines()
    live = opened.enter_context(Live(console=Console(), auto_refresh=False))

    def show(told: Told) -> None:
        quiet = told.silent_s > _QUIET_S or not told.agents
        live.update(Text(_line(told), style="red" if quiet else ""), refresh=True)

    return show


class _Lines:
    """For a log: a line at first, now and then, and when what is told changes."""

    def __init__(self) -> None:
        self._count, self._before = 0, ("", False)

    def __call__(self, told: Told) -> None:
        now = told.why, told.silent_s > _QUIET_S
        if self._count % _EVERY == 0 or now != self._before:
            PlainConsole().say(_line(told))
        self._count, self._before = self._count + 1, now


def _line(told: Told) -> str:
    """`-35.36326, 149.16524, 3.0 m/s to 90 deg, 2.1 m; 25 words, the last 0.1 s ago`."""
    word = told.word
    parts = []
    if word is not None:
        parts.append(f"{word.latitude_deg:.6f}, {word.longitude_deg:.6f}")
        if word.velocity_ned_mps is not None:
            north, east, _ = word.velocity_ned_mps
            course = math.degrees(math.atan2(east, north)) % 360.0
            parts.append(f"{math.hypot(north, east):.1f} m/s to {course:.0f} deg")
        if word.altitude_m is not None:
            parts.append(f"{word.altitude_m:.1f} m high")
        parts.append(f"to {word.accuracy_m:.1f} m")
    told_of = f"{told.words} words, the last {told.silent_s:.1f} s ago"
    if word is None:
        told_of = f"nothing was told for {told.silent_s:.1f} s"
    heard = f"{told.agents or 'no'} agent{'s are' if told.agents > 1 else ' is'} heard"
    ends = [told_of, heard]
    if told.silent_s > _QUIET_S:
        ends.insert(0, told.why or "the source is silent")
    if told.bad:
        ends.append(f"{told.bad} could not be read")
    return "; ".join([", ".join(parts), *ends] if parts else ends)
