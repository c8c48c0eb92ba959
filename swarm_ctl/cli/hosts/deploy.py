"""`swarm-ctl deploy`: a swarm on the computers of its drones."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final

import typer
from rich.table import Table
from rich.text import Text

from swarm_ctl.cli.flight.agent import EXPECT_STATION, plan_and_fleet
from swarm_ctl.cli.hosts.on_host import WITHIN
from swarm_ctl.cli.shared.console import PlainConsole
from swarm_ctl.cli.shared.options import FleetFile, OpenMesh, option, switch

if TYPE_CHECKING:
    from swarm_ctl.core.model.fleet import Fleet
    from swarm_ctl.deploy.bundle import Bundle
    from swarm_ctl.deploy.report import HostReport
    from swarm_ctl.deploy.rollout import Hosts, HostState
    from swarm_ctl.mission.compile.loader import LoadedMission


_WAIT: Final = "How long to wait for hosts that are offline."
_RESTART: Final = "Agents that run are landed first, on all hosts; then all start."
_BUNDLES: Final = "Write each host's bundle there instead (HOST.tar), for a stick. They hold keys."
SshConfig = Annotated[
    Path | None, option("FILE", "For ssh, instead of ~/.ssh/config.", "--ssh-config")
]


def deploy(
    file: Annotated[
        Path, typer.Argument(metavar="PLAN", help="A plan file, or a mission file (needs ground).")
    ],
    fleet: FleetFile = None,
    wait: Annotated[float, option("SECONDS", _WAIT, min=0.0)] = 60.0,
    restart: Annotated[bool, switch("--restart", _RESTART)] = False,
    no_start: Annotated[bool, switch("--no-start", "Copy and check; start nothing.")] = False,
    bundles: Annotated[Path | None, option("FOLDER", _BUNDLES)] = None,
    expect_station: Annotated[bool, switch("--expect-station", EXPECT_STATION)] = False,
    open_mesh: OpenMesh = False,
    ssh_config: SshConfig = None,
) -> None:
    """Copy plan and keys to all hosts over SSH, and start the agents.

    Each agent has `host` in the fleet, and swarm-ctl of this version runs there. When every host
    has its bundle, all agents start: the swarm then takes off by itself, as after `run`. While a
    host is missing, none starts. The same command again changes what differs, and says what.

    Exit codes: 0 all run, 1 something needs attention, 2 bad input, 3 a host was not reached.

    Examples:

    \b
        swarm-ctl deploy square.yaml --fleet outdoors.yaml --no-start
        swarm-ctl deploy square.yaml --fleet outdoors.yaml
        swarm-ctl deploy square.yaml --fleet outdoors.yaml --restart
        swarm-ctl deploy plan.json --bundles /media/stick
    """
    from swarm_ctl.deploy.bundle import bundles_of
    from swarm_ctl.deploy.rollout import Hosts, parted
    from swarm_ctl.deploy.ssh import Ssh
    from swarm_ctl.mission.compile.plan_file import named_by_hash
    from swarm_ctl.mission.fleet.exposure import exposures, refuse_exposed

    console = PlainConsole()
    plan, entries = plan_and_fleet(file, fleet, look=lambda mission: _look(console, mission))
    if not open_mesh:
        refuse_exposed(exposures(entries), str(fleet or file), entries.trust)
    made = bundles_of(plan, entries, open_mesh=open_mesh, expect_station=expect_station)
    console.say(f"{named_by_hash(plan, entries)}: {_who(entries)}")
    if bundles is not None:
        _write(console, made, bundles)
        raise typer.Exit(FINE)
    hosts = Hosts(Ssh(ssh_config), made)
    states = hosts.bring(made, wait, lambda h, words: console.say(f"{h}: {words}"), restart=restart)
    unfit = [host for host, state in states.items() if state.words]
    if unfit:
        console.say(f"nothing was started: {', '.join(unfit)}", style="bold red")
        gone = any(state.report is None for state in states.values())
        raise typer.Exit(NOT_REACHED if gone else ATTENTION)
    if no_start:
        console.say("each host has its bundle; the same command without --no-start starts it")
        raise typer.Exit(FINE)
    why = "" if restart else parted(states, made)
    if why:
        console.say(f"nothing was started: {why}", style="bold red")
        raise typer.Exit(ATTENTION)
    if restart:
        states = _landed(console, hosts)
    raise typer.Exit(_started(console, hosts, made, states))


def _landed(console: PlainConsole, hosts: Hosts) -> dict[str, HostState]:
    """Land what runs; Exit where an agent may still be in the air."""
    console.say("agents that run are landed first")
    states = hosts.stop(WITHIN)
    failed = {host: state.words for host, state in states.items() if state.words}
    for host, words in failed.items():
        console.say(f"{host}: {words}", style="bold red")
    if failed:
        console.say(f"nothing was started: {', '.join(failed)}", style="bold red")
        raise typer.Exit(ATTENTION)
    return states


def _started(
    console: PlainConsole, hosts: Hosts, made: Mapping[str, Bundle], before: Mapping[str, HostState]
) -> int:
    """Start all, and show how they stand; the exit code."""
    states = hosts.start(made)
    for host, state in states.items():
        was = before[host].report
        ran = was.running if was and was.current == made[host].digest else ()
        for name in state.report.running if state.report else ():
            console.say(f"{host}: {name} {'runs already' if name in ran else 'started'}")
    wanted = {host: bundle.manifest.whole_hash for host, bundle in made.items()}
    show_hosts(console, states, wanted)
    return exit_code(states, wanted)


def _who(fleet: Fleet) -> str:
    hosts = fleet.hosts()
    agents = "agent" if len(fleet.agents) == 1 else "agents"
    return f"{len(fleet.agents)} {agents} on {len(hosts)} host{'s' * (len(hosts) != 1)}"


def _look(console: PlainConsole, mission: LoadedMission) -> None:
    """What `plan` says of a mission, it says here, too."""
    from swarm_ctl.mission.compile.forecast import forecast, refuse_too_close

    console.warn(mission.warnings)
    refuse_too_close(mission, forecast(mission.plan))


def _write(console: PlainConsole, made: Mapping[str, Bundle], folder: Path) -> None:
    from swarm_ctl.trust.files import write_private

    folder.mkdir(parents=True, exist_ok=True)
    for host, bundle in made.items():
        path = folder / f"{host}.tar"
        write_private(path, bundle.packed())
        console.say(
            f"{path}  there: swarm-ctl on-host install {path.name}; swarm-ctl on-host start"
        )


FINE, ATTENTION, NOT_REACHED = 0, 1, 3
_STYLES: Final = {"running": "green", "failed": "bold red", "ended": "", "stopped": "yellow"}


def show_hosts(
    console: PlainConsole, states: Mapping[str, HostState], wanted: Mapping[str, str]
) -> None:
    """Print a table: how each host stands, and the plan it has beside the wanted one (by host)."""
    table = Table(box=None, pad_edge=False)
    for title in ("host", "swarm-ctl", "plan", "processes"):
        table.add_column(title, overflow="fold")
    for host, state in states.items():
        report = state.report
        if report is None:
            table.add_row(host, "", "", Text(f"{state.reach}: {state.words}", "bold red"))
        else:
            plan = _plan(report, wanted.get(host, ""))
            table.add_row(host, report.version, plan, _processes(report))
    console.print(table)
    for host, state in states.items():
        for each in state.report.services if state.report else ():
            if each.said:
                console.say(f"{host}: {each.name}: {each.said}")
        for what in _attention(state, wanted.get(host, "")):
            console.say(f"{host}: {what}", style="bold red")


def exit_code(states: Mapping[str, HostState], wanted: Mapping[str, str]) -> int:
    """Of a command that has found the hosts so: 3 one was not reached, 1 one needs attention."""
    if any(state.report is None for state in states.values()):
        return NOT_REACHED
    fine = all(_fine(state, wanted.get(host, "")) for host, state in states.items())
    return FINE if fine else ATTENTION


def common_plan(states: Mapping[str, HostState]) -> dict[str, str]:
    """For each host the plan, with fleet and signing, that most have: another one is then seen."""
    found = [s.report.whole_hash for s in states.values() if s.report and s.report.whole_hash]
    most = Counter(found).most_common(1)
    return dict.fromkeys(states, most[0][0]) if most else {}


def _fine(state: HostState, wanted: str) -> bool:
    report = state.report
    if report is None or state.words or report.attention or report.whole_hash != wanted:
        return False
    return not any(each.state == "failed" for each in report.services)


def _plan(report: HostReport, wanted: str) -> Text:
    if not report.whole_hash:
        return Text("none yet", "yellow")
    return Text(report.whole_hash, "bold red" if wanted not in ("", report.whole_hash) else "")


def _attention(state: HostState, wanted: str) -> Iterator[str]:
    report = state.report
    if report is None:
        return
    if report.whole_hash and wanted not in ("", report.whole_hash):
        yield (
            f"has plan {report.whole_hash}, not {wanted}: its plan, fleet or signing differs;"
            " swarm-ctl deploy brings the one that you name"
        )
    yield from dict.fromkeys((*filter(None, [state.words]), *report.attention))


def _processes(report: HostReport) -> Text:
    return Text(", ").join(
        Text(f"{each.name} {each.state}", _STYLES[each.state]) for each in report.services
    )
