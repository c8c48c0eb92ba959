"""What is shown of a swarm's hosts, and the exit code that says it to a CI."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Final

from rich.table import Table
from rich.text import Text

from swarm_ctl.cli.shared.console import PlainConsole

if TYPE_CHECKING:
    from swarm_ctl.deploy.report import HostReport
    from swarm_ctl.deploy.rollout import HostState

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
