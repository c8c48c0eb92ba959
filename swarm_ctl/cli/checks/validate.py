"""`swarm-ctl validate`: check a mission and show what would be flown."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from rich.table import Table

from swarm_ctl.cli.shared.console import PlainConsole
from swarm_ctl.cli.shared.options import FleetFile, MissionFile, VehicleKinds, option, switch
from swarm_ctl.cli.shared.writable import require_writable

if TYPE_CHECKING:
    from swarm_ctl.mission.compile.forecast import StepForecast
    from swarm_ctl.mission.compile.loader import LoadedMission


def validate(
    mission: MissionFile,
    fleet: FleetFile = None,
    vehicles: VehicleKinds = None,
    full: Annotated[
        bool, switch("--full", "All agents and links, however many there are.")
    ] = False,
    plot: Annotated[Path | None, option("FILE", "Draw it into a .png, .svg or .pdf.")] = None,
) -> None:
    """Check a mission file and show what would be flown.

    Shows agents, slots, steps with their expected times, graph, smallest distances, limits and
    warnings. A mission with mistakes is refused with all of them, and one in
    which the forecast has a pair under r_in.

    Examples:

    \b
        swarm-ctl validate missions/hexagon.yaml
        swarm-ctl validate missions/thirtytwo.yaml --full --plot thirtytwo.png
    """
    from swarm_ctl.mission.compile.forecast import forecast, refuse_too_close
    from swarm_ctl.mission.compile.loader import load

    console = PlainConsole()
    loaded = load(mission, fleet=fleet, vehicles=vehicles)
    kinds = {agent.autopilot for agent in loaded.fleet.agents}
    forecasts = forecast(loaded.plan, kinds)
    refuse_too_close(loaded, forecasts)
    show(console, loaded, forecasts, full=full)
    if plot is not None:
        from swarm_ctl.report.page.mission_plot import plot as draw

        require_writable(plot, "choose with --plot")
        draw(loaded.plan, plot)
        console.say(f"picture  {plot}")


def show(
    console: PlainConsole, loaded: LoadedMission, forecasts: Sequence[StepForecast], *, full: bool
) -> None:
    """Print a checked mission."""
    from swarm_ctl.report.page.mission_table import mission_parts

    for part in mission_parts(loaded, forecasts, full=full):
        console.print(part, soft_wrap=not isinstance(part, Table))
