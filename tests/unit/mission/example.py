"""A small mission with known line numbers, and how to break it."""

from __future__ import annotations

import pytest

from swarm_ctl.errors import MissionError, Problem
from swarm_ctl.mission.compile.loader import loads

TEXT = """\
version: 1
name: trio
origin: {lat_deg: -35.36, lon_deg: 149.16, alt_m: 584}
unit_m: 5
tick_s: 0.05
law:
  r: 4.5
  r_out: 1.5
  r_in: 0.5
  kappa: 20
agents:
  - {id: 1, start: [0, 0]}
  - {id: 2, start: [0, 3]}
  - {id: 3, start: [3, 0]}
shapes:
  ring: {kind: ring, count: 3, side: 2}
  row:
    kind: offsets
    offsets:
      - [0, 0]
      - [0, 2]
      - [0, 4]
steps:
  - takeoff: {height_m: 10}
  - form: {shape: ring}
  - hold: {duration_s: 10}
  - form: {shape: row, timeout_s: 60}
  - land
policies:
  agent_lost: land
fleet:
  agents:
    - {id: 1, sysid: 1, endpoint: "udpout:10.0.0.1:14550", mesh: tcp/10.0.0.1:7447}
    - {id: 2, sysid: 2, endpoint: "udpout:10.0.0.2:14550", mesh: tcp/10.0.0.2:7447}
    - {id: 3, sysid: 3, autopilot: px4}
  trust: keys
"""


def edited(*edits: tuple[str, str]) -> str:
    """The text with replacements, each of which has to find its place exactly once."""
    text = TEXT
    for old, new in edits:
        assert text.count(old) == 1, old
        text = text.replace(old, new)
    return text


def in_metres() -> str:
    """The same mission in metres, with the unit that it has."""
    return edited(
        ("unit_m: 5", "unit_m: 5\nlengths: metres"),
        ("r: 4.5", "r: 22.5"),
        ("r_out: 1.5", "r_out: 7.5"),
        ("r_in: 0.5", "r_in: 2.5"),
        ("start: [0, 3]", "start: [0, 15]"),
        ("start: [3, 0]", "start: [15, 0]"),
        ("side: 2", "side: 10"),
        ("- [0, 2]", "- [0, 10]"),
        ("- [0, 4]", "- [0, 20]"),
    )


def problems(text: str, name: str = "trio.yaml") -> tuple[Problem, ...]:
    """What a text is refused with."""
    with pytest.raises(MissionError) as caught:
        loads(text, name)
    return caught.value.problems


def without_section(name: str) -> str:
    """The text without one top-level section."""
    lines, skipping = [], False
    for line in TEXT.splitlines(keepends=True):
        if not line.startswith(" "):
            skipping = line.startswith(f"{name}:")
        if not skipping:
            lines.append(line)
    return "".join(lines)
