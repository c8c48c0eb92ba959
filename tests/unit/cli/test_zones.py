"""`zones` as a user calls it: what it says of the files that it writes, and of fleets."""

from __future__ import annotations

from pathlib import Path

import pytest
from typer.testing import CliRunner

from swarm_ctl.cli.missions.zones import zones
from swarm_ctl.errors import InputError

WOOD = Path(__file__).parents[3] / "missions" / "wood.yaml"


@pytest.mark.parametrize(
    ("name", "lost"),
    [
        ("wood.geojson", "the fence's height"),
        ("wood.kml", "the fence's height"),
        ("wood.plan", "names, ceilings, clearances, the fence's height"),
    ],
)
def test_what_a_file_does_not_have_is_told(name: str, lost: str, tmp_path: Path) -> None:
    ran = CliRunner().invoke(zones, ["write", str(WOOD), str(tmp_path / name)])
    assert ran.exit_code == 0
    said = " ".join(ran.output.split())
    assert said.endswith(f"{name}: 7 zones and the fence; not in it: {lost}")


@pytest.mark.parametrize("command", ["show", "clear"])
def test_two_vehicles_of_one_sysid_are_refused(command: str, tmp_path: Path) -> None:
    """One of them alone would have been asked."""
    path = tmp_path / "fleet.yaml"
    entry = '  - {{id: {0}, sysid: 7, endpoint: "udpout:127.0.0.1:1455{0}"}}\n'
    path.write_text("agents:\n" + entry.format(1) + entry.format(2))
    ran = CliRunner().invoke(zones, [command, "--fleet", str(path)])
    assert isinstance(ran.exception, InputError)
    assert "agents 1 and 2 both have sysid 7; allowed: " in str(ran.exception)
