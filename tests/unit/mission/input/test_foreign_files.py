"""A file of another program is refused in one line that names it; every mission of ours is read."""

from __future__ import annotations

from pathlib import Path

import pytest

from swarm_ctl.errors import MissionError
from swarm_ctl.mission.compile.loader import load
from swarm_ctl.study.parameter_space import study_file
from swarm_ctl.virtual.scenario import load_scenario

HEXAGON = Path("missions/hexagon.yaml")

FILES = {
    "a QGroundControl plan": '{\n  "fileType": "Plan",\n  "geoFence": {"circles": []}\n}',
    "a GeoJSON file": '{"type": "FeatureCollection", "features": []}',
    "a KML file": '<?xml version="1.0"?>\n<!-- made by hand -->\n<kml></kml>',
    "a GPX file": '<?xml version="1.0"?>\n<gpx version="1.1"></gpx>',
    "a waypoint file (QGC WPL)": "QGC WPL 110\n0\t1\t0\t16\t0\t0\t0\t0\t-35.3\t149.1\t584\t1\n",
    "a crazyflies.yaml (Crazyswarm2)": "robots:\n  cf1: {enabled: true}\nrobot_types:\n  a: 1\n",
    "a zip archive (a Skybrush show or a .kmz)": "PK\x03\x04\x14\x00",
    "a CSV table": "t [ms],x [m],y [m],z [m]\n0,1,2,3\n",
}  # fmt: skip


@pytest.mark.parametrize("name", FILES)
def test_a_file_of_another_program_is_named_in_one_line(name: str, tmp_path: Path) -> None:
    """One problem: what the file is, and how to begin a mission."""
    path = tmp_path / "given"
    path.write_text(FILES[name])
    with pytest.raises(MissionError) as caught:
        load(path)
    (problem,) = caught.value.problems
    assert problem.what == f"this is {name}, no mission"
    assert "swarm-ctl missions copy" in problem.allowed


OWN = {
    "a plan file": '{\n  "schema_version": 3,\n  "plan": {}\n}',
    "a scenario": "version: 1\nname: rough\nmission: pair.yaml\nhappens: []\n",
    "a study": "missions: 50\nlaw: {h: 0.1}\n",
    "a fleet": "version: 1\nagents:\n  - {id: 1, sysid: 11}\n",
}


@pytest.mark.parametrize("name", OWN)
def test_another_file_of_ours_is_named_in_one_line(name: str, tmp_path: Path) -> None:
    """Not as a mission in which each field is wrong; and what takes such a file is said."""
    path = tmp_path / "given"
    path.write_text(OWN[name])
    with pytest.raises(MissionError) as caught:
        load(path)
    (problem,) = caught.value.problems
    assert (problem.where, problem.what) == (f"{path}:1", f"this is {name}, no mission")
    assert "swarm-ctl" in problem.allowed or "--fleet" in problem.allowed


def test_a_mission_is_no_fleet_no_scenario_and_no_study(tmp_path: Path) -> None:
    """Where `--fleet` names it, `fuzz --replay` or `study`: one line, too. A mission without its
    steps is still one, with its own mistakes."""
    with pytest.raises(MissionError, match="this is a mission, no fleet"):
        load(HEXAGON, fleet=HEXAGON)
    with pytest.raises(MissionError, match="this is a mission, no scenario"):
        load_scenario(HEXAGON)
    with pytest.raises(MissionError, match="this is a mission, no study"):
        study_file(HEXAGON, {})
    begun = tmp_path / "begun.yaml"
    begun.write_text("version: 1\nagents:\n  - {id: 1, start: [0, 0]}\n")
    with pytest.raises(MissionError, match="steps: is missing"):
        load(begun)


def test_a_fleet_that_is_not_there_is_not_looked_for_in_the_mission() -> None:
    """`--fleet nope` is blamed itself, not the last line of a mission that names no fleet."""
    with pytest.raises(MissionError) as caught:
        load(HEXAGON, fleet="nope")
    assert [problem.where for problem in caught.value.problems] == ["nope"]


@pytest.mark.parametrize(("row", "between"), [("0;2", "semicolons"), ("0\t2", "tabs")])
def test_slots_between_other_marks_are_refused_by_the_marks_name(
    row: str, between: str, tmp_path: Path
) -> None:
    """A spreadsheet's export: the message says what stands between the cells."""
    mission = (
        Path("missions/hexagon.yaml")
        .read_text()
        .replace("{kind: ring,", "{kind: csv, path: slots.csv} #", 1)
    )
    (tmp_path / "m.yaml").write_text(mission)
    (tmp_path / "slots.csv").write_text("\n".join([row] * 6))
    with pytest.raises(MissionError, match=f"has {between} between its cells"):
        load(tmp_path / "m.yaml")
