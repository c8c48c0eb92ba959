"""`swarm-ctl zones`: a mission's zones and fence for other programs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from swarm_ctl.cli.shared.console import PlainConsole
from swarm_ctl.cli.shared.extras import require
from swarm_ctl.cli.shared.options import MissionFile
from swarm_ctl.cli.shared.writable import require_writable
from swarm_ctl.errors import InputError

zones = typer.Typer(name="zones", no_args_is_help=True, rich_markup_mode=None)


@zones.callback()
def top() -> None:
    """Write a mission's zones and fence for other programs.

    Example:

    \b
        swarm-ctl zones write missions/wood.yaml wood.geojson
    """


@zones.command()
def write(
    mission: MissionFile,
    out: Annotated[
        Path, typer.Argument(metavar="FILE", help="Ends in .geojson, .json, .kml or .plan.")
    ],
) -> None:
    """Write a mission's zones and fence as GeoJSON, KML or a plan of QGroundControl.

    A mission reads the file again with `zones: FILE`. A .plan has no heights.

    Examples:

    \b
        swarm-ctl zones write missions/wood.yaml wood.plan
        swarm-ctl zones write missions/wood.yaml wood.kml
    """
    require("ground", "swarm-ctl zones write")
    from swarm_ctl.mission.compile.loader import load
    from swarm_ctl.mission.input.zone_files import KINDS, areas_of, written
    from swarm_ctl.report.folder.files import write_whole

    kind = out.suffix.lower()
    if kind not in KINDS:
        raise InputError(f"{out}: ends in {kind or 'nothing'}; allowed: {', '.join(KINDS)}")
    console, plan = PlainConsole(), load(mission).plan
    require_writable(out, "choose another FILE")
    areas = areas_of(plan)
    write_whole(out, written(areas, kind, plan.origin))
    lost = kind == ".plan" and any(zone.floor_m or zone.ceiling_m for zone in plan.zones)
    console.say(f"{out}: {len(plan.zones)} zones{', without their heights' if lost else ''}")
