"""`swarm-ctl zones`: a mission's zones and fence for other programs, and for vehicles."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from swarm_ctl.cli.shared.console import PlainConsole
from swarm_ctl.cli.shared.options import MissionFile, option, require_writable
from swarm_ctl.errors import InputError
from swarm_ctl.installed import require

if TYPE_CHECKING:
    from swarm_ctl.mavlink.fence_items import FenceItem

zones = typer.Typer(name="zones", no_args_is_help=True, rich_markup_mode=None)


@zones.callback()
def top() -> None:
    """Bring a mission's zones to other programs and vehicles.

    Example:

    \b
        swarm-ctl zones write missions/wood.yaml wood.geojson
        swarm-ctl zones push missions/wood.yaml --fleet outdoors.yaml
    """


@zones.command()
def write(
    mission: MissionFile,
    out: Annotated[
        Path, typer.Argument(metavar="FILE", help="Ends in .geojson, .json, .kml or .plan.")
    ],
) -> None:
    """Write a mission's zones and fence as GeoJSON, KML or a plan of QGroundControl.

    A mission reads the file again with `zones: FILE`. None of them has the fence's height, and a
    .plan has no names, floors, ceilings and clearances; what is not in the file is told.

    Examples:

    \b
        swarm-ctl zones write missions/wood.yaml wood.plan
        swarm-ctl zones write missions/wood.yaml wood.kml
    """
    require("ground", "swarm-ctl zones write")
    from swarm_ctl.mission.compile.loader import load
    from swarm_ctl.mission.input.zone_files import KINDS
    from swarm_ctl.mission.input.zone_writing import areas_of, lost_in, written
    from swarm_ctl.runfolder.files import write_whole

    kind = out.suffix.lower()
    if kind not in KINDS:
        raise InputError(f"{out}: ends in {kind or 'nothing'}; allowed: {', '.join(KINDS)}")
    console, plan = PlainConsole(), load(mission).plan
    require_writable(out, "choose another FILE")
    areas = areas_of(plan)
    write_whole(out, written(areas, kind, plan.origin))
    count = len(plan.zones)
    zones_said = f"{count} zone{'' if count == 1 else 's'} and the fence"
    console.say(f"{out}: {zones_said}; not in it: {', '.join(lost_in(plan, kind))}")


_Fleet = Annotated[Path | None, option("FILE", "A fleet file, or a mission.")]


@zones.command()
def push(mission: MissionFile, fleet: _Fleet = None) -> None:
    """Send a mission's fence and zones to the vehicles, as their own fence.

    It is the last line: whether and how an autopilot acts on it is set there (FENCE_ENABLE,
    FENCE_TYPE, FENCE_ACTION; GF_ACTION). Vehicles must be disarmed. Zones with a floor or a ceiling
    are left out, as an autopilot's fence has no heights. What a vehicle then has is read back.

    Exit codes: 0 all have it, 1 a vehicle does not, 2 bad input, 3 no link.

    Example:

    \b
        swarm-ctl zones push missions/wood.yaml --fleet outdoors.yaml
    """
    require("ground", "swarm-ctl zones push")
    from swarm_ctl.mavlink.fence_items import items_of
    from swarm_ctl.mission.compile.loader import load

    items, left = items_of(load(mission, fleet=fleet).plan)
    if left:
        names = ", ".join(left)
        PlainConsole().say(f"left out, because an autopilot's fence has no heights: {names}")
    _with_each(fleet or mission, items)


@zones.command()
def clear(fleet: Annotated[Path, option("FILE", "A fleet file, or a mission.")]) -> None:
    """Take the vehicles' own fences off. Vehicles must be disarmed.

    Example:

    \b
        swarm-ctl zones clear --fleet outdoors.yaml
    """
    _with_each(fleet, ())


@zones.command()
def show(fleet: Annotated[Path, option("FILE", "A fleet file, or a mission.")]) -> None:
    """Show the fences that the vehicles have.

    Example:

    \b
        swarm-ctl zones show --fleet outdoors.yaml
    """
    _with_each(fleet, None)


def _with_each(fleet: Path, items: Sequence[FenceItem] | None) -> None:
    """Each vehicle of a fleet in turn."""
    from swarm_ctl.cli.security.trust import fleet_of
    from swarm_ctl.engine.link_keys import LinkKeys
    from swarm_ctl.engine.vehicle_key import transferred

    found, console, troubled = fleet_of(fleet), PlainConsole(), False
    absent = [str(entry.id) for entry in found.agents if entry.endpoint is None]
    if absent:
        raise InputError(
            f"{fleet}: agent {', '.join(absent)} has no endpoint: `run` starts its vehicle;"
            " allowed: a fleet whose agents name the endpoints of their vehicles"
        )
    vehicles = dict[int, int]()
    for entry in found.agents:
        first = vehicles.setdefault(entry.sysid, entry.id)
        if first != entry.id:
            raise InputError(
                f"{fleet}: agents {first} and {entry.id} both have sysid {entry.sysid};"
                " allowed: a sysid of its own for every vehicle"
            )
    for entry in found.agents:
        report = transferred(entry.endpoint or "", entry.sysid, items, entry.id, LinkKeys.of(found))
        console.say(report.trouble or f"vehicle {entry.sysid}: {report.words}")
        troubled = troubled or bool(report.trouble)
    raise typer.Exit(1 if troubled else 0)
