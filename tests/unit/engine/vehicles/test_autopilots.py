"""The files and command lines of each autopilot; nothing is written beside its program."""

from __future__ import annotations

from pathlib import Path
from unittest.mock import Mock

import pytest

from swarm_ctl.core.model.fleet import VehicleKind
from swarm_ctl.core.model.plan import Geodetic
from swarm_ctl.engine.vehicles.autopilots import ArduCopter, Px4Sitl, Sitl
from swarm_ctl.engine.vehicles.order import VehicleOrder
from swarm_ctl.errors import StartError

PLACE = Geodetic(-35.363262, 149.165237, 584.0)


def _sitl(kind: VehicleKind, binary: Path, tmp_path: Path, speedup: float = 1.0) -> Sitl:
    folder = tmp_path / "own"
    folder.mkdir()
    maker = ArduCopter if kind is VehicleKind.ARDUCOPTER else Px4Sitl
    return maker(VehicleOrder(3, 7, kind, binary, PLACE), 30, folder, speedup)


@pytest.mark.parametrize("beside", [True, False])
def test_arducopter_stands_at_its_place_with_the_parameters_beside_its_program_or_ours(
    tmp_path: Path, beside: bool
) -> None:
    theirs = tmp_path / "copter.parm"
    if beside:
        theirs.touch()
    command = _sitl(VehicleKind.ARDUCOPTER, tmp_path / "arducopter", tmp_path).prepare()
    told = dict(zip(command[1::2], command[2::2], strict=True))
    assert told["--home"] == "-35.36326200,149.16523700,584.00,0"
    assert (told["-I"], told["--sysid"]) == ("30", "7")
    assert (told["--defaults"] == str(theirs)) is beside
    assert "FRAME_CLASS 1" in Path(told["--defaults"]).read_text() or beside


@pytest.fixture
def px4(tmp_path: Path) -> Path:
    """A PX4 whose links were lost, as archives without links do: each is a small text file."""
    (tmp_path / "bin").mkdir()
    for name in ("px4", "px4-commander", "px4-alias.sh"):
        (tmp_path / "bin" / name).write_text("px4")
    return tmp_path


def test_px4_gets_links_and_scripts_in_its_own_folder(px4: Path, tmp_path: Path) -> None:
    sitl = _sitl(VehicleKind.PX4, px4, tmp_path)
    assert sitl.prepare()[0] == str(sitl.folder / "bin" / "px4")
    commander, alias = (sitl.folder / "bin" / name for name in ("px4-commander", "px4-alias.sh"))
    assert commander.resolve() == px4 / "bin" / "px4"
    assert alias.resolve() == px4 / "bin" / "px4-alias.sh"
    parameters = (sitl.folder / "bin" / "px4-rc.params").read_text()
    assert "param set MAV_SYS_ID 7\n" in parameters
    assert "param set SDLOG_MODE -1\n" in parameters, "no log unless it is asked for"
    assert {path.name for path in (px4 / "bin").iterdir()} == {
        "px4",
        "px4-commander",
        "px4-alias.sh",
    }


def test_a_fast_px4_has_the_failsafe_times_of_a_slow_one(px4: Path, tmp_path: Path) -> None:
    sitl = _sitl(VehicleKind.PX4, px4, tmp_path, speedup=5.0)
    sitl.prepare()
    assert sitl.environment["PX4_SIM_SPEED_FACTOR"] == "5"
    scaled = "COM_DL_LOSS_T COM_RC_LOSS_T COM_OF_LOSS_T COM_OBC_LOSS_T"
    assert f"param reset {scaled}\n" in (sitl.folder / "bin" / "px4-rc.params").read_text()


def test_a_px4_without_its_agents_link_is_an_error(px4: Path, tmp_path: Path) -> None:
    sitl = _sitl(VehicleKind.PX4, px4, tmp_path)
    sitl.output.write_text("INFO  [mavlink] mode: Normal\n")
    assert not sitl.set_up(Mock(heartbeats=0), 0.0)
    assert sitl.set_up(Mock(heartbeats=1), 0.0)
    sitl.output.write_text("WARN  [mavlink] bind failed: Address already in use\n")
    with pytest.raises(StartError, match="took a port of instance 30"):
        sitl.set_up(Mock(heartbeats=1), 0.0)
