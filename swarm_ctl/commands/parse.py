"""Makes an order of what an operator typed or pressed. Pure.

One table has all commands: for keys, the command line, completion and help. `commands/build.py`
makes the mesh's `Command` of an order.
"""

from __future__ import annotations

import difflib
import math
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Final

from swarm_ctl.core.model.messages import ABOUT, CommandKind, Gains
from swarm_ctl.core.model.plan import EVERYONE, Plan
from swarm_ctl.core.model.zones import Zone
from swarm_ctl.core.swarm.gain_update import (
    bad_zones,
    limits,
    out_of_range,
    planned,
    values_of,
    with_values,
)
from swarm_ctl.errors import InputError


@dataclass(frozen=True, slots=True)
class Kind:
    """One kind of command: a row of the table."""

    name: CommandKind
    usage: str
    """What follows the name on the command line; '' for nothing."""
    does: str
    key: str
    """The one key that gives the order; with a `usage` it begins the command line instead."""
    asks: tuple[str, str] = ("", "")
    """What it does to one agent, and to several, which the operator confirms before it is sent; ''
    for an order that is sent at once."""

    @property
    def for_all(self) -> bool:
        """It is for the whole swarm, whatever groups there are."""
        return self.name in (CommandKind.TUNE, CommandKind.ZONE)

    @property
    def for_group(self) -> bool:
        """It is for all agents of one group, or for the whole swarm."""
        return self.name in (CommandKind.FORM, CommandKind.MOVE, CommandKind.FOLLOW)

    @property
    def for_some(self) -> bool:
        """It is for some agents alone, which it has to name."""
        return self.name in (CommandKind.GOTO, CommandKind.LAUNCH)


_BY: Final = "--by"
_MOVE_DOES: Final = f"move the formation to a point [m] at a speed [m/s]; {_BY}: so far from here"
_FOLLOW_DOES: Final = (
    "keep the formation so far [m] from a target of the mission; course: ahead of it, to its right"
)
COURSE: Final = "course"
_GOTO_DOES: Final = (
    "send some agents to a point [m], or LAT,LON, at a speed [m/s]; the others go on without them"
)
_LAUNCH_DOES: Final = "send up an agent that waits on the ground; it joins the others"
_TUNE_DOES: Final = "change the law of all agents at one time"
_ZONE_DOES: Final = "a zone [m] that no vehicle enters: for all agents at one time"
ZONE_USAGE: Final = (
    "zone add NAME circle N E R, zone add NAME polygon N E N E N E ..., both with floor=M,"
    " ceiling=M and clearance=M as wanted, or zone lift NAME, in metres; zone list; zone plan"
)
_LANDS: Final = ("it lands where it is", "they land where they are")
_RETURNS: Final = ("it flies home and lands", "they fly home, all at once, and land")
_LAUNCHES: Final = ("it takes off, and joins the others", "they take off, and join the others")
_FALLS: Final = ("its motors stop, and it falls", "their motors stop, and they fall")
_EXPELS: Final = (
    "it holds; the others listen to it no more, and keep clear of its vehicle",
    "they hold; the others listen to them no more, and keep clear of their vehicles",
)
KINDS: Final[tuple[Kind, ...]] = (
    Kind(CommandKind.HOLD, "", "stop in the air; avoidance stays on", "h"),
    Kind(CommandKind.RESUME, "", "go on with the mission", "r"),
    Kind(CommandKind.NEXT, "", "end the current step", "n"),
    Kind(CommandKind.FORM, "SHAPE", "fly into another shape of the mission", "f"),
    Kind(CommandKind.MOVE, "NORTH EAST [SPEED]", _MOVE_DOES, "m"),
    Kind(CommandKind.FOLLOW, "TARGET [NORTH EAST] [course]", _FOLLOW_DOES, "F"),
    Kind(CommandKind.GOTO, "NORTH EAST [SPEED]", _GOTO_DOES, "g"),
    Kind(CommandKind.LAUNCH, "", _LAUNCH_DOES, "L", _LAUNCHES),
    Kind(CommandKind.TUNE, "NAME=VALUE ...", _TUNE_DOES, "u"),
    Kind(CommandKind.ZONE, "add/lift NAME ...", _ZONE_DOES, "z"),
    Kind(CommandKind.LAND, "", "land in place", "l", _LANDS),
    Kind(CommandKind.RETURN, "", "fly home and land", "b", _RETURNS),
    Kind(CommandKind.KILL, "", "stop the motors: the vehicle falls", "K", _FALLS),
    Kind(CommandKind.EXPEL, "", "listen to an agent no more; keep clear of it", "X", _EXPELS),
    Kind(CommandKind.READMIT, "", "listen to an expelled agent again", "I"),
)
_EXAMPLES: Final = {CommandKind.GOTO: "goto 20 -5", CommandKind.LAUNCH: "launch"}
BY_NAME: Final[dict[str, Kind]] = {kind.name: kind for kind in KINDS}
_ALSO: Final[dict[str, str]] = {"rtl": CommandKind.RETURN, "join": CommandKind.RESUME}
"""Names that other ground stations have for a command; and to `join` the others again is to go on
with the mission."""


@dataclass(frozen=True, slots=True)
class Order:
    """What an operator wants."""

    kind: str
    arguments: tuple[str, ...] = ()
    agents: tuple[int, ...] = ()
    """Named by id; none, and no group either: all of them."""
    by: bool = False
    """`move` by so much, not to a point."""
    at_step: int = 0
    """The step of the mission that the operator saw; 0: not known."""
    groups: tuple[str, ...] = ()
    """Named, too."""

    @property
    def text(self) -> str:
        """The order as an operator types it."""
        return " ".join((self.kind, *([_BY] if self.by else []), *self.arguments))

    @property
    def whom(self) -> str:
        """The agents that it names, as typed behind `@`: `scouts,1,3`; '' for all."""
        return ",".join((*self.groups, *map(str, self.agents)))

    def named(self, plan: Plan, step: int) -> tuple[int, ...]:
        """The agents that it names, by their ids or by their groups; (): it is for all. Of several
        groups of one name those count that fly now or next, where the furthest agent is in `step`.

        Raises:
            InputError: the plan has no such group.
        """
        ids = set(self.agents)
        for name in self.groups:
            groups = [group for group in plan.groups if group.name == name]
            called = [group for group in plan.named if group.name == name]
            if not groups and not called:
                raise InputError(_no_group(name, group_names(plan)))
            if not groups:
                ids |= {*called[0].ids}
                continue
            ids |= next((group for group in groups if step <= group.last), groups[-1]).members
        return tuple(sorted(ids))


def parse(line: str, plan: Plan, marked: Iterable[int] = ()) -> Order:
    """The order in `line`, for the agents and groups that it names (`land @1,3-5`, `land 3`,
    `land @scouts,7`, `land @all`) or else for the `marked` ones.

    Raises:
        InputError: with what would be allowed.
    """
    words = line.split()
    at = [word for word in words if word.startswith("@")]
    name, *arguments = [word for word in words if not word.startswith("@")] or [""]
    name = _ALSO.get(name, name)
    kind = BY_NAME.get(name)
    if kind is None:
        raise InputError(f"no command {name!r}; allowed: {', '.join(BY_NAME)}")
    if not kind.usage and arguments and not at:  # `land 3` is `land @3`
        at, arguments = [f"@{','.join(arguments)}"], []
    agents, groups = addressed(at, plan) if at else (tuple(sorted(set(marked))), ())
    if name in ABOUT and not groups and not 0 < len(agents) < len(plan.agents):
        raise InputError(f"{name} is about some agents, not all; e.g. {name} 3, or mark them")
    if kind.for_some and not agents and not groups:
        instead = "; for all: move" if kind.name is CommandKind.GOTO else ""
        raise InputError(f"{name} is for some agents; e.g. {_EXAMPLES[kind.name]} @3{instead}")
    if (agents or groups) and (kind.for_all or (kind.for_group and not _one(agents, groups, plan))):
        instead = f"leave out {' '.join(at)}" if at else "unmark the agents (a)"
        if not kind.for_all and (known := group_names(plan)):
            instead += f", or name one group: {', '.join(f'@{group}' for group in known)}"
            raise InputError(f"{name} is for the whole swarm or a whole group; {instead}")
        raise InputError(f"{name} is for the whole swarm; {instead}")
    by = name == CommandKind.MOVE and _BY in arguments
    arguments = [word for word in arguments if not (by and word == _BY)]
    _check(kind, arguments, plan)
    return Order(name, tuple(arguments), agents, by, groups=groups)


def group_names(plan: Plan) -> list[str]:
    """Of the groups that fly steps of their own, and of the mission's others."""
    flown = [group.name for group in plan.groups if group.name != EVERYONE]
    return list(dict.fromkeys([*flown, *(group.name for group in plan.named)]))


def addressed(who: Iterable[int | str], plan: Plan) -> tuple[tuple[int, ...], tuple[str, ...]]:
    """The agents and the groups that are named: ids, or words such as `@scouts`, `@1,3-5` or
    `scouts,7`; none of either where all are.

    Raises:
        InputError: with the agents or the groups that there are.
    """
    known, groups = [agent.id for agent in plan.agents], group_names(plan)
    agents, names, every = set[int](), dict[str, None](), False
    for part in (part for word in who for part in str(word).split(",")):
        text = part.lstrip("@")
        first, dash, last = text.partition("-")
        if text == EVERYONE:
            every = True
            continue
        if not first.isdecimal() or (dash and not last.isdecimal()):
            if text not in groups:
                raise InputError(_no_group(text, groups))
            names[text] = None
            continue
        span = {i for i in known if int(first) <= i <= int(last or first)}
        if not span:
            allowed = ", ".join(map(str, known))
            raise InputError(f"no agent {text} in this mission; allowed: {allowed}")
        agents |= span
    return ((), ()) if every else (tuple(sorted(agents)), tuple(names))


def _no_group(text: str, groups: Sequence[str]) -> str:
    if not groups:
        return f"@{text} names no agents; allowed: @all, @1,3-5"
    close = difflib.get_close_matches(text, groups, n=1)
    hint = f"; did you mean @{close[0]}?" if close else ""
    allowed = ", ".join(f"@{name}" for name in (EVERYONE, *groups))
    return f"@{text} names no agents and no group{hint}; allowed: {allowed}, @1,3-5"


def _one(agents: tuple[int, ...], groups: tuple[str, ...], plan: Plan) -> bool:
    """They are one group."""
    if groups:
        return len(groups) == 1 and not agents
    return any(
        frozenset(agents) == group.members for group in plan.groups if group.name != EVERYONE
    )


def complete(line: str, plan: Plan) -> list[str]:
    """Whole lines that begin with `line`, the best one first: commands, and behind a command its
    own arguments alone. No line is completed to an order that is asked about."""
    before, space, last = line.rpartition(" ")
    name, *named = before.split() or [""]
    kind = BY_NAME.get(name)
    words: Iterable[str] = ()
    if not name:
        harmless = [kind for kind in KINDS if not kind.asks[0]]
        words = (f"{kind.name} " if kind.usage else kind.name for kind in harmless)
    elif kind is not None and not kind.asks[0]:
        words = arguments(kind, named, plan)
    fitting = (word for word in words if word.startswith(last) and word.strip() != last)
    return [f"{before}{space}{word}" for word in fitting]


def arguments(kind: Kind, named: Sequence[str], plan: Plan) -> list[str]:
    """The words that may follow a command and its arguments so far."""
    groups = [f"@{name}" for name in group_names(plan)]
    if kind.name is CommandKind.FORM:
        shapes = dict.fromkeys(shape.name for shape in plan.shapes)
        return groups * (len(named) == 1) if named else list(shapes)
    if kind.name is CommandKind.FOLLOW:
        return [COURSE] if len(named) == 3 else [t.name for t in plan.targets if not named]
    if kind.name is CommandKind.MOVE:
        return groups * (len(named) in (2, 3) and named[-1] not in groups)
    if kind.name is CommandKind.GOTO and len(named) < 2:
        return []
    if kind.name is CommandKind.TUNE:
        values = values_of(planned(plan)).items()
        taken = {word.partition("=")[0] for word in named}
        return [*(f"{name}={value:g}" for name, value in values if name not in taken), "plan"]
    if kind.name is CommandKind.ZONE:
        return zone_words(named, plan)
    if kind.for_some:
        waiting = [agent.id for agent in plan.agents if agent.waits]
        ids = waiting if kind.name is CommandKind.LAUNCH else [agent.id for agent in plan.agents]
        there = any(word.startswith("@") for word in named)
        return [] if there else [*groups, *(f"@{i}" for i in ids)]
    return [] if named else ["@all", *groups, *(f"@{agent.id}" for agent in plan.agents)]


def tuned(words: Iterable[str], law: Gains, plan: Plan) -> Gains:
    """`law` with the values that `words` name (`h=0.04`), or the mission's own for the word `plan`.

    Raises:
        InputError: a value is out of range, or a name is unknown.
    """
    changes: dict[str, float] = {}
    for word in words:
        if word == "plan":
            changes |= values_of(planned(plan))
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
    gains = with_values(law, changes)
    wrong = out_of_range(gains, plan)
    if wrong:
        raise InputError(f"tune: {wrong}")
    return gains


def rezoned(
    words: Sequence[str], zones: tuple[Zone, ...], plan: Plan, *, known: bool = True
) -> tuple[Zone, ...]:
    """`zones` with one added or lifted. `known`: they are those in force, not only the plan's.

    Raises:
        InputError: it is none, or there is one, or none, of that name.
    """
    if not known and [*words] == ["list"]:
        return zones
    if [*words] == ["plan"]:
        return plan.zones
    verb, name, *rest = (*words, "", "")[: max(2, len(words))]
    names = [zone.name for zone in zones]
    if verb == "lift" and name and not rest:
        if known and name not in names:
            raise InputError(f"there is no zone {name}; allowed: {', '.join(names) or 'none'}")
        return tuple(zone for zone in zones if zone.name != name)
    options = dict(word.split("=", 1) for word in rest if "=" in word)
    if len(options) < sum("=" in word for word in rest):
        raise InputError(f"zone {name}: a number is given twice; usage: {ZONE_USAGE}")
    shape, *numbers = [word for word in rest if "=" not in word] or [""]
    values = [_number(word) for word in numbers]
    heights = {key: _number(value) for key, value in options.items()}
    allowed = ("floor", "ceiling", "clearance")
    sound = verb == "add" and name and all(map(math.isfinite, (*values, *heights.values())))
    if shape == "circle":
        sound = sound and len(values) == 3
    else:
        sound = sound and shape == "polygon" and len(values) >= 6 and len(values) % 2 == 0
    if not sound or set(heights) - set(allowed):
        raise InputError(f"usage: {ZONE_USAGE}")
    if not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9_-]{0,39}", name):
        raise InputError(f"{name!r} is no name; allowed: A-Z, a-z, 0-9, - and _ (at most 40)")
    if known and name in names:
        raise InputError(f"there is a zone {name}; allowed: another name, or lift it first")
    points = values[:2] if shape == "circle" else values
    zone = Zone(
        name,
        tuple(zip(points[::2], points[1::2], strict=True)),
        values[2] if shape == "circle" else 0.0,
        heights.get("clearance", 0.5 * plan.law.r_in * plan.unit_m),
        heights.get("floor"),
        heights.get("ceiling"),
    )
    wrong = bad_zones((*zones, zone) if known else (zone,))
    if wrong:
        raise InputError(f"zone: {wrong}")
    return (*zones, zone)


def zone_words(named: Sequence[str], plan: Plan) -> list[str]:
    """The words that may follow."""
    if not named:
        return ["add ", "lift ", "list", "plan"]
    if named[0] == "lift" and len(named) == 1:
        return [zone.name for zone in plan.zones]
    return ["circle ", "polygon "] if named[0] == "add" and len(named) == 2 else []


def ranges_of_law(plan: Plan) -> str:
    """`delta_a 0–0.3, ...`: the values that `tune` takes, for the line above the keys."""
    return ", ".join(f"{name} {least:g}–{most:g}" for name, (least, most) in limits(plan).items())


def _check(kind: Kind, arguments: list[str], plan: Plan) -> None:
    usage = f"{kind.name} {kind.usage}".strip()
    if kind.name is CommandKind.FORM:
        if len(arguments) != 1:  # `build` checks the name
            known = ", ".join(dict.fromkeys(shape.name for shape in plan.shapes))
            raise InputError(f"usage: {usage}; this mission has {known or 'none'}")
    elif kind.name is CommandKind.MOVE:
        numbers = [_number(word) for word in arguments]
        if len(numbers) not in (2, 3) or not all(map(math.isfinite, numbers)):
            raise InputError(f"usage: {usage}, e.g. move 20 -5, or move {_BY} 10 0")
    elif kind.name is CommandKind.GOTO:
        numbers = [_number(part) for word in arguments for part in word.split(",")]
        if len(numbers) not in (2, 3) or not all(map(math.isfinite, numbers)):
            also = "goto -35.3629,149.1655 @3 (latitude,longitude)"
            raise InputError(f"usage: {usage}, e.g. {_EXAMPLES[kind.name]} @3, or {also}")
    elif kind.name is CommandKind.FOLLOW:
        numbers = [_number(word) for word in arguments[1:] if word != COURSE]
        named = not arguments or math.isnan(_number(arguments[0]))
        finite = len(numbers) in (0, 2) and all(map(math.isfinite, numbers))
        if not arguments or not finite or not named or arguments.count(COURSE) > 1:
            known = ", ".join(target.name for target in plan.targets)
            what = f"this mission has {known or 'no targets'}"
            raise InputError(f"usage: {usage}, e.g. follow boat -20 0 course; {what}")
    elif kind.name is CommandKind.TUNE:
        tuned(arguments, planned(plan), plan)
    elif kind.name is CommandKind.ZONE:
        rezoned(arguments, plan.zones, plan, known=False)
    elif arguments:
        said = " ".join(arguments)
        raise InputError(f"{usage} takes nothing but agents, not {said!r}; e.g. {usage} @1,3-5")


def _number(word: str) -> float:
    try:
        return float(word)
    except ValueError:
        return math.nan
