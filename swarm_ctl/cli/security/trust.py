"""`swarm-ctl trust`: who takes part in a swarm, and the keys that prove it."""

from __future__ import annotations

import dataclasses
import getpass
import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final

import typer
from rich.table import Table

from swarm_ctl.cli.shared.console import PlainConsole
from swarm_ctl.cli.shared.options import endpoint_option, option, switch
from swarm_ctl.engine.system import lacks, refuse_without
from swarm_ctl.errors import InputError, TrustError
from swarm_ctl.installed import require
from swarm_ctl.trust.names import LOOPBACK, KeyHolder, Role, swarm_named_after

if TYPE_CHECKING:
    from swarm_ctl.core.model.fleet import Fleet
    from swarm_ctl.mavlink.key_setup import KeyReport
    from swarm_ctl.trust.check import FleetNames, MemberReport, TrustReport
    from swarm_ctl.trust.provision import Terms


_FINE, _ATTENTION = 0, 1

_FLEET: Final = "A fleet file, or a mission: agents, routers, and their addresses on the mesh."
_FOLDER: Final = "The trust folder.  [default: the fleet's, or the only one in trust/]"
_REQUEST: Final = "A request of a host that keeps its private key (trust request); again for more."
FleetOption = Annotated[Path | None, option("FILE", _FLEET)]
FolderOption = Annotated[Path | None, option("FOLDER", _FOLDER)]
_DAYS: Final = "How long certificates are valid. On their last day no vehicle takes off."
Days = Annotated[int, option("DAYS", _DAYS, min=2, max=366)]
Requests = Annotated[list[Path] | None, option("FILE", _REQUEST, "--csr")]
_ROLE: Final = "agent, operator, viewer or router."
RoleName = Annotated[Role, typer.Argument(metavar="ROLE", help=_ROLE)]
_NAME: Final = "The agent's id, the router's number in the fleet, or a name."
Name = Annotated[str, typer.Argument(metavar="NAME", help=_NAME)]


def new(
    fleet: Annotated[Path, option("FILE", _FLEET)],
    swarm: Annotated[str | None, option("NAME", "The swarm's name.  [default: the file's]")] = None,
    folder: Annotated[
        Path | None, option("FOLDER", "Where to.  [default: the fleet's, or trust/SWARM beside it]")
    ] = None,
    operator: Annotated[
        list[str] | None, option("NAME", "An operator; again for more.  [default: your login name]")
    ] = None,
    viewer: Annotated[
        list[str] | None, option("NAME", "Sees all, commands nothing; again for more.")
    ] = None,
    days: Days = 30,
    csr: Requests = None,
) -> None:
    """Make the keys of a new swarm.

    A CA, certificates for every agent, an operator, and in a large swarm a router for each host; a
    MAVLink key for each vehicle.

    One file (agent-3.bundle) then goes to each host. With --csr a host's private key never leaves
    it. The folder is yours alone (0700); keep its ca/ off the drones.

    Examples:

    \b
        swarm-ctl trust new --fleet outdoors.yaml
        swarm-ctl trust new --fleet outdoors.yaml --operator anna --days 7
        swarm-ctl trust new --fleet outdoors.yaml --csr agent-3.csr
    """
    from swarm_ctl.trust import provision

    require("trust", "trust new")
    read = fleet_of(fleet)
    name = swarm_named_after(fleet.stem) if swarm is None else swarm
    to = folder or (Path(read.trust) if read.trust else fleet.parent / "trust" / name)
    hosts = names_of(read).hosts
    agents = {int(each.name): host for each, host in hosts.items() if each.role is Role.AGENT}
    routers = [host for each, host in hosts.items() if each.role is Role.ROUTER]
    operators = operator or [login()]
    provision.new(to, name, agents, operators, viewer or [], terms(days, csr), routers)
    show_roster(to)
    if not read.trust:
        named = to.resolve() if folder else f"trust/{name}"
        say(f"to do: write `trust: {named}` in {fleet}; without it the swarm flies without keys")
    say(
        f"copy each bundle to its host (scp {to}/agent-1.bundle HOST:), and there:"
        " swarm-ctl trust install agent-1.bundle",
        f"then: swarm-ctl trust check --fleet {fleet}",
    )


def add(
    role: RoleName,
    name: Name,
    fleet: FleetOption = None,
    folder: FolderOption = None,
    days: Days = 30,
    csr: Annotated[
        Path | None, option("FILE", "A request of its own host (trust request).")
    ] = None,
) -> None:
    """Add an agent, an operator, a viewer or a router.

    All hosts need their bundle again: it has the new roster. Members hear only those
    that are in their roster.

    Examples:

    \b
        swarm-ctl trust add operator anna
        swarm-ctl trust add viewer tv --days 7
        swarm-ctl trust add agent 7 --fleet outdoors.yaml
        swarm-ctl trust add agent 7 --fleet outdoors.yaml --csr agent-7.csr
    """
    from swarm_ctl.trust import provision

    require("trust", "trust add")
    member = KeyHolder(role, name)
    where = trust_folder(folder, fleet)
    given = terms(days, [csr] if csr else None)
    if set(given.requests) - {member}:
        raise TrustError(
            f"{csr}: asks for {', '.join(map(str, given.requests))}; allowed: {member}"
        )
    provision.add(where, member, host_of(member, fleet), given)
    show_roster(where)
    say(RESTART)


def request(
    role: RoleName,
    name: Name,
    folder: Annotated[Path, option("FOLDER", "This host's trust folder, such as trust/outdoors.")],
) -> None:
    """On a host: make its private key, and a request (CSR) for the CA.

    The key stays here; NAME.csr goes to the computer with the CA, and a bundle without a key comes
    back.

    Example:

    \b
        host$    swarm-ctl trust request agent 3 --folder trust/outdoors
        ground$  swarm-ctl trust add agent 3 --fleet outdoors.yaml --csr agent-3.csr
        host$    swarm-ctl trust install agent-3.bundle --folder trust/outdoors
    """
    from swarm_ctl.trust import provision
    from swarm_ctl.trust.files import write_private

    require("trust", "trust request")
    member = KeyHolder(role, name)
    out = Path(f"{member.folder}.csr")
    write_private(out, provision.request(folder, member))
    say(
        f"{folder / member.folder}/mesh.key  the private key, which stays here",
        f"{out}  goes to the computer with the CA: swarm-ctl trust add {member} --csr {out}",
    )


def install(
    bundle: Annotated[Path, typer.Argument(metavar="BUNDLE", help="Such as agent-3.bundle.")],
    folder: Annotated[
        Path | None, option("FOLDER", "This host's trust folder.  [default: trust/SWARM]")
    ] = None,
) -> None:
    """On a host: unpack its bundle.

    Its first one, or the newer one that add, revoke or rotate has made. A bundle that does not fit
    this host changes nothing.

    Examples:

    \b
        swarm-ctl trust install agent-3.bundle
        swarm-ctl trust install agent-3.bundle --folder /etc/swarm_ctl/outdoors
    """
    from swarm_ctl.trust import bundle as bundles
    from swarm_ctl.trust.explain import day

    installed = bundles.install(bundle, folder)
    ends = day(installed.certificate.not_after)
    say(
        f"{installed.folder}  {installed.common_name}, until {ends}",
        f"it takes effect when {installed.member} starts; now delete {bundle}: it holds keys",
    )


def check(
    folder: Annotated[
        Path | None, typer.Argument(metavar="FOLDER", help=_FOLDER, show_default=False)
    ] = None,
    fleet: FleetOption = None,
    as_json: Annotated[bool, switch("--json", "JSON on stdout instead of text.")] = False,
) -> None:
    """Find what would keep a swarm from flying with its keys.

    Dates, names, key pairs, file modes, the roster's signature, MAVLink keys, and the clock; with
    --fleet the addresses, and a handshake with each agent that listens. On the ground's folder, or
    a host's.

    Exit codes: 0 fine, 1 something needs attention, 2 bad input.

    Examples:

    \b
        swarm-ctl trust check
        swarm-ctl trust check --fleet outdoors.yaml
        swarm-ctl trust check trust/outdoors --json | jq '.attention'
    """
    from swarm_ctl.engine.clock import date_and_time
    from swarm_ctl.trust import check as checks

    names = names_of(fleet_of(fleet)) if fleet else None
    report = checks.check(trust_folder(folder, fleet), date_and_time(), names)
    if as_json:
        sys.stdout.write(json.dumps(dataclasses.asdict(report), indent=1, default=str) + "\n")
    else:
        show_report(report)
    raise typer.Exit(_ATTENTION if report.needs_attention else _FINE)


def revoke(
    role: RoleName,
    name: Name,
    fleet: FleetOption = None,
    folder: FolderOption = None,
    days: Days = 30,
) -> None:
    """Take a member out of the swarm.

    A new epoch: all others get new certificates, and need their bundle again. It takes effect when
    they start, on the ground. In flight: swarm-ctl send expel 3.

    Examples:

    \b
        swarm-ctl trust revoke agent 3
        swarm-ctl trust revoke operator anna
    """
    from swarm_ctl.trust import provision

    require("trust", "trust revoke")
    where = trust_folder(folder, fleet)
    revoked = KeyHolder(role, name)
    provision.revoke(where, revoked, terms(days))
    show_roster(where)
    say(f"{revoked} is revoked: all others ignore it once they have their new bundles", RESTART)


def rotate(fleet: FleetOption = None, folder: FolderOption = None, days: Days = 30) -> None:
    """Give all members new certificates, in a new epoch.

    With --fleet, certificates name the addresses in that file.

    All hosts need their bundle again. MAVLink keys stay: they are in the vehicles.

    Examples:

    \b
        swarm-ctl trust rotate
        swarm-ctl trust rotate --fleet outdoors.yaml --days 7
    """
    from swarm_ctl.trust import provision

    require("trust", "trust rotate")
    where = trust_folder(folder, fleet)
    hosts = names_of(fleet_of(fleet)).hosts if fleet else None
    provision.rotate(where, terms(days), hosts)
    show_roster(where)
    say(RESTART)


def vehicle(
    agent: Annotated[int, option("ID", "The agent whose vehicle it is.", "--id")],
    endpoint: Annotated[
        str | None,
        endpoint_option("Where it is, e.g. serial:/dev/ttyACM0.  [default: as in the fleet]"),
    ] = None,
    fleet: Annotated[Path | None, option("FILE", "A fleet file, or a mission.")] = None,
    folder: Annotated[
        Path | None, option("FOLDER", "The trust folder.  [default: the fleet's, or the only one]")
    ] = None,
    sysid: Annotated[
        int | None, option("SYSID", "Its system id.  [default: the fleet's, or the agent's id]")
    ] = None,
    clear: Annotated[bool, switch("--clear", "Take the key off again.")] = False,
    over_network: Annotated[
        bool, switch("--over-network", "Send the key over a network, readable to all there.")
    ] = False,
) -> None:
    """Give a vehicle its MAVLink signing key, on the bench.

    It then checks that the vehicle takes no frame that is not signed with it. The key goes over the
    link as it is: use USB, or another cable. The vehicle must be disarmed. An ArduPilot takes
    unsigned frames on its first port, USB, all the same: connect the agent to another one.

    Exit codes: 0 set up, 1 the vehicle did not do it, 2 bad input, 3 no link.

    Examples:

    \b
        swarm-ctl trust vehicle --id 3 --endpoint serial:/dev/ttyACM0
        swarm-ctl trust vehicle --id 3 --fleet outdoors.yaml
        swarm-ctl trust vehicle --id 3 --endpoint serial:/dev/ttyACM0 --clear
    """
    from swarm_ctl.engine.vehicle_key import refuse_network, set_up

    entries = fleet_of(fleet).agents if fleet else ()
    entry = next((each for each in entries if each.id == agent), None)
    if fleet and entry is None:
        raise InputError(f"--id {agent}: {fleet} has {[each.id for each in entries]}")
    where = endpoint or (entry.endpoint if entry else None)
    if where is None:
        raise InputError(f"vehicle {agent} has no endpoint; allowed: --endpoint URL")
    if not over_network:
        refuse_network(where)
    number = sysid or (entry.sysid if entry else agent)
    keys = trust_folder(folder, fleet) / KeyHolder(Role.AGENT, str(agent)).folder
    report = set_up(where, number, keys, clear=clear)
    _show(report, number, clear=clear)
    raise typer.Exit(1 if report.trouble or (report.px4 and report.takes_unsigned) else 0)


def _show(report: KeyReport, sysid: int, *, clear: bool) -> None:
    if report.trouble:
        say(report.trouble)
    elif clear:
        say(f"vehicle {sysid}: {report.signs}, and takes frames of all")
    else:
        say(f"vehicle {sysid}: {report.signs}, and answers frames that are signed with it")
    if report.takes_unsigned:
        say(
            "on this port it takes unsigned frames, too, as an ArduPilot does on its first one"
            " (SERIAL0, USB): give the agent another port"
        )
    elif not clear and not report.trouble:
        say("an unsigned frame was ignored")


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
        table.add_column(title, overflow="fold")
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


trust = typer.Typer(name="trust", no_args_is_help=True, rich_markup_mode=None)


@trust.callback()
def keys_of_a_swarm() -> None:
    """Make, copy, check and revoke the keys of a swarm.

    Try: swarm-ctl trust new --help
    """
    refuse_without(lacks(), "swarm-ctl trust", "Linux or macOS")


for function in (new, add, request, install, check, vehicle, revoke, rotate):
    trust.command()(function)
