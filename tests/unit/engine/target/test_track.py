"""Tracks: played as they were recorded; what is none is refused by its line."""

from __future__ import annotations

from pathlib import Path

import pytest

from swarm_ctl.engine.target.teller import RecordedTrack
from swarm_ctl.errors import InputError

CSV = "Time, Lat, Lon, Alt\n10, 47.0, 8.0, 400\n20, 47.001, 8.0, 410\n40, 47.001, 8.002, 410\n"
GPX = """<?xml version="1.0"?>
<gpx xmlns="http://www.topografix.com/GPX/1/1"><trk><trkseg>
<trkpt lat="47.0" lon="8.0"><ele>400</ele><time>2026-11-26T10:00:00Z</time></trkpt>
<trkpt lat="47.001" lon="8.0"><ele>410</ele><time>2026-11-26T10:00:10Z</time></trkpt>
</trkseg></trk></gpx>
"""


def written(folder: Path, name: str, text: str) -> Path:
    path = folder / name
    path.write_text(text)
    return path


@pytest.mark.parametrize(("name", "text"), [("t.csv", CSV), ("t.gpx", GPX)])
def test_between_its_points_a_target_goes_straight(name: str, text: str, tmp_path: Path) -> None:
    """111.2 m in 10 s are 11.1 m/s; played twice as fast, twice that."""
    track = RecordedTrack(written(tmp_path, name, text))
    word = track.word("boat", 5.0, 2.0)
    assert word.latitude_deg == pytest.approx(47.0005)
    assert word.altitude_m == pytest.approx(405.0)
    assert word.velocity_ned_mps is not None
    assert word.velocity_ned_mps == pytest.approx((22.24, 0.0, -2.0), abs=0.05)
    assert track.word("boat", 1e6, 1.0).latitude_deg == pytest.approx(47.001)


@pytest.mark.parametrize(
    ("name", "text", "words"),
    [
        ("t.csv", "time,lat\n1,2\n", "has no column lon"),
        ("t.csv", "time,lat,lon\n1,47,8\n", "at least two"),
        ("t.csv", "time,lat,lon\n1,47,8\n1,47,8\n", "times that grow"),
        ("t.csv", "time,lat,lon\n1,47,8\n2,x,8\n", "line 3"),
        ("t.csv", "time,lat,lon\n1,47,8\n2,97,8\n", "nowhere on earth"),
        ("t.csv", "time,lat,lon\n1,47,8\n2,nan,8\n", "nowhere on earth"),
        ("t.csv", "time,lat,lon\n1,47\n2,47,8\n", "line 2"),
        ("t.csv", "", "has no column"),
        ("t.gpx", "<gpx", "is no XML"),
        ("t.gpx", "<!DOCTYPE x [<!ENTITY a 'b'>]><gpx/>", "DOCTYPE"),
        ("t.gpx", GPX.replace("<time>2026-11-26T10:00:10Z</time>", ""), "track point 2"),
    ],
)
def test_what_is_no_track_is_refused_by_its_line(
    name: str, text: str, words: str, tmp_path: Path
) -> None:
    with pytest.raises(InputError, match=words) as refused:
        RecordedTrack(written(tmp_path, name, text))
    assert "allowed" in str(refused.value)
    with pytest.raises(InputError, match="can't be read: No such file or directory; allowed: "):
        RecordedTrack(tmp_path / f"no-{name}")
