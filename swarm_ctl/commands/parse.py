"""Makes an order of what an operator typed or pressed. Pure.

One table has all commands: for keys, the command line, completion and help. `commands/build.py`
makes the mesh's `Command` of an order.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import asdict, dataclass, replace
from typing import Final

from swarm_ctl.core.model.messages import CommandKind, Gains
from swarm_ctl.core.model.plan import FormStep, Plan
from swarm_ctl.core.swarm.gain_update import limits, out_of_range, planned
from swarm_ctl.errors import InputError


@dataclass(frozen=True, slots=True)
class Kind:
    """One kind of command: a row of the table."""

    name: CommandKind
    usage: str
    """What follows the name on the command line; '' for nothing."""
    does: str
    key: str = ""
    """The one key that gives the order; with a `usage` it begins the command line instead."""
    for_all: bool = False
    """It can't be given to single agents."""
    asks: str = ""
    """The question that the operator answers before it is sent; '' for none."""


KINDS: Final[tuple[Kind, ...]] = (
    Kind(CommandKind.HOLD, "", "stop in the air; avoidance stays on", "h"),
    Kind(CommandKind.RESUME, "", "go on with the mission", "r"),
    Kind(CommandKind.NEXT, "", "end the current step", "n"),
    Kind(CommandKind.FORM, "SHAPE", "fly into another shape of the mission", "f", for_all=True),
    Kind(
        CommandKind.MOVE,
        "NORTH EAST [SPEED]",
        "move the formation to a point [m] at a speed [m/s]",
        "m",
        for_all=True,
    ),
    Kind(
        CommandKind.TUNE,
        "NAME=VALUE ...",
        "change the law of all agents at one time",
        "u",
        for_all=True,
    ),
    Kind(CommandKind.LAND, "", "land in place", "l"),
    Kind(CommandKind.RETURN, "", "fly home one at a time and land", "b"),
    Kind(
        CommandKind.KILL,
        "",
        "stop the motors: the vehicle falls",
        "K",
        asks="They fall out of the air.",
    ),
)
BY_NAME: Final[dict[str, Kind]] = {kind.name: kind for kind in KINDS}


@dataclass(frozen=True, slots=True)
class Order:
    """What an operator wants."""

    kind: str
    arguments: tuple[str, ...] = ()
    agents: tuple[int, ...] = ()
    """Empty: all of them."""
    by: bool = False
    """`move` by so much, not to a point."""

    @property
    def text(self) -> str:
        """The order as an operator types it."""
        return " ".join((self.kind, *self.arguments))


def shapes(plan: Plan) -> list[str]:
    """The names of the shapes in the mission's steps."""
    return list(dict.fromkeys(step.shape for step in plan.steps if isinstance(step, FormStep)))


def parse(line: str, plan: Plan, marked: Iterable[int] = ()) -> Order:
    """The order in `line`, for the agents named behind an `@` (`land @1,3-5`, `land @all`) or else
    for the `marked` ones.

    Raises:
        InputError: with what would be allowed.
    """
    words = line.split()
    at = [word for word in words if word.startswith("@")]
    name, *arguments = [word for word in words if not word.startswith("@")] or [""]
    kind = BY_NAME.get(name)
    if kind is None:
        raise InputError(f"no command {name!r}; allowed: {', '.join(BY_NAME)}")
    agents = _agents(at[-1][1:], plan) if at else tuple(sorted(set(marked)))
    if agents and kind.for_all:
        instead = f"leave out {at[-1]}" if at else "unmark the agents (a)"
        raise InputError(f"{name} is for the whole swarm; {instead}")
    _check(kind, arguments, plan)
    return Order(name, tuple(arguments), agents)


def complete(line: str, plan: Plan) -> list[str]:
    """Whole lines that begin with `line`, the best one first."""
    head, space, last = line.rpartition(" ")
    if last.startswith("@"):
        ids = ["all", *(str(agent.id) for agent in plan.agents)]
        return [f"{head}{space}@{i}" for i in ids if i.startswith(last[1:]) and i != last[1:]]
    if not space:
        return [
            name + (" " if BY_NAME[name].usage else "")
            for name in BY_NAME
            if name.startswith(line) and name != line
        ]
    if head.split(" ")[0] == "tune":
        return [f"{head} {value}" for value in _values(head, last, plan)]
    if head == "form":
        return [
            f"form {shape}" for shape in shapes(plan) if shape.startswith(last) and shape != last
        ]
    return []


def tuned(words: Iterable[str], law: Gains, plan: Plan) -> Gains:
    """`law` with the values that `words` name (`h=0.04`), or the mission's own for the word `plan`.

    Raises:
        InputError: a value is out of range, or a name is unknown.
    """
    changes: dict[str, float] = {}
    for word in words:
        if word == "plan":
            changes |= asdict(planned(plan))
            continue
        name, _, value = word.partition("=")
        if name not in limits(plan) or not math.isfinite(_number(value)):
            raise InputError(
                f"{word!r} is no value of the law; allowed: {', '.join(limits(plan))},"
                " e.g. tune h=0.04"
            )
        changes[name] = _number(value)
    if not changes:
        raise InputError(
            f"tune changes nothing; allowed: plan, or values of {', '.join(limits(plan))}"
        )
    gains = replace(law, **changes)
    wrong = out_of_range(gains, plan)
    if wrong:
        raise InputError(f"tune: {wrong}")
    return gains


def ranges_of_law(plan: Plan) -> str:
    """`delta_a 0–0.3, ...`: the values that `tune` takes, for the line above the keys."""
    return ", ".join(f"{name} {least:g}–{most:g}" for name, (least, most) in limits(plan).items())


def _values(head: str, last: str, plan: Plan) -> list[str]:
    """The mission's values for the names that `head` does not have yet."""
    named = {word.partition("=")[0] for word in head.split(" ")}
    every = [
        f"{name}={value:g}" for name, value in asdict(planned(plan)).items() if name not in named
    ]
    return [word for word in [*every, "plan"] if word.startswith(last) and word != last]


def _agents(text: str, plan: Plan) -> tuple[int, ...]:
    known = [agent.id for agent in plan.agents]
    if text == "all":
        return ()
    found: set[int] = set()
    for part in text.split(","):
        first, dash, last = part.partition("-")
        if not first.isdecimal() or (dash and not last.isdecimal()):
            raise InputError(f"@{text} names no agents; allowed: @all, @1,3-5")
        span = range(int(first), int(last or first) + 1)
        found |= {i for i in known if i in span}
        if not any(i in span for i in known):
            raise InputError(
                f"no agent {part} in this mission; allowed: {', '.join(map(str, known))}"
            )
    return tuple(sorted(found))


def _check(kind: Kind, arguments: list[str], plan: Plan) -> None:
    usage = f"{kind.name} {kind.usage}".strip()
    if kind.name is CommandKind.FORM:
        if len(arguments) != 1:  # `build` checks the name: the mission file may have more shapes
            raise InputError(
                f"usage: {usage}; this mission flies {', '.join(shapes(plan)) or 'none'}"
            )
    elif kind.name is CommandKind.MOVE:
        numbers = [_number(word) for word in arguments]
        if len(numbers) not in (2, 3) or not all(map(math.isfinite, numbers)):
            raise InputError(f"usage: {usage}, e.g. move 20 -5")
    elif kind.name is CommandKind.TUNE:
        tuned(arguments, planned(plan), plan)
    elif arguments:
        raise InputError(f"usage: {usage}")


def _number(word: str) -> float:
    try:
        return float(word)
    except ValueError:
        return math.nan
