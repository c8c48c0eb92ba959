"""What `run` and a station that judges say at the end of a flight."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Final, TextIO

from swarm_ctl.cli.shared.console import PlainConsole
from swarm_ctl.core.model.messages import Outcome

if TYPE_CHECKING:
    from swarm_ctl.engine.interrupts import Interrupts
    from swarm_ctl.report.judge.summary import Summary

_POLL_WALL_S: Final = 0.02


def show_summary(
    console: PlainConsole,
    folder: Path,
    summary: Summary,
    report_to: TextIO | None,
    interrupts: Interrupts,
) -> None:
    """Print the summary, and make the report; None: no report. A further Ctrl-C makes none."""
    from swarm_ctl.engine.clock import pause
    from swarm_ctl.report.page.summary_table import brief
    from swarm_ctl.signals import deaf_children

    console.print(brief(summary), soft_wrap=not console.is_terminal)  # a file's lines are whole
    if report_to is None:
        console.say(f"run folder: {folder}")
        return
    # in a process of its own: whatever happens to the figures, the run's result stands
    command = [sys.executable, "-m", "swarm_ctl.cli.main", "report", str(folder)]
    presses = interrupts.presses
    with deaf_children():
        making = subprocess.Popen(command, stdout=report_to)
    while making.poll() is None:
        if interrupts.presses > presses:
            making.kill()
            making.wait()
            console.say(f"no report: Ctrl-C; swarm-ctl report {folder} makes it")
            return
        pause(_POLL_WALL_S)
    if making.returncode:
        console.say(f"no report: the reason stands above; swarm-ctl report {folder} makes it")


def exit_code(summary: Summary, interrupts: int) -> int:
    """0 completed, 1 not, 130 landed by Ctrl-C."""
    return 130 if interrupts else int(summary.outcome is not Outcome.COMPLETED)
