"""Outside the studied ranges a mission is warned of, far outside refused, by name and number."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from swarm_ctl.errors import MissionError
from swarm_ctl.mission.compile.loader import load, loads

MISSIONS = Path(__file__).parents[4] / "missions"
TEXT = (MISSIONS / "hexagon.yaml").read_text()
"""5 m/s, 5 m from r_in to r_out."""


def hexagon(**vehicle: str) -> str:
    """The mission with these sections of `vehicle`."""
    return TEXT + "vehicle: {" + ", ".join(f"{k}: {v}" for k, v in vehicle.items()) + "}\n"


OUTSIDE = {
    "speed": (hexagon(limits="{speed_mps: 6}"), r"vehicle.limits.speed_mps: speed_mps.* is 2.57"),
    "acceleration": (
        hexagon(response="{acceleration_mps2: 1.9}"),
        r"vehicle.response.acceleration_mps2: acceleration_mps2 .* is 1.9",
    ),
    "dead time": (hexagon(response="{dead_time_s: 0.7}"), r"dead time \[s\] is 0.7"),
    "lag": (hexagon(response="{lag_s: 0.9}"), r"lag \[s\] is 0.9"),
    "doubt": (hexagon(response="{doubt_s: 0.6}"), r"doubt_s \[s\] is 0.6"),
    "r_in": (TEXT.replace("r_in: 0.5", "r_in: 0.8"), r"law.r_in: r_in .* 1.14"),
    "slots": (TEXT.replace("side: 2}", "side: 1.8}"), r"smallest distance of slots / r_out is 1.2"),
    "gain": (TEXT.replace("h: 0.05 ", "h: 0.21 "), r"kappa \* h \[1/s\] is 4.2"),
    "tick": (
        TEXT.replace("tick_s: 0.05", "tick_s: 0.12").replace("kappa: 20", "kappa: 8"),
        r"tick_s \[s\] is 0.12",
    ),
}
REFUSED = {
    "speed": (
        hexagon(limits="{speed_mps: 13}"),
        "12.1",
        "at most 12; a speed_mps of 12.96 is enough",
    ),
    "acceleration": (hexagon(response="{acceleration_mps2: 0.9}"), "0.9", "at least 1"),
    "dead time": (hexagon(response="{dead_time_s: 1.3}"), "1.3", "at most 1.2"),
    "lag": (hexagon(response="{lag_s: 1.7}"), "1.7", "at most 1.6"),
    "r_in": (
        hexagon(limits="{speed_mps: 2}").replace("r_in: 0.5", "r_in: 1.1"),
        "2.75",
        "at most 2",
    ),
    "tick": (
        TEXT.replace("tick_s: 0.05", "tick_s: 0.25").replace("kappa: 20", "kappa: 4"),
        "0.25",
        "at most 0.2",
    ),
}


@pytest.mark.parametrize("path", sorted(MISSIONS.glob("*.yaml")), ids=lambda path: path.stem)
def test_ready_missions_are_inside(path: Path) -> None:
    assert load(path).warnings == ()


@pytest.mark.parametrize(("text", "said"), OUTSIDE.values(), ids=OUTSIDE)
def test_outside_is_said_by_name_and_number(text: str, said: str) -> None:
    studied = [warning for warning in loads(text).warnings if "outside the studied" in warning]
    assert any(re.search(said, warning) for warning in studied), studied


@pytest.mark.parametrize(("text", "number", "allowed"), REFUSED.values(), ids=REFUSED)
def test_far_outside_is_refused(text: str, number: str, allowed: str) -> None:
    with pytest.raises(MissionError) as caught:
        loads(text)
    problems = [each for each in caught.value.problems if "far outside" in each.what]
    assert [(f" is {number}," in each.what, each.allowed) for each in problems] == [(True, allowed)]


@pytest.mark.parametrize("speed_mps", [6, 9.9, 13])
def test_the_speed_that_is_said_to_be_enough_is_enough(speed_mps: float) -> None:
    """To be inside, or of a mission that is refused, to fly with a warning."""
    try:
        (said,) = loads(hexagon(limits=f"{{speed_mps: {speed_mps}}}")).warnings
    except MissionError as error:
        said = str(error)
    (enough,) = re.findall(r"a speed_mps of ([\d.]+) is enough", said)
    better = loads(hexagon(limits=f"{{speed_mps: {enough}}}")).warnings
    assert len(better) == int(speed_mps == 13)


def test_without_the_filter_no_range_holds() -> None:
    text = TEXT.replace("safety: {align: true}", "safety: {filter: false}")
    assert any("safety.filter: off" in warning for warning in loads(text).warnings)


SMALL = """version: 1
name: pair
origin: {lat_deg: 47.4, lon_deg: 8.5, alt_m: 488}
lengths: metres
law: {r: 22, r_out: 7, r_in: 2.5}
agents: [{id: 1, start: [0, 0]}, {id: 2, start: [0, 10]}]
shapes: {row: {kind: line, spacing: 12}}
steps: [{takeoff: {height_m: 5}}, {form: {shape: row}}, {move: {to: [5, 5]}}, land]
"""


def test_the_default_speed_follows_the_radii_and_raises_no_warning() -> None:
    """One that the mission sets, or that a step needs, stays and is warned of."""
    default = loads(SMALL)
    assert default.plan.limits.speed_mps == 4.7
    assert not [told for told in default.warnings if "speed_mps" in told]
    set_ = loads(SMALL + "vehicle: {limits: {speed_mps: 5.0}}\n")
    assert set_.plan.limits.speed_mps == 5.0
    assert [told for told in set_.warnings if "a speed_mps of 4.76 is enough" in told]
    fast = loads(SMALL.replace("to: [5, 5]", "to: [5, 5], speed_mps: 4.9"))
    assert fast.plan.limits.speed_mps == 5.0


@pytest.mark.parametrize(
    ("autopilot", "r_in", "warned"), [("px4", 2.1, 1), ("px4", 2.0, 0), ("ardupilot", 2.1, 0)]
)
def test_px4s_have_room_to_pass_each_other(autopilot: str, r_in: float, warned: int) -> None:
    """Two metres from r_in to r_out."""
    fleet = f"fleet: {{agents: [{{id: 1}}, {{id: 2, autopilot: {autopilot}}}]}}\n"
    told = loads(SMALL.replace("r_out: 7, r_in: 2.5", f"r_out: 4, r_in: {r_in}") + fleet).warnings
    assert sum("PX4s that pass each other" in each for each in told) == warned
