"""Whatever slips into a ready mission, the answer is a plan, or every mistake with file, line, what
is wrong and what is allowed."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from swarm_ctl.errors import MissionError, Problem
from swarm_ctl.mission.compile.loader import loads

MISSIONS = sorted((Path(__file__).parents[3] / "missions").glob("*.yaml"))
TEXTS = [path.read_text() for path in MISSIONS]
KEY = re.compile(r"[A-Za-z_]+(?=:)")
NUMBER = re.compile(r"-?\d+(\.\d+)?")
PARSER = re.compile(r"block (mapping|sequence|collection|entry|end)")
"""How PyYAML speaks; a shape may be called `block`."""
VALUES = (
    "",
    "0",
    "-1",
    "1e9",
    ".nan",
    "-.inf",
    "9" * 401,
    "-" + "9" * 5000,
    '"a\\0.kml"',
    '"\\ud800.csv"',
    "x",
    "ü",
    "[]",
    "{}",
    "[1, 2]",
    "{a: 1}",
    "~",
    "true",
    "5 m",
)
FACTORS = (-1, 0, 0.001, 0.2, 3.28, 5, 1000)
LETTERS = "aeiou_xs: -"


def typo(draw: st.DrawFn, word: str) -> str:
    """A letter too few, too many, or two exchanged."""
    k, letter = draw(st.integers(0, len(word) - 1)), draw(st.sampled_from(LETTERS))
    changed = (word[:k] + word[k + 1 :], word[:k] + letter + word[k:], word[:k] + word[k:][::-1])
    return draw(st.sampled_from(changed))


def replaced(
    draw: st.DrawFn, pattern: re.Pattern[str], line: str, new: st.SearchStrategy[str]
) -> str:
    """One of the matches in the line by something else; the line itself where there is none."""
    found = list(pattern.finditer(line))
    if not found:
        return line
    one = draw(st.sampled_from(found))
    return line[: one.start()] + draw(new) + line[one.end() :]


def changed(draw: st.DrawFn, line: str) -> str:
    """One slip in one line."""
    key = KEY.search(line)
    number = NUMBER.search(line)
    match draw(st.sampled_from(("drop", "key", "value", "indent", "number", "unit", "cut"))):
        case "drop":
            return ""
        case "key" if key:
            other = st.sampled_from((typo(draw, key[0]), key[0].upper(), f"{key[0]}_m"))
            return replaced(draw, KEY, line, other)
        case "value":
            return replaced(draw, re.compile(r"(?<=: )[^,}\]]+"), line, st.sampled_from(VALUES))
        case "indent":
            space = " " * draw(st.integers(0, 5))
            return space + line.lstrip()
        case "number" if number:
            value = float(number[0]) * draw(st.sampled_from(FACTORS))
            return replaced(draw, NUMBER, line, st.just(f"{value:g}"))
        case "unit" if number:
            return replaced(
                draw, NUMBER, line, st.just(f"{number[0]}{draw(st.sampled_from('m s'))}")
            )
        case _:
            k = draw(st.integers(0, len(line)))
            return line[:k] + line[k + 1 :]


@st.composite
def mutated(draw: st.DrawFn) -> str:
    """A ready mission with one to three slips, perhaps with the other unit of length."""
    lines = draw(st.sampled_from(TEXTS)).splitlines()
    told = [k for k, line in enumerate(lines) if line and not line.startswith("#")]
    for _ in range(draw(st.integers(1, 3))):
        k = draw(st.sampled_from(told))
        lines[k] = changed(draw, lines[k])
    text = "\n".join(lines) + "\n"
    return text.replace("lengths: metres", "") if draw(st.booleans()) else text


def answered(text: str) -> None:
    """A plan, or sound mistakes."""
    found: tuple[Problem, ...] = ()
    try:
        steps = sum(len(group.steps) for group in loads(text, "m.yaml").plan.groups)
    except MissionError as error:
        steps, found = 0, error.problems
    assert bool(steps) != bool(found)
    for problem in found:
        assert re.fullmatch(r"m\.yaml:\d+", problem.where)
        assert 1 <= int(problem.where.partition(":")[2]) <= text.count("\n") + 1
        assert all((problem.field, problem.what, problem.allowed))
        assert str(problem).isprintable()
        assert "Error" not in str(problem), "no exception's own words"
        assert not PARSER.search(str(problem)), "nor a parser's"


def test_a_group_that_is_not_declared_is_named() -> None:
    """Its shape has no slot to be checked: that raised."""
    text = next(text for text in TEXTS if "\nname: groups\n" in text)
    with pytest.raises(MissionError, match="there is no group 'scouts'"):
        loads(re.sub(r"\n  scouts: \[.*", "", text), "m.yaml")


@settings(max_examples=75)
@given(mutated())
def test_a_slip_in_a_ready_mission_is_a_plan_or_mistakes_with_their_place(text: str) -> None:
    answered(text)


@pytest.mark.long
@settings(max_examples=2000)
@given(mutated())
def test_two_thousand_slips(text: str) -> None:
    answered(text)
