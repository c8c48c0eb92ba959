"""What is refused of targets and of the steps that follow them."""

from __future__ import annotations

import pytest

from swarm_ctl.mission.compile.loader import loads
from tests.unit.mission.example import edited, problems

FOLLOWS = "  - follow: {target: boat, duration_s: 20, MORE}\n  - land\n"


@pytest.mark.parametrize(
    ("target", "more", "field", "what", "allowed"),
    [
        ("adsb: '000000'", "", "targets.boat.adsb", "no aircraft", "not all 0"),
        (
            "adsb: a1b2c3, along: [[0, 0], [0, 9]]",
            "",
            "targets.boat",
            "has adsb and along",
            "or none",
        ),
        ("agent: 9", "", "targets.boat.agent", "no agent 9", "one of 1, 2, 3"),
        ("speed_mps: 2", "", "targets.boat.speed_mps", "that is played", "with along"),
        (
            "agent: 2",
            "",
            "follow.target",
            "the others do as policies.agent_lost says: land",
            ": continue",
        ),
        (
            "height_m: 30",
            "above_m: 100",
            "follow.above_m",
            "over the fence's top",
            "from 2 to 88 m",
        ),
        (
            "height_m: -30",
            "above_m: 10",
            "follow.above_m",
            "too near the ground",
            "from 32 to 148 m",
        ),
        ("height_m: 0", "speed_mps: 12", "follow.speed_mps", "faster than the vehicles", "at most"),
        ("height_m: 0", "timeout_s: 15", "follow.timeout_s", "is over before", "above 20"),
    ],
)
def test_a_mistake_is_named(target: str, more: str, field: str, what: str, allowed: str) -> None:
    text = edited(("  - land\n", FOLLOWS.replace("MORE", more)))
    (problem,) = problems(f"{text}targets: {{boat: {{{target}}}}}\n")
    assert field in problem.field
    assert what in problem.what
    assert allowed in problem.allowed


@pytest.mark.parametrize(
    ("boat", "more", "warning"),
    [
        ("along: [[0, 0], [4, 4]], speed_mps: 2", "", ""),
        (
            "along: [[0, 0], [4, 4]], speed_mps: 9",
            "speed_mps: 3",
            "boat is played at 9 m/s, and the formation flies at most 3 m/s: it falls behind",
        ),
        (
            "along: [[0, 0], [900, 0]], speed_mps: 2",
            "",
            "boat leaves the fence after 15 s, at (30, 0) m",
        ),
        ("along: [[0, 0], [900, 0]], speed_mps: 2", "until: [2, 0]", ""),
        (
            "along: [[0, 0], [9, 0], [9, 90]], speed_mps: 2",
            "offset: [0, 30], offset_in: course",
            "a place of the formation leaves the fence after 0 s, with boat at (0, 0) m",
        ),
    ],
)
def test_a_played_target_that_cannot_be_followed_is_warned_of(
    boat: str, more: str, warning: str
) -> None:
    text = edited(("  - land\n", FOLLOWS.replace("MORE", more)))
    text += "fence: {polygon: [[-6, -6], [6, -6], [6, 12], [-6, 12]]}\n"
    found = loads(f"{text}targets: {{boat: {{{boat}}}}}\n").warnings
    said = [each.partition("follow.target: ")[2] for each in found]
    waits = ": the formation waits inside" if "leaves the fence" in warning else ""
    assert said == ([warning + waits] if warning else [])


def test_an_agent_that_a_pilot_flies_may_be_followed() -> None:
    text = edited(("  agent_lost: land", "  agent_lost: continue"))
    text = text.replace("  - land\n", FOLLOWS.replace("MORE", ""))
    assert loads(f"{text}targets: {{boat: {{agent: 2}}}}\n").plan.targets[0].agent == 2
