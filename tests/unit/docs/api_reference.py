"""Writes the page of the Python interface from its signatures and docstrings.

python -m tests.unit.docs.api_reference > docs/look-up/python-calls.md
"""

from __future__ import annotations

import ast
import inspect
import sys
import textwrap
from collections.abc import Iterator
from typing import Any, Final

from swarm_ctl.api.flight import FlightResult, SwarmFlight
from swarm_ctl.api.swarm import Swarm
from swarm_ctl.testing.plugin import Fly

COMMAND: Final = "python -m tests.unit.docs.api_reference > docs/look-up/python-calls.md"
HEAD: Final = f"""# Python calls

Every call of [a program's swarm](../do/python.md) and of [a test's flight](../do/testing.md), made
from the code by `{COMMAND}`.

Times are mission seconds, lengths metres. `*agents` are ids or groups (`"@scouts"`); none: all.
"""


def page() -> str:
    """The whole page, as Markdown."""
    flight = "swarm.flight", "The same flight as a test has it (of a `Swarm`)."
    swarm = [*_calls("swarm", Swarm), flight]
    tested = [("swarm" + _arguments(Fly.__call__), _first(Fly.__call__)), *_inner()]
    result = [(f"run.{name}", said) for name, said in fields(FlightResult)]
    return "\n".join(
        (
            HEAD,
            _table("A swarm", "of `swarm_ctl.fly`", swarm),
            _table("A flight", "of the fixture `swarm`", [*tested, *_calls("flight", SwarmFlight)]),
            _table("Its result", "of `finish`", [*result, *_calls("run", FlightResult)]),
        )
    )


def _inner() -> Iterator[tuple[str, str]]:
    """What a flight is given as it starts."""
    yield "flight.plan", "What is flown: `agents`, `groups`, `law`, ..."
    yield "flight.scenario", "What befalls it; None: nothing but what the test does."


def _calls(name: str, kind: type) -> Iterator[tuple[str, str]]:
    for what, value in vars(kind).items():
        if not what.startswith("_") and (inspect.isfunction(value) or isinstance(value, property)):
            arguments = _arguments(value) if inspect.isfunction(value) else ""
            yield f"{name}.{what}{arguments}", _first(value)


def _arguments(function: Any) -> str:
    """As they are written in a call, with their defaults."""
    plain = []
    for p in list(inspect.signature(function).parameters.values())[1:]:
        star = {p.VAR_POSITIONAL: "*", p.VAR_KEYWORD: "**"}.get(p.kind, "")
        plain.append(f"{star}{p.name}" if p.default is p.empty else f"{p.name}={p.default!r}")
    return f"({', '.join(plain)})"


def _first(value: Any) -> str:
    """The docstring's first paragraph."""
    return " ".join((inspect.getdoc(value) or "").partition("\n\n")[0].split())


def fields(kind: type) -> Iterator[tuple[str, str]]:
    """(name, what stands below it in the source) of each field of a data class."""
    (tree,) = ast.parse(textwrap.dedent(inspect.getsource(kind))).body
    assert isinstance(tree, ast.ClassDef)
    for field, below in zip(tree.body, [*tree.body[1:], ast.Pass()], strict=True):
        if isinstance(field, ast.AnnAssign) and isinstance(field.target, ast.Name):
            said = below.value if isinstance(below, ast.Expr) else None
            text = said.value if isinstance(said, ast.Constant) else ""
            yield field.target.id, " ".join(str(text).split())


def _table(heading: str, of: str, rows: list[tuple[str, str]]) -> str:
    lines = [f"| `{call}` | {said.replace('|', chr(92) + '|')} |" for call, said in rows]
    return "\n".join((f"## {heading}\n", f"| {of} | |", "|---|---|", *lines, ""))


if __name__ == "__main__":
    sys.stdout.write(page())
