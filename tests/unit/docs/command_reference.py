"""Writes the page of all commands and their options from the command line's own help.

python -m tests.unit.docs.command_reference > docs/look-up/commands.md
"""

from __future__ import annotations

import re
import sys
import textwrap
from collections.abc import Iterator
from typing import Any, Final

from typer.main import get_command

from swarm_ctl.cli.app import app

COMMAND: Final = "python -m tests.unit.docs.command_reference > docs/look-up/commands.md"
HEAD: Final = f"""# Commands

Every command and its options, as `swarm-ctl COMMAND --help` says them. This page is made from the
code by `{COMMAND}`.
[Install](../learn/install.md) says which package brings which command, [A run](runs.md) how a run
ends and what it leaves.
"""


def page() -> str:
    """The whole page, as Markdown."""
    commands: dict[str, Any] = get_command(app).commands  # type: ignore[attr-defined]
    listed = (
        f"| [`swarm-ctl {name}`](#swarm-ctl-{name}) | {_first(command.help)} |"
        for name, command in sorted(commands.items())
    )
    table = "\n".join(("", "| command | what it does |", "|---|---|", *listed, ""))
    return HEAD + table + "".join(_sections("swarm-ctl", commands))


def _first(text: str | None) -> str:
    """The first paragraph."""
    return _cell((text or "").partition("\n\n")[0])


def _sections(above: str, commands: dict[str, Any]) -> Iterator[str]:
    for name, command in sorted(commands.items()):
        called = f"{above} {name}"
        yield f"\n## {called}\n\n{_said(command.help)}\n"
        shown = [p for p in command.params if not p.hidden and "--help" not in p.opts]
        if shown and not getattr(command, "commands", None):
            rows = "\n".join(f"| {_name(p)} | {_cell(p.help)} |" for p in shown)
            yield f"\n| option | meaning |\n|---|---|\n{rows}\n"
        yield from _sections(called, getattr(command, "commands", {}))


def _said(text: str | None) -> str:
    """The paragraphs; those that keep their lines, as a block."""
    paragraphs = re.split(r"\n\s*\n", (text or "").strip())
    return "\n\n".join(
        f"```text\n{textwrap.dedent(part.lstrip(chr(8)).strip(chr(10)))}\n```"
        if part.startswith("\b")
        else _cell(part)
        for part in paragraphs
    )


def _cell(text: str | None) -> str:
    """On one line; what Markdown would read otherwise is plain, but for code."""
    plain = " ".join((text or "").split())
    return re.sub(r"(`[^`]*`)|([|<*_\[])", lambda m: m[1] or f"\\{m[2]}", plain)


def _name(parameter: Any) -> str:
    """`--seed N`, `MISSION`."""
    if parameter.param_type_name == "argument":
        return f"`{parameter.metavar or parameter.name.upper()}`"
    words = ", ".join((*parameter.opts, *parameter.secondary_opts))
    return f"`{words} {parameter.metavar}`" if parameter.metavar else f"`{words}`"


if __name__ == "__main__":
    sys.stdout.write(page())
