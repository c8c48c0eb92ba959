"""What a command would leave unread is refused with what would be allowed, before anything runs."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from swarm_ctl.cli.app import main

MISSIONS = Path(__file__).parents[3] / "missions"
TRACK, NMEA = "target boat --from a.csv", "target boat --from nmea:tcp:127.0.0.1:9"


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (f"{TRACK} --late 1", "--late with --from a.csv; allowed: with a receiver (nmea, gpsd, ma"),
        (f"{TRACK} --system 0", "--system with --from a.csv; allowed: with mavlink:ENDPOINT"),
        (f"{NMEA} --icao abcdef", "--icao with --from nmea:tcp:127.0.0.1:9; allowed: with mavlink"),
        (f"{NMEA} --faster 2", "9; allowed: with a .csv or .gpx track"),
        (f"{TRACK} --run a --mission b.yaml", "both --run a and --mission b.yaml; allowed: one of"),
        ("send hold --foo", "--foo: no such option; allowed: --run, --agents, --by, --speed"),
        ("send move -20 3 --sped=2", "--sped: no such option; did you mean --speed?; allowed: "),
        ("fuzz MISSION --replay a.yaml", "--replay a.yaml: a scenario has its own mission"),
        ("evidence --list --row mix", "--list flies none; allowed: that alone"),
        ("compare a b --out a/run.json", "--out a/run.json: is no page; allowed: a .html file"),
        ("plan MISSION --out MISSION", ": the plan is made from this file; choose another one"),
        ("plan MISSION --fleet fleet.yaml --out fleet.yaml", "--out fleet.yaml: the plan is made"),
        ("plan with.yaml --out fleet.yaml", "--out fleet.yaml: the plan is made from this file"),
    ],
)
def test_what_would_be_left_unread_is_refused(
    arguments: str,
    said: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """Exit code 2, the option's name, and no file changes: an option of another source or way of
    running, and an output in the place of what it is made from."""
    monkeypatch.chdir(tmp_path)
    shutil.copy(MISSIONS / "hexagon.yaml", "hexagon.yaml")
    fleet = "version: 1\nagents:\n" + "".join(f"  - {{id: {k}}}\n" for k in range(1, 7))
    Path("fleet.yaml").write_text(fleet)
    bare = Path("hexagon.yaml").read_text().partition("\nfleet:")[0]
    Path("with.yaml").write_text(f"{bare}\nfleet: fleet.yaml\n")
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    words = arguments.replace("MISSION", "hexagon.yaml").split()
    monkeypatch.setattr("sys.argv", ["swarm-ctl", *words])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 2
    assert said in capsys.readouterr().err
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before
