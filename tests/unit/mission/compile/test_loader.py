"""From file to plan: the hash, fleets, warnings, writing again."""

from __future__ import annotations

import dataclasses
import json
import textwrap
from pathlib import Path

import pytest
import yaml

from swarm_ctl.errors import MissionError
from swarm_ctl.mission.compile.loader import dumps, load, loads
from swarm_ctl.mission.fleet.fleet_file import read_fleet
from tests.unit.docs.pages import PAGES, blocks
from tests.unit.mission.example import TEXT, edited, without_section
from tests.unit.plans import steps_of

MISSIONS = Path(__file__).parents[4] / "missions"


@pytest.mark.parametrize("path", sorted(MISSIONS.glob("*.yaml")), ids=lambda path: path.stem)
def test_every_mission_of_the_project_loads_and_is_written_again(path: Path) -> None:
    loaded = load(path)
    again = loads(dumps(loaded.file), str(path))
    assert again.file == loaded.file
    assert again.plan == loaded.plan
    assert again.fleet == loaded.fleet


# --- numbers and words as YAML has them ---


@pytest.mark.parametrize("name", ["on", "no", "y", "010", "1_000", "2026-01-01", "0x1F"])
def test_words_that_older_yaml_would_turn_into_something_else_stay_words(name: str) -> None:
    text = edited(
        ("  ring:", f"  {name}:"),
        ("shape: ring", f"shape: {name}"),
        ("name: trio", f"name: {name}"),
    )
    loaded = loads(text)
    assert (loaded.plan.name, steps_of(loaded.plan)[1].shape) == (name, name)  # type: ignore[union-attr]
    assert loads(dumps(loaded.file)).file == loaded.file


# --- the hash ---


def test_comments_order_and_the_fleet_do_not_change_the_hash() -> None:
    top = yaml.safe_load(TEXT)
    turned = {
        key: dict(reversed(v.items())) if isinstance(v, dict) else v
        for key, v in reversed(top.items())
    }
    plan = loads(TEXT).plan
    assert loads(json.dumps(turned)).plan.hash() == plan.hash()
    assert (
        loads("# a word\n" + TEXT.replace("  r: 4.5", "  r: 4.5   # metres? no: units")).plan.hash()
        == plan.hash()
    )
    assert loads(without_section("fleet")).plan.hash() == plan.hash()
    agents = TEXT[TEXT.index("  - {id: 1, start") : TEXT.index("shapes:")]
    reordered = "".join(reversed(agents.splitlines(keepends=True)))
    assert loads(edited((agents, reordered))).plan.hash() == plan.hash()


CHANGES = {
    "name: trio": "name: trios",
    "-35.36": "-35.361",
    "149.16": "149.161",
    "584": "585",
    "unit_m: 5": "unit_m: 5.001",
    "tick_s: 0.05": "tick_s: 0.04",
    "law:": "prepare_timeout_s: 99\nlaw:",
    "r: 4.5": "r: 4.6",
    "r_out: 1.5": "r_out: 1.4",
    "r_in: 0.5": "r_in: 0.4",
    "kappa: 20": "kappa: 19",
    "  kappa: 20": "  kappa: 20\n  h: 0.04",
    "  kappa: 20\n": "  kappa: 20\n  delta_l: 2.1\n",
    "kappa: 20\n": "kappa: 20\n  delta_a: 0.2\n",
    "20\n": "20\n  h: 0.05\n  compensation: none\n",
    "law:\n": "law:\n  own: leader\n  parameters: {rate: 1.5}\n",
    "{id: 1, start": "{id: 4, start",
    "[0, 3]": "[0, 3.1]",
    "side: 2": "side: 2.1",
    "  row:\n": "  spare: {kind: line, spacing: 3}\n  row:\n",
    "count: 3": "count: 3, rotation_deg: 10",
    "{kind: ring, count: 3, side: 2}": "{kind: column, spacing: 2}",
    "height_m: 10": "height_m: 11",
    "height_m: 10}": "height_m: 10, timeout_s: 44}",
    "shape: ring": "shape: row",
    "shape: ring}": "shape: ring, tolerance_m: 0.4}",
    "{shape: ring}": "{shape: ring, settle_s: 4}",
    "form: {shape: ring}": "form: {shape: ring, slots: fixed}",
    "duration_s: 10": "duration_s: 11",
    "duration_s: 10}": "duration_s: 10, timeout_s: 44}",
    "timeout_s: 60": "timeout_s: 61",
    "- land\n": "- land: {timeout_s: 44}\n",
    "agent_lost: land": "agent_lost: hold",
    "agent_lost: land\n": "agent_lost: land\n  agent_lost_after_s: 4\n",
    "policies:": "policies:\n  station_lost: continue",
    "policies:\n": "policies:\n  station_lost_after_s: 4\n",
    "policies:\n ": "policies:\n  hold_before_land_s: 4\n ",
    "shapes:": "vehicle: {response: {dead_time_s: 0.3}}\nshapes:",
    "shapes:\n": "vehicle: {response: {lag_s: 0.3}}\nshapes:\n",
    "shapes:\n ": "vehicle: {response: {acceleration_mps2: 2}}\nshapes:\n ",
    "shapes:\n  ": "vehicle: {response: {doubt_s: 0.2}}\nshapes:\n  ",
    "agents:\n  - {id: 1, start": "vehicle: {limits: {speed_mps: 4}}\nagents:\n  - {id: 1, start",
    "steps:": "vehicle: {limits: {climb_mps: 2}}\nsteps:",
    "steps:\n": "vehicle: {limits: {descent_mps: 0.6}}\nsteps:\n",
    "{height_m: 10}": "{height_m: 10, on_timeout: return}",
    "{shape: ring": "{on_timeout: hold, shape: ring",
    "  - form: {shape: ring": "  - form: {neighbours: [[1, 2], [1, 3]], shape: ring",
    "hold: {": "hold: {on_timeout: continue, ",
    "  - hold:": "  - split: {pair: [hold: {duration_s: 3}]}\n  - form: {shape: ring}\n  - hold:",
    "    kind: offsets": "    up_m: [0, 0, 8]\n    kind: offsets",
    "fleet:": "neighbours: [[1, 2], [1, 3]]\nfleet:",
    "fleet:\n": "fence: {height_m: 100}\nfleet:\n",
    "  trust: keys\n": "  trust: keys\nzones: {x: {circle: [30, 30], radius: 1}}\n",
    "fleet:\n  ": "targets: {boat: {adsb: a1b2c3}}\nfleet:\n  ",
    "fleet:\n ": "fence: {polygon: [[-10, -10], [-10, 10], [10, 0]]}\nfleet:\n ",
    "policies:\n  agent_lost": "policies:\n  fence: hold\n  agent_lost",
    "policies:\n  agent_lost:": "policies:\n  battery_low: return\n  agent_lost:",
    "policies:\n  agent_lost: ": "policies:\n  battery_reserve_percent: 30\n  agent_lost: ",
    "policies:\n  agent_lost: l": "policies:\n  too_fast: hold\n  agent_lost: l",
    "policies:\n  agent_lost: la": "policies:\n  max_speed_mps: 9\n  agent_lost: la",
    "policies:\n  agent_lost: lan": "policies:\n  max_tilt_deg: 30\n  agent_lost: lan",
    "policies:\n  agent_lost: land": "policies:\n  return_separation_m: 2\n  agent_lost: land",
    "policies:\n  a": "policies:\n  wind: hold\n  override_pause_s: 9\n  left_by_order: hold\n  a",
    "policies:\n  ag": "policies:\n  wind_limit_mps: 8\n  estimate: land\n"
    "  position_accuracy_m: 2\n  position_accuracy_flight_m: 3\n  ag",
    "policies:\n  agent_lost: land\n": "policies:\n  return_speed_mps: 2\n  agent_lost: land\n",
}


def changed(old: str, new: str) -> str:
    text = edited((old, new))
    text = text.replace("steps:", "groups: {pair: [1, 2]}\nsteps:") if "split" in new else text
    return text.replace("{id: 1, sysid: 1", "{id: 4, sysid: 1") if "id: 4" in new else text


def test_the_papers_law_has_a_name() -> None:
    """`own: paper` flies what a mission without `own` flies; the error of another name says it."""
    plan = loads(edited(("law:\n", "law:\n  own: paper\n"))).plan
    assert plan.hash() == loads(TEXT).plan.hash()
    with pytest.raises(MissionError, match=r"allowed: paper\b"):
        loads(edited(("law:\n", "law:\n  own: bogus\n")))


def test_every_value_is_in_the_hash() -> None:
    """A field added to the plan has to be added to CHANGES, too: this counts the leaves that they
    reach."""

    def leaves(value: object, name: str = "") -> dict[str, object]:
        if dataclasses.is_dataclass(value) and not isinstance(value, type):
            value = {
                f"{type(value).__name__}.{f.name}": getattr(value, f.name)
                for f in dataclasses.fields(value)
            }
        if isinstance(value, dict):
            return {k: v for key, inner in value.items() for k, v in leaves(inner, key).items()}
        if isinstance(value, tuple) and value and dataclasses.is_dataclass(value[0]):
            merged: dict[str, object] = {}
            for inner in value:
                for key, leaf in leaves(inner, name).items():
                    merged[key] = (merged.get(key), leaf)
            return merged
        return {name: value}

    plan = loads(TEXT).plan
    before, reached = leaves(plan), set[str]()
    for old, new in CHANGES.items():
        other = loads(changed(old, new)).plan
        assert other.hash() != plan.hash(), new
        after = leaves(other)
        reached |= {
            key for key in before.keys() | after.keys() if before.get(key) != after.get(key)
        }
    constant = {f"{kind}.kind" for kind in ("TakeoffStep", "FormStep", "HoldStep", "LandStep")}
    constant |= {"LandStep.on_timeout", "GroupPlan.name"}  # always to land; of the only group
    constant |= {"Plan.wake"}  # none here, and behind a change its own fields
    assert set(before) - reached <= constant


# --- fleets ---


def test_the_same_mission_flies_with_another_fleet(tmp_path: Path) -> None:
    (tmp_path / "outdoors.yaml").write_text(
        "version: 1\nagents:\n"
        + "".join(f"  - {{id: {k}, sysid: {k + 10}}}\n" for k in (1, 2, 3, 4))
    )
    named = tmp_path / "named.yaml"
    named.write_text(without_section("fleet") + "fleet: outdoors.yaml\n")
    inline = tmp_path / "inline.yaml"
    inline.write_text(TEXT)
    by_name, by_argument = load(named), load(inline, fleet=tmp_path / "outdoors.yaml")
    assert [entry.sysid for entry in by_name.fleet.agents] == [11, 12, 13]
    assert by_name.fleet == by_argument.fleet
    assert by_name.plan == by_argument.plan == load(inline).plan
    assert [w.partition(" ")[2] for w in by_name.warnings] == [
        "fleet.agents#4: agent 4 is not in this mission"
    ]
    assert by_name.warnings[0].startswith(f"{tmp_path / 'outdoors.yaml'}:6:")


def test_mistakes_in_a_fleet_file_are_shown_in_that_file(tmp_path: Path) -> None:
    fleet = tmp_path / "fleet.yaml"
    fleet.write_text("agents:\n  - {id: 1}\n  - {id: 2, sysid: 1}\n  - {id: 3}\nagents: []\n")
    mission = tmp_path / "m.yaml"
    mission.write_text(without_section("fleet") + "fleet: fleet.yaml\n")
    with pytest.raises(MissionError) as caught:
        load(mission)
    assert [(p.where, p.field) for p in caught.value.problems] == [
        (f"{fleet}:3", "fleet.agents#2.sysid"),
        (f"{fleet}:5", "fleet.agents"),
    ]


@pytest.mark.parametrize(
    ("content", "line_in_fleet", "what"),
    [
        (None, None, "can't be read"),
        ("", 1, "is empty"),
        ("a: [", 1, "YAML"),
        ("- 1", 1, "is a list"),
    ],
)
def test_unreadable_fleet_files(
    tmp_path: Path, content: str | None, line_in_fleet: int | None, what: str
) -> None:
    fleet, mission = tmp_path / "f.yaml", tmp_path / "m.yaml"
    if content is not None:
        fleet.write_text(content)
    mission.write_text(without_section("fleet") + "fleet: f.yaml\n")
    with pytest.raises(MissionError) as caught:
        load(mission)
    (problem,) = caught.value.problems
    expected = f"{mission}:31" if line_in_fleet is None else f"{fleet}:{line_in_fleet}"
    assert (problem.where, problem.field) == (expected, "fleet")
    assert what in problem.what
    assert "f.yaml" in str(problem)


# --- warnings ---

CLOSE = (
    "agents: agents 1 and 2 start 0.89 units (4.45 m) apart, inside each other's avoidance region"
    " (law.r_out, 1.5 units (7.5 m)): they may come under law.r_in as they take off in wind"
)


@pytest.mark.parametrize(
    ("edit", "line", "text"),
    [
        (
            ("[0, 3]", "[0, 1]"),
            11,
            CLOSE.replace("0.89 units (4.45 m)", "1 units (5 m)") + " of more than 4 m/s",
        ),
        (("[0, 3]", "[0, 0.89]"), 11, f"{CLOSE}, and as they land there"),
        (
            ("- [0, 4]", "- [0, 5]"),
            27,
            (
                "step 4, form.shape: row stretches the link 1-2 to 5 units (25 m), beyond law.r ="
                " 4.5 units (22.5 m); r of 5 units (25 m) is enough"
            ),
        ),
        (
            ("hold: {duration_s: 10}", "move: {by: [160, 0]}"),
            26,
            "step 3, move: goes 160 units (800 m) from the starts, out of a pilot's sight",
        ),
        (
            ("hold: {duration_s: 10}", "hold: {duration_s: 1000}"),
            26,
            "step 3, hold: takes 1000 s at least, of a flight of 1020 s: most batteries end",
        ),
        (
            ("hold: {duration_s: 10}", "move: {by: [1, 0], speed_mps: 0.1}"),
            26,
            "step 3, move.speed_mps: 0.1 m/s is less than a GPS position drifts",
        ),
        (
            ("hold: {duration_s: 10}", "rotate: {angle_deg: 1.57}"),
            26,
            "step 3, rotate.angle_deg: 1.57 degrees; if radians were meant: 90",
        ),
        (("height_m: 10", "height_m: 1"), 24, "step 1, takeoff.height_m: 1 m: rotors blow back"),
        (
            ("shape: ring}", "shape: ring, tolerance_m: 6}"),
            25,
            "step 2, form.tolerance_m: 6 m is more than half of what ring's slots are apart",
        ),
        (
            ("  agent_lost: land", "  max_speed_mps: 4"),
            30,
            "policies.max_speed_mps: 4 m/s is not above vehicle.limits.speed_mps = 5: land",
        ),
        (
            ("  agent_lost: land", "  battery_reserve_percent: 80"),
            30,
            "policies.battery_reserve_percent: 80 %: land with more than half of the battery",
        ),
        (("r_in: 0.5", "r_in: 0.1"), 9, "law.r_in: 0.5 m"),
        (
            ("  kappa: 20", "  kappa: 20\n  h: 0.05\n  compensation: none"),
            12,
            "law.compensation: none, with kappa",
        ),
        (("  kappa: 20", "  kappa: 20\n  h: 0.3"), 11, "law.h: kappa * h [1/s] is 6, outside"),
        (
            ("  kappa: 20", "  kappa: 20\n  h: 0.1\nsafety: {release: false}"),
            11,
            "law.h: kappa * h = 2: above 1 the agents block each other more often",
        ),
        (("shape: row", "shape: ring"), 17, "shapes.row: no step forms it"),
        (
            ("  row:", "  pair: {kind: line, spacing: 3, count: 2}\n  row:"),
            17,
            "shapes.pair: no step forms it, and no order can: it has 2 slots for 3 agents",
        ),
        (
            ("  agent_lost: land", "  wind_limit_mps: 8"),
            30,
            "policies.wind_limit_mps: acts only on vehicles that estimate the wind",
        ),
    ],
)
def test_what_is_allowed_but_doubtful_is_said(edit: tuple[str, str], line: int, text: str) -> None:
    (warning,) = loads(edited(edit), "trio.yaml").warnings
    assert warning.startswith(f"trio.yaml:{line}: {text}")


def test_many_stretched_links_are_one_warning_with_what_is_enough() -> None:
    """Where links chosen anew would be short enough, that is said, too; the heading counts."""
    narrow = (MISSIONS / "sweep.yaml").read_text().replace("r: 50", "r: 11")
    (warning,) = loads(narrow).warnings
    assert "line stretches 4 links, the longest 4-5 to 12 m, beyond law.r = 11 m" in warning
    assert warning.endswith("; r of 12 m is enough")
    assert loads(narrow.replace("r: 11", "r: 12")).warnings == ()
    crossed = edited(
        ("  r: 4.5", "  r: 3.5"),
        ("start: [3, 0]", "start: [0, 6]"),
        ("[0, 2]\n      - [0, 4]", "[0, 4]\n      - [0, 2]"),
        ("form: {shape: ring}", "form: {shape: row, slots: fixed}"),
        ("form: {shape: row, timeout", "form: {shape: row, slots: fixed, timeout"),
        ("  ring: {kind: ring, count: 3, side: 2}\n", ""),
    )
    first, second = loads(crossed).warnings
    assert "step 2, form.shape: row stretches the link 1-2 to 4 units" in first
    assert "rechoose" not in first, "from the starts it gives the same links"
    assert second.endswith("; r of 4 units (20 m) is enough, or neighbours: rechoose in this step")
    rechosen = crossed.replace("fixed, timeout", "fixed, neighbours: rechoose, timeout")
    assert len(loads(rechosen).warnings) == 1


# --- the handbook ---


def examples(name: str) -> list[str]:
    """The mission files' parts on a page."""
    return [block.text for block in blocks(PAGES[name]) if block.language == "yaml"]


def test_the_examples_in_the_pages_of_missions_are_right(tmp_path: Path) -> None:
    mission, faults = examples("missions")
    (lanes,) = examples("search-pattern")
    fence, zones = examples("geofence")
    (letters,) = examples("letters")
    _, layers, wake = examples("altitude")
    (boat,) = examples("follow")
    (split,) = examples("groups")
    fleet, routers = examples("fleets")
    twelve = (MISSIONS / "letters.yaml").read_text()
    (all_twelve,) = loads(twelve.partition("shapes:")[0] + letters).plan.groups
    assert len(all_twelve.steps) == 5
    nine = (MISSIONS / "layers.yaml").read_text().partition("wake:")
    agents = nine[2].partition("\n")[2].partition("shapes:")[0]
    (in_layers,) = loads(nine[0] + wake + agents + layers).plan.groups
    assert len(in_layers.steps) == 4
    sweep = (MISSIONS / "sweep.yaml").read_text()
    assert loads(sweep.partition("shapes:")[0] + lanes + fence).plan.fence.height_m == 40
    assert [zone.name for zone in loads(mission + zones).plan.zones] == ["oak", "house"]
    (group,) = loads(mission.partition("shapes:")[0] + boat).plan.groups
    assert [step.follows.offset_m for step in group.steps if step.follows] == [(-20.0, 0.0)]
    groups = (MISSIONS / "groups.yaml").read_text()
    plan = loads(groups.partition("groups:")[0] + split).plan
    assert [group.name for group in plan.groups] == ["all", "scouts", "sweepers", "rest", "all"]
    assert len(loads(mission + faults).file.simulation.faults) == 3
    loaded = loads(mission + "fleet:\n" + textwrap.indent(fleet, "  "))
    assert loaded.plan == loads(mission).plan
    assert [entry.sysid for entry in loaded.fleet.agents] == [11, 12]
    assert loaded.warnings == ()
    (tmp_path / "large.yaml").write_text(routers)
    named = [entry.router for entry in read_fleet(tmp_path / "large.yaml").agents]
    assert named == ["tcp/192.168.1.11:7447", "tcp/192.168.1.12:7447"]


def test_the_missions_readme_names_every_mission() -> None:
    text = (MISSIONS / "README.md").read_text()
    assert {path.name for path in MISSIONS.glob("*.yaml") if f"`{path.name}`" not in text} == set()
