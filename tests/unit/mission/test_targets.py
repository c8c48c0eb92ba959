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


def test_an_agent_that_a_pilot_flies_may_be_followed() -> None:
    text = edited(("  agent_lost: land", "  agent_lost: continue"))
    text = text.replace("  - land\n", FOLLOWS.replace("MORE", ""))
    assert loads(f"{text}targets: {{boat: {{agent: 2}}}}\n").plan.targets[0].agent == 2
