"""How each autopilot is started: its files, its command line, its ports.

Everything that it writes lands in its own folder, so its binary may stand where nothing can be
written.
"""

from __future__ import annotations

import contextlib
import shutil
from abc import ABC, abstractmethod
from collections.abc import Callable
from pathlib import Path
from typing import Final, cast

from swarm_ctl.core.model.fleet import VehicleKind
from swarm_ctl.engine.vehicles.containers import Container, Image
from swarm_ctl.engine.vehicles.homes import DEFAULTS, home
from swarm_ctl.engine.vehicles.order import VehicleOrder
from swarm_ctl.errors import StartError
from swarm_ctl.mavlink.onlooker import Onlooker

_BOOT_SPEEDUP: Final = 30.0
"""ArduCopter arms after 45 s of its own time: it boots as fast as the machine can."""


class Sitl(ABC):
    """One autopilot: `folder` is its own, `instance` its ports."""

    def __init__(self, order: VehicleOrder, instance: int, folder: Path, speedup: float) -> None:
        self.order = order
        self.instance = instance
        self.folder = folder
        self.speedup = speedup

    @property
    def output(self) -> Path:
        """What it prints."""
        return self.folder / "output.log"

    @property
    @abstractmethod
    def endpoint(self) -> str:
        """Its agent's end of the link."""

    @property
    @abstractmethod
    def ground_station(self) -> str:
        """A ground station's end of a link."""

    @property
    @abstractmethod
    def onlooker(self) -> str:
        """The end of the link of the process that starts it."""

    @abstractmethod
    def prepare(self) -> list[str]:
        """Write its files; its command line."""

    @property
    def environment(self) -> dict[str, str]:
        """What it needs beside ours."""
        return {}

    @abstractmethod
    def set_up(self, seen: Onlooker, now: float) -> bool:
        """Bring it to where an agent may take it over; to be called until True."""

    def clean(self) -> None:
        """Remove what it leaves outside its folder."""
        return


def remove_leftovers(kind: VehicleKind, instance: int) -> None:
    """Remove what an ended autopilot left outside its folder: PX4 keeps a socket and a lock for
    each instance, and can't start beside old ones."""
    names = (f"px4-sock-{instance}", f"px4_lock-{instance}") if kind is VehicleKind.PX4 else ()
    for name in names:
        with contextlib.suppress(OSError):  # another user's, or none
            Path("/tmp", name).unlink()  # noqa: S108


class ArduCopter(Sitl):
    """ArduCopter, maybe in a container; MAVLink on three TCP ports, one client each."""

    _container: Container | None = None

    @property
    def _port(self) -> int:
        return 5760 + 10 * self.instance

    @property
    def endpoint(self) -> str:
        return f"tcp:127.0.0.1:{self._port}"

    @property
    def ground_station(self) -> str:
        return f"tcp:127.0.0.1:{self._port + 2}"

    @property
    def onlooker(self) -> str:
        return f"tcp:127.0.0.1:{self._port + 3}"

    def prepare(self) -> list[str]:
        # fmt: off
        return [
            *self._program(), "--model", "quad", "--speedup", f"{_BOOT_SPEEDUP:g}",
            "-I", str(self.instance), "--serial0", "tcp:0", "--sysid", str(self.order.sysid),
            "--home", home(self.order.place), "--defaults", str(self._defaults()),
        ]
        # fmt: on

    def set_up(self, seen: Onlooker, now: float) -> bool:
        if not seen.may_arm:
            seen.ask_if_ready(now)
            return False
        return seen.set("SIM_SPEEDUP", self.speedup, now)

    def clean(self) -> None:
        if self._container:
            self._container.end()

    def _program(self) -> list[str]:
        binary = self.order.binary
        if isinstance(binary, Path):
            return [str(binary)]
        self._container = Container(binary)
        return self._container.command("arducopter", self.folder)

    def _defaults(self) -> Path:
        """The parameters of a simulated copter: beside the binary, as in its source tree, ours; in
        a container ours, where it sees them."""
        binary = self.order.binary
        if isinstance(binary, Image):
            return Path(shutil.copy(DEFAULTS, self.folder))
        source = Path("Tools", "autotest", "default_params", "copter.parm")
        trees = [parent / source for parent in list(binary.parents)[2:4]]
        files = [binary.with_name("copter.parm"), *trees, DEFAULTS]
        return next(file for file in files if file.is_file())


class Px4Sitl(Sitl):
    """PX4 with its own simulation; an onboard UDP link for its agent, one for ground stations."""

    @property
    def endpoint(self) -> str:
        return f"udpin:127.0.0.1:{14540 + self.instance}"

    @property
    def ground_station(self) -> str:
        return f"udpout:127.0.0.1:{18570 + self.instance}"

    @property
    def onlooker(self) -> str:
        return f"udpin:127.0.0.1:{14030 + self.instance}"

    @property
    def environment(self) -> dict[str, str]:
        at = self.order.place
        speed = {"PX4_SIM_SPEED_FACTOR": f"{self.speedup:g}"} if self.speedup != 1.0 else {}
        return {
            "PX4_SIM_MODEL": "sihsim_quadx",
            "PX4_SIMULATOR": "sihsim",
            "PX4_HOME_LAT": f"{at.lat_deg:.8f}",
            "PX4_HOME_LON": f"{at.lon_deg:.8f}",
            "PX4_HOME_ALT": f"{at.alt_m:.2f}",
        } | speed

    def prepare(self) -> list[str]:
        """PX4 looks for its commands beside the path by which it was called, and for the two
        scripts on the PATH, of which that is the first place."""
        self.clean()
        build = cast("Path", self.order.binary)  # `binaries.find` refuses an image
        own, theirs = self.folder / "bin", build / "bin"
        own.mkdir()
        names = {path.name for path in theirs.glob("px4-*")} - {"px4-alias.sh"}
        for name in ("px4", *names):
            (own / name).symlink_to(theirs / "px4")
        (own / "px4-alias.sh").symlink_to(theirs / "px4-alias.sh")
        parameters = _PARAMETERS.format(sysid=self.order.sysid)
        (own / "px4-rc.params").write_text(parameters + _NO_LOG * (not self.order.logs))
        (own / "px4-rc.mavlink").write_text(_LINKS)
        instance, etc = str(self.instance), str(build / "etc")
        return [str(own / "px4"), "-i", instance, "-d", etc, "-w", str(self.folder)]

    def set_up(self, seen: Onlooker, now: float) -> bool:  # noqa: ARG002
        if seen.heartbeats and "bind failed" in self.output.read_text(errors="replace"):
            # It runs on without the link.
            raise StartError(
                f"px4 of agent {self.order.agent}: another program took a port of instance"
                f" {self.instance} just before; start again"
            )
        return seen.heartbeats > 0

    def clean(self) -> None:
        remove_leftovers(VehicleKind.PX4, self.instance)


_PARAMETERS: Final = """\
# Sourced by rcS after its own settings.
param set MAV_SYS_ID {sysid}
# rcS multiplies these by PX4_SIM_SPEED_FACTOR, though they count simulated seconds: the failsafes
# of a fast simulation would come late by so much.
param reset COM_DL_LOSS_T COM_RC_LOSS_T COM_OF_LOSS_T COM_OBC_LOSS_T
# As PX4 flies, not as rcS tests it: a tenth of the log, no FFT of the gyros.
param set SDLOG_PROFILE 1
param set IMU_GYRO_FFT_EN 0
"""
_NO_LOG: Final = "param set SDLOG_MODE -1\n"
"""Else 15 MB a minute."""
_LINKS: Final = """\
# Ground stations, the agent, and who looks on; PX4's own file opens more, and the same port for
# instances over 9.
mavlink start -x -u $((18570+px4_instance)) -r 4000000 -f
mavlink start -x -u $((14580+px4_instance)) -r 4000000 -f -m onboard -o $((14540+px4_instance))
mavlink start -x -u $((14280+px4_instance)) -r 4000 -m minimal -o $((14030+px4_instance))
"""

MAKERS: Final[dict[VehicleKind, Callable[[VehicleOrder, int, Path, float], Sitl]]] = {
    VehicleKind.ARDUCOPTER: ArduCopter,
    VehicleKind.PX4: Px4Sitl,
}
