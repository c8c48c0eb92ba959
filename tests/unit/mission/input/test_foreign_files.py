"""A file of another program is refused in one line that names it; every mission of ours is read."""

from __future__ import annotations

from pathlib import Path

import pytest

from swarm_ctl.errors import MissionError
from swarm_ctl.mission.compile.loader import load

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
