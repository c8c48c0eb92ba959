"""`swarm-ctl doctor`: what vehicles would do in trouble, and what this machine has."""

from __future__ import annotations

import dataclasses
import json
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final

import typer
from rich.table import Table

from swarm_ctl.cli.shared.console import PlainConsole
from swarm_ctl.cli.shared.options import AgentIdentity, OpenMesh, option, switch
from swarm_ctl.errors import InputError
from swarm_ctl.installed import require

if TYPE_CHECKING:
    from swarm_ctl.core.model.fleet import Fleet
    from swarm_ctl.doctor.examination import ParameterRow, VehicleReport
    from swarm_ctl.engine.link_keys import LinkKeys

_TICK_S: Final = 0.05
_FINE, _ATTENTION, _NOT_REACHED = 0, 1, 3


def doctor(
    fleet: Annotated[
        Path | None, option("FILE", "A fleet file, or a mission: its vehicles are asked.")
    ] = None,
    restore: Annotated[
        bool, switch("--restore", "Put remembered parameters back on disarmed vehicles.")
    ] = False,
    as_json: Annotated[bool, switch("--json", "JSON on stdout instead of text.")] = False,
    within: Annotated[
        float, option("SECONDS", "At most so long for all vehicles.", min=1.0, max=120.0)
    ] = 15.0,
    identity: AgentIdentity = None,
    open_mesh: OpenMesh = False,
) -> None:
    """Show what vehicles would do in trouble, or this machine's state.

    With --fleet it asks each vehicle for its failsafe parameters and says what they mean: as they
    are, and as agents set them for a flight. It arms nothing, and changes nothing without
    --restore.

    An agent that was killed leaves its values on the vehicle. The vehicle's own are remembered;
    the next flight puts them back at its end, --restore at once.

    Exit codes: 0 fine, 1 something needs attention, 2 bad input, 3 a vehicle was not reached.

    Examples:

    \b
        swarm-ctl doctor
        swarm-ctl doctor --fleet outdoors.yaml
        swarm-ctl doctor --fleet outdoors.yaml --restore
        swarm-ctl doctor --fleet outdoors.yaml --json | jq '.vehicles[].attention'
    """
    if fleet is not None:
        vehicles, keys = _vehicles(fleet, identity, is_open=open_mesh)
        raise typer.Exit(_fleet(vehicles, keys, within, restore=restore, as_json=as_json))
    if restore:
        raise InputError("--restore needs vehicles; allowed: with --fleet FILE")
    raise typer.Exit(_machine(as_json=as_json))


def _machine(*, as_json: bool) -> int:
    from swarm_ctl.cli.shared.machine import machine

    facts = machine()
    if as_json:
        _print_json({"machine": [dataclasses.asdict(fact) for fact in facts]})
    else:
        console = PlainConsole()
        for fact in facts:
            console.say(f"{fact.name}: {fact.state}", style="yellow" if fact.attention else None)
    return _ATTENTION if any(fact.attention for fact in facts) else _FINE


def _vehicles(fleet: Path, identity: Path | None, *, is_open: bool) -> tuple[Fleet, LinkKeys]:
    """The vehicles to ask, with an identity the vehicle of its agent alone, and their keys."""
    require("ground", "doctor --fleet")
    from swarm_ctl.doctor.examination import vehicles_of
    from swarm_ctl.engine.link_keys import LinkKeys
    from swarm_ctl.mission.fleet.exposure import exposed_links, refuse_exposed
    from swarm_ctl.trust.identity import load_identity

    vehicles = vehicles_of(fleet)
    keys = LinkKeys.of(vehicles, identity)
    if identity is not None:
        own = load_identity(identity).agent_id
        named = tuple(agent for agent in vehicles.agents if agent.id == own)
        if not named:
            ids = ", ".join(str(agent.id) for agent in vehicles.agents)
            raise InputError(
                f"--identity {identity}: is agent {own}, which {fleet} does not have;"
                f" allowed: that of {ids}"
            )
        vehicles = dataclasses.replace(vehicles, agents=named)
    if not is_open:
        exposed = exposed_links(dataclasses.replace(vehicles, signing=keys.rule))
        refuse_exposed(exposed, str(fleet), keys.trust)
    return vehicles, keys


def _fleet(
    vehicles: Fleet, keys: LinkKeys, within_s: float, *, restore: bool, as_json: bool
) -> int:
    from swarm_ctl.doctor.examination import examine
    from swarm_ctl.engine.clock import Clock
    from swarm_ctl.engine.ticker import Ticker
    from swarm_ctl.engine.vehicle_memory import VehicleMemory, state_folder

    memory, ticker = VehicleMemory(state_folder()), Ticker(Clock.starting_now(), _TICK_S)
    reports = examine(
        vehicles.agents, memory, ticker, within_s=within_s, restore=restore, keys=keys
    )
    if as_json:
        _print_json({"vehicles": [dataclasses.asdict(report) for report in reports]})
    else:
        console = PlainConsole()
        for report in reports:
            _show(console, report)
    if not all(report.reached for report in reports):
        return _NOT_REACHED
    return _ATTENTION if any(report.attention for report in reports) else _FINE


def _print_json(document: object) -> None:
    sys.stdout.write(json.dumps(document, indent=1) + "\n")


def _show(console: PlainConsole, report: VehicleReport) -> None:
    console.say(_headline(report), style="bold")
    for text in report.attention:
        console.say(f"  ATTENTION: {text}", style="bold red")
    for text in report.notes:
        console.say(f"  note: {text}")
    if report.restored:
        console.say(f"  has its own values again: {', '.join(report.restored)}", style="green")
    elif report.flight:
        console.say(f"  remembered since {report.flight}")
    if not report.reached:
        return
    console.print(_table(report.parameters))
    same = [text for text in report.now if text in report.in_flight]
    for title, texts in (
        ("what it would do", same),
        ("as it is", [text for text in report.now if text not in same]),
        ("while an agent flies it", [text for text in report.in_flight if text not in same]),
    ):
        if texts:
            console.say(f"  {title}:")
            for text in texts:
                console.say(f"    {text}")


def _headline(report: VehicleReport) -> str:
    about = f"agent {report.agent}: sysid {report.sysid} at {report.endpoint}, {report.autopilot}"
    if not report.reached:
        return f"{about}: not reached"
    state = "armed" if report.armed else "disarmed"
    return " ".join((about, report.firmware or "of unknown version")) + f", {report.mode}, {state}"


def _table(rows: tuple[ParameterRow, ...]) -> Table:
    table = Table(box=None, pad_edge=False)
    table.add_column("  parameter")
    for title in ("now", "in flight", "its own, remembered"):
        table.add_column(title, justify="right")
    for row in rows:
        style = "bold red" if row.left else None
        table.add_row(f"  {row.name}", *_cells(row), style=style)
    return table


def _cells(row: ParameterRow) -> Iterator[str]:
    yield "not there" if row.value is None else f"{row.value:g}"
    for value in (row.in_flight, row.remembered):
        yield "" if value is None else f"{value:g}"
