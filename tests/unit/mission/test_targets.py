"""What is warned of where a target is to be followed."""

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


@pytest.mark.parametrize(
    ("boat", "more", "near"),
    [
        ("height_m: 0", "above_m: 5", "0.0 m beside boat and 5.0 m above it"),
        ("height_m: 0", "above_m: 5.1", ""),
        ("", "above_m: 5", "0.0 m beside boat and 5.0 m above it"),
        ("", "", ""),
        ("along: [[0, 0], [4, 4]]", "", "0.0 m beside boat and 4.0 m above it"),
        ("height_m: 6", "", "0.0 m beside boat and 2.0 m below it"),
        ("height_m: 6", "offset: [1, 0]", "5.0 m beside boat and 2.0 m below it"),
        ("height_m: 6", "offset: [2, 0]", ""),
        ("height_m: 6", "offset: [2, 0], offset_in: course", "on some course, 0.0 m beside boat"),
        ("agent: 1, height_m: 6", "", ""),
    ],
)
def test_a_place_that_its_agent_keeps_off_is_warned_of(boat: str, more: str, near: str) -> None:
    """Within 5 m of the target's height agents keep clear of it; of an agent they do as peers."""
    follows, lost = FOLLOWS.replace("MORE", more), ("agent_lost: land", "agent_lost: continue")
    low = ("takeoff: {height_m: 10}", "takeoff: {height_m: 4}")
    text = edited(("  - land\n", follows), lost, low)
    found = loads(f"{text}targets: {{boat: {{{boat}}}}}\n").warnings
    said = [each.partition("a place of the formation is ")[2] for each in found if "clear" in each]
    allowed = ": its agent keeps clear of it, so the shape is not kept; allowed: "
    assert [each.partition(allowed)[0].startswith(near) for each in said] == [True] * bool(near)
