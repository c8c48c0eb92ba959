"""What the commands of `swarm-ctl trust` share: which folder and fleet, and how they print."""

from __future__ import annotations

import getpass
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Final

from rich.table import Table

from swarm_ctl.cli.shared.console import PlainConsole
from swarm_ctl.errors import InputError
from swarm_ctl.installed import require
from swarm_ctl.trust.names import LOOPBACK, KeyHolder, Role, swarm_named_after

if TYPE_CHECKING:
    from swarm_ctl.core.model.fleet import Fleet
    from swarm_ctl.trust.check import FleetNames, MemberReport, TrustReport
    from swarm_ctl.trust.provision import Terms

RESTART: Final = (
    "copy each bundle to its host, and there: swarm-ctl trust install; it takes effect when agents"
    " and stations start again, on the ground"
)


def fleet_of(path: Path) -> Fleet:
    """The fleet of a fleet file or a mission."""
    require("ground", "trust with --fleet")
    from swarm_ctl.doctor.examination import fleet_in

    return fleet_in(path)


def names_of(fleet: Fleet) -> FleetNames:
    """Its agents and routers, and their addresses on the mesh. A large fleet that names no router
    has one on the loopback interface, of `run`."""
    from swarm_ctl.core.swarm.hearing import SMALL_SWARM
    from swarm_ctl.trust.check import FleetNames

    routers = fleet.routers or (None,) * (len(fleet.agents) > SMALL_SWARM)
    return FleetNames({agent.id: agent.mesh for agent in fleet.agents}, routers)


def trust_folder(given: Path | None, fleet: Path | None) -> Path:
    """The folder that was given, else the fleet's, else the only one in `trust/`."""
    if given is not None:
        return given
    named = fleet_of(fleet).trust if fleet else None
    if named:
        return Path(named)
    found = sorted(path for path in ((fleet or Path()).parent / "trust").glob("[!.]*/"))
    if len(found) == 1:
        return found[0]
    what = f"several: {', '.join(map(str, found))}" if found else "no folder in trust/"
    raise InputError(f"which trust folder? {what}; allowed: name it, or trust new to make one")


def host_of(member: KeyHolder, fleet: Path | None) -> str:
    """The address that a member's certificate is for; InputError where the fleet has not got it."""
    if member.role in (Role.OPERATOR, Role.VIEWER):
        return LOOPBACK if member.role is Role.OPERATOR else ""
    if fleet is None:
        raise InputError(f"{member} needs its address on the mesh; allowed: with --fleet FILE")
    hosts = names_of(fleet_of(fleet)).hosts
    if member not in hosts:
        allowed = ", ".join(str(each) for each in hosts if each.role is member.role)
        raise InputError(f"{fleet}: has no {member}; allowed: {allowed or 'none'}")
    return hosts[member]


def terms(days: int, requests: Sequence[Path] | None = None) -> Terms:
    """What new certificates have in common."""
    from swarm_ctl.engine.clock import date_and_time
    from swarm_ctl.trust.provision import Terms, request_of

    return Terms(date_and_time(), days, dict(map(request_of, requests or ())))


def login() -> str:
    """The login name as an operator's."""
    return swarm_named_after(getpass.getuser())[:20].rstrip("-")


def show_roster(folder: Path) -> None:
    """What the roster says now, and the file for each host."""
    from swarm_ctl.trust.explain import day
    from swarm_ctl.trust.identity import CA, CA_FOLDER
    from swarm_ctl.trust.roster import read_roster

    roster = read_roster(folder, folder / CA_FOLDER / CA)
    table = _table("for its host")
    for each in roster.current:
        until = day(each.not_after).removesuffix(" UTC")
        row = (str(each.member), each.common_name, until, each.host)
        table.add_row(*row, f"{each.member.folder}.bundle")
    console = PlainConsole()
    console.say(f"{folder}: swarm {roster.swarm}, epoch {roster.epoch}", style="bold")
    console.print(table)


def show_report(report: TrustReport) -> None:
    """Print what `trust check` found."""
    console = PlainConsole()
    console.say(f"{report.folder}: swarm {report.swarm}, epoch {report.epoch}", style="bold")
    console.print(_members_table(report.members))
    _lines(console, report.attention, report.notes)
    for each in report.members:
        _lines(console, each.attention, each.notes, f"{each.member}: ")
    if not report.needs_attention:
        console.say("nothing needs attention", style="green")


def _members_table(members: Sequence[MemberReport]) -> Table:
    from swarm_ctl.trust.explain import day

    table = _table("MAVLink key")
    for each in members:
        until = day(each.not_after).removesuffix(" UTC") if each.not_after else ""
        row = (each.member, each.common_name, until, each.host)
        style = "bold red" if each.attention else None
        table.add_row(*row, "yes" if each.mavlink_key else "", style=style)
    return table


def _table(last: str) -> Table:
    """Of members, within 80 columns."""
    table = Table(box=None, pad_edge=False)
    for title in ("member", "common name", "until (UTC)", "address", last):
        table.add_column(title)
    return table


def _lines(
    console: PlainConsole, attention: Sequence[str], notes: Sequence[str], about: str = ""
) -> None:
    for text in attention:
        console.say(f"ATTENTION: {about}{text}", style="bold red")
    for text in notes:
        console.say(f"note: {about}{text}")


def say(*lines: str) -> None:
    """Print what to do next."""
    console = PlainConsole()
    for line in lines:
        console.say(line)
