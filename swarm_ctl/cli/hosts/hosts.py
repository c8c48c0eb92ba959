"""`swarm-ctl hosts`: the computers of a swarm that was deployed."""

from __future__ import annotations

import contextlib
from pathlib import Path
from tempfile import TemporaryFile
from typing import TYPE_CHECKING, Annotated, Final

import typer

from swarm_ctl.cli.hosts.deploy import (
    ATTENTION,
    FINE,
    NOT_REACHED,
    SshConfig,
    common_plan,
    exit_code,
    show_hosts,
)
from swarm_ctl.cli.hosts.on_host import WITHIN
from swarm_ctl.cli.shared.console import PlainConsole
from swarm_ctl.cli.shared.options import option, switch
from swarm_ctl.errors import InputError
from swarm_ctl.installed import require

if TYPE_CHECKING:
    from swarm_ctl.deploy.rollout import Hosts

FleetArgument = Annotated[
    Path,
    typer.Argument(metavar="FLEET", help="A plan file, or a fleet file or mission (needs ground)."),
]
_PLAN: Final = (
    "The plan or mission that they should have.  [default: the one that most of them have]"
)


def status(
    fleet: FleetArgument,
    plan: Annotated[Path | None, option("PLAN", _PLAN)] = None,
    ssh_config: SshConfig = None,
) -> None:
    """Show each host: reached, version, plan, and how its agents stand.

    Exit codes: 0 fine, 1 something needs attention, 2 bad input, 3 a host was not reached.

    Examples:

    \b
        swarm-ctl hosts status outdoors.yaml
        swarm-ctl hosts status outdoors.yaml --plan plan.json
    """
    console, states = PlainConsole(), _hosts(fleet, ssh_config).report()
    wanted = common_plan(states)
    if plan is not None:
        wanted = dict.fromkeys(states, _whole_hash(plan, fleet))
    show_hosts(console, states, wanted)
    raise typer.Exit(exit_code(states, wanted))


def stop(
    fleet: FleetArgument,
    within: Annotated[float, option("SECONDS", "At most so long.", min=1.0)] = WITHIN,
    ssh_config: SshConfig = None,
) -> None:
    """Land all agents, wait for their end, then end the routers.

    It can't stop a host that it does not reach: swarm-ctl send land reaches such agents on the
    mesh.

    Exit codes: 0 none runs, 1 an agent still runs, 2 bad input, 3 a host was not reached.

    Example:

    \b
        swarm-ctl hosts stop outdoors.yaml
    """
    console, states = PlainConsole(), _hosts(fleet, ssh_config).stop(within)
    show_hosts(console, states, {})
    runs = any(state.running for state in states.values())
    gone = any(state.report is None for state in states.values())
    raise typer.Exit(NOT_REACHED if gone else ATTENTION if runs else FINE)


def collect(
    fleet: FleetArgument,
    out: Annotated[Path, option("FOLDER", "Where to; each host has a folder there.")] = Path(
        "collected"
    ),
    every: Annotated[bool, switch("--all", "Of all flights, not only the newest.")] = False,
    ssh_config: SshConfig = None,
) -> None:
    """Copy each host's logs, tlogs and last statuses here.

    Exit codes: 0 fine, 2 bad input, 3 a host was not reached, or sent something else.

    Examples:

    \b
        swarm-ctl hosts collect outdoors.yaml
        swarm-ctl hosts collect outdoors.yaml --all --out flights
    """
    from swarm_ctl.deploy.logs import unpack_logs
    from swarm_ctl.deploy.ssh import Reach

    console, there, whole = PlainConsole(), _hosts(fleet, ssh_config), True
    out.mkdir(parents=True, exist_ok=True)
    with contextlib.ExitStack() as open_files:
        tars = {h: open_files.enter_context(TemporaryFile(dir=out)) for h in there.names}
        for host, answer in there.logs(tars, every=every).items():
            why = f"{answer.reach}: {answer.words}"
            if answer.reach is Reach.ANSWERED:
                tars[host].seek(0)
                try:
                    files = unpack_logs(tars[host], out / host)
                except InputError as error:
                    why = str(error)
                else:
                    size = sum(path.stat().st_size for path in files)
                    console.say(f"{out / host}  {len(files)} files, {size / 1e6:.1f} MB")
                    continue
            whole = False
            console.say(f"{host}: {why}", style="bold red")
    raise typer.Exit(FINE if whole else NOT_REACHED)


def _whole_hash(plan: Path, fleet: Path) -> str:
    """Of a plan file; of a mission with the fleet that is asked about, where that is a file of its
    own."""
    from swarm_ctl.cli.flight.agent import plan_and_fleet
    from swarm_ctl.mission.compile.plan_file import is_plan_file, named_by_hash

    beside = None
    if not (is_plan_file(plan) or is_plan_file(fleet)):
        require("ground", f"{plan} is a mission file, which")
        from swarm_ctl.doctor.examination import is_mission

        beside = None if is_mission(fleet) else fleet
    return named_by_hash(*plan_and_fleet(plan, beside)).rpartition("@")[2]


def _hosts(fleet: Path, ssh_config: Path | None) -> Hosts:
    from swarm_ctl.deploy.rollout import Hosts
    from swarm_ctl.deploy.ssh import Ssh
    from swarm_ctl.mission.compile.plan_file import is_plan_file, read_plan

    if is_plan_file(fleet):
        names = dict.fromkeys(agent.host for agent in read_plan(fleet).fleet if agent.host)
    else:
        require("ground", f"{fleet} is a fleet file, which")
        from swarm_ctl.doctor.examination import vehicles_of

        names = dict.fromkeys(vehicles_of(fleet).hosts())
    if not names:
        raise InputError(f"{fleet}: names no `host`; allowed: one for each agent")
    return Hosts(Ssh(ssh_config), names)


hosts = typer.Typer(
    name="hosts",
    no_args_is_help=True,
    rich_markup_mode=None,
    help="Look after the computers of a deployed swarm.\n\n"
    "Try: swarm-ctl hosts status outdoors.yaml",
)
for function in (status, stop, collect):
    hosts.command()(function)
