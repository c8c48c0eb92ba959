"""What is warned of where a played target is to be followed."""

from __future__ import annotations

import pytest

from swarm_ctl.mission.compile.loader import loads
from tests.unit.mission.example import edited

FOLLOWS = "  - follow: {target: boat, duration_s: 20, MORE}\n  - land\n"


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
