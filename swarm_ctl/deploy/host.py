"""The host's side: takes a bundle in, starts it, stops it, says how it stands.

    ~/.local/share/swarm-ctl/host/
        bundles/DIGEST/   the files of a bundle
        next              the bundle that was taken in last
        current           the one that runs, or ran last
        flights/TIME/     logs, tlogs and last statuses of each start
        flight            the newest of these
        trust/SWARM/      the keys of this host's members
        bin/swarm-ctl     the program that took the bundle in

Links change in one move, so a host that loses its power has the old bundle or the new one.
"""

from __future__ import annotations

import contextlib
import fcntl
import importlib.util
import os
import shutil
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import IO, Final

from pydantic import TypeAdapter, ValidationError

from swarm_ctl.core.model.messages import AgentStatus, Outcome
from swarm_ctl.deploy.bundle import KEYS, MANIFEST, ROOT, Bundle, BundleManifest, Service
from swarm_ctl.deploy.logs import last_line, pack_logs
from swarm_ctl.deploy.report import HostReport, ReportedState, ServiceReport
from swarm_ctl.deploy.services import Services, services_of, units_of
from swarm_ctl.engine.clock import date_and_time, pause, wall_s
from swarm_ctl.errors import InputError, StartError
from swarm_ctl.files import read_bytes
from swarm_ctl.installed import version
from swarm_ctl.trust import bundle as trust_bundle

_MOST_BYTES: Final = 1 << 20
_LOOK_S: Final = 0.2
_EARLY_S: Final = 2.0
"""A process that can't start has said so by then."""
_STATUS: Final = TypeAdapter(AgentStatus)


class Host:
    """This host's deployment, in its user's home."""

    def __init__(self, home: Path | None = None) -> None:
        self.root = (home or Path.home()) / ROOT
        self.services: Services = services_of(self.root)

    def install(self, bundle: Bundle) -> None:
        """Take a bundle in. What runs goes on as it is."""
        with self._locked():
            folder = self.root / "bundles" / bundle.digest
            if not folder.exists():
                made = folder.with_name(f".{bundle.digest}.{os.getpid()}")
                made.mkdir(mode=0o700, parents=True)
                for name, data in bundle.files.items():
                    with open(made / name, "xb", opener=_private) as file:
                        file.write(data)
                os.sync()
                made.rename(folder)
            self._point("next", Path("bundles") / bundle.digest)

    def start(self, digest: str = "") -> None:
        """Start the bundle that was taken in last, or the current one again: every process of it
        that does not run.

        Raises:
            InputError: it is not the bundle `digest`, or agents of another one run.
            StartError, TrustError: it can't be started; what ran before is still current.
        """
        with self._locked():
            wanted = self._digest("next")
            if not wanted:
                raise InputError("no bundle was taken in here; allowed: after swarm-ctl deploy")
            if digest and digest != wanted:
                raise InputError(
                    f"bundle {wanted} is here, not {digest}; allowed: another computer for each"
                    " host of the fleet, and one deploy at a time"
                )
            if wanted != self._digest("current"):
                self._switch(wanted)
            manifest = self._manifest("current")
            waiting = [each for each in self._services(manifest) if not self.services.runs(each)]
            if waiting and len(waiting) == len(list(self._services(manifest))):
                self._new_flight()
            for service in waiting:
                self.services.start(service)
            self._settle(waiting)

    def stop(self, within_s: float) -> None:
        """Land all agents, wait for their end, then end the router; StartError where one still
        runs after `within_s`."""
        manifest = self._manifest("current")
        agents = [s for s in self._services(manifest) if s.name != "router"]
        routers = [s for s in self._services(manifest) if s.name == "router"]
        end = wall_s() + within_s
        for services in (agents, routers):
            for service in services:
                self.services.interrupt(service)
            while running := [s.name for s in services if self.services.runs(s)]:
                if wall_s() > end:
                    raise StartError(
                        f"{', '.join(running)}: still runs after {within_s:g} s; it has been told"
                        " to land, and is not killed"
                    )
                pause(_LOOK_S)

    def report(self) -> HostReport:
        """How it stands."""
        base = HostReport(
            version=version(),
            manager=self.services.name,
            next=self._digest("next"),
            current=self._digest("current"),
            attention=tuple(self._attention()),
        )
        if not base.current:
            return base
        manifest = self._manifest("current")
        return base.model_copy(
            update={
                "host": manifest.host,
                "swarm": manifest.swarm,
                "whole_hash": manifest.whole_hash,
                "services": tuple(map(self._state, self._services(manifest))),
            }
        )

    def logs(self, out: IO[bytes], *, every: bool = False) -> None:
        """A tar of the newest flight's folder, or of all flights, as it is written."""
        newest = self.root / "flight"
        every_one = sorted((self.root / "flights").glob("*"))
        pack_logs(every_one if every else [newest.resolve()], out)

    def _switch(self, digest: str) -> None:
        if self._digest("current"):
            old = self._manifest("current")
            running = [s.name for s in self._services(old) if self.services.runs(s)]
            if running:
                raise InputError(
                    f"{', '.join(running)} of plan {old.whole_hash}: runs; allowed: deploy"
                    " --restart, which lands it first"
                )
        folder = self.root / "bundles" / digest
        manifest = self._manifest("next")
        for keys in sorted(folder.glob(f"*{KEYS}")):
            trust_bundle.install(keys, self.root / "trust" / str(manifest.trust))
            keys.unlink()  # it holds keys, and they are in the trust folder now
        self._point("bin/swarm-ctl", _program())
        self.services.install(units_of(manifest))
        self._point("current", Path("bundles") / digest)
        for other in (self.root / "bundles").iterdir():
            if other.name != digest:
                shutil.rmtree(other)

    def _new_flight(self) -> None:
        name = f"{date_and_time():%Y%m%d-%H%M%S}"
        (self.root / "flights" / name).mkdir(parents=True, exist_ok=True)
        self._point("flight", Path("flights") / name)

    def _settle(self, services: list[Service]) -> None:
        """Wait until what can't start has ended."""
        end = wall_s() + _EARLY_S
        while services and all(map(self.services.runs, services)) and wall_s() < end:
            pause(_LOOK_S)

    def _state(self, service: Service) -> ServiceReport:
        if self.services.runs(service):
            return ServiceReport(name=service.name, state=ReportedState.RUNNING)
        flight = self.root / "flight"
        said = last_line(flight / f"{service.name}.log")
        if not said or service.name == "router":
            return ServiceReport(name=service.name, state=ReportedState.STOPPED, said=said)
        try:
            outcome = _STATUS.validate_json(
                read_bytes(flight / f"{service.name}.json", _MOST_BYTES)
            ).outcome
        except (OSError, ValidationError):
            outcome = Outcome.FAILED  # it has not come to its last status
        ended = outcome in (Outcome.COMPLETED, Outcome.ABORTED)
        state = ReportedState.ENDED if ended else ReportedState.FAILED
        return ServiceReport(name=service.name, state=state, said=said)

    def _services(self, manifest: BundleManifest) -> Iterator[Service]:
        return manifest.services(str(self.root))

    def _manifest(self, link: str) -> BundleManifest:
        path = self.root / link / MANIFEST
        try:
            return BundleManifest.model_validate_json(read_bytes(path, _MOST_BYTES))
        except FileNotFoundError:
            raise InputError(
                f"{self.root}: nothing was deployed here; allowed: after swarm-ctl deploy"
            ) from None
        except ValidationError as error:
            raise InputError(f"{path}: {error}; allowed: swarm-ctl deploy again") from None

    def _digest(self, link: str) -> str:
        path = self.root / link
        return path.readlink().name if path.is_symlink() else ""

    def _point(self, link: str, target: Path) -> None:
        path = self.root / link
        path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        made = path.with_name(f".{path.name}.{os.getpid()}")
        made.unlink(missing_ok=True)
        made.symlink_to(target)
        made.replace(path)

    def _attention(self) -> Iterator[str]:
        if not self._digest("next"):
            return
        for endpoint in self._manifest("next").endpoints:
            yield from serial_port(endpoint)

    @contextlib.contextmanager
    def _locked(self) -> Iterator[None]:
        self.root.mkdir(mode=0o700, parents=True, exist_ok=True)
        descriptor = os.open(self.root, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
        try:
            try:
                fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                raise StartError(f"{self.root}: another deploy works here now; try again") from None
            yield
        finally:
            os.close(descriptor)


def _private(path: str, flags: int) -> int:
    return os.open(path, flags, 0o600)


def _program() -> Path:
    """The swarm-ctl that this process is."""
    beside = Path(sys.executable).with_name("swarm-ctl")
    found = shutil.which("swarm-ctl") or str(beside)
    if not Path(found).exists():
        raise StartError(f"{found}: is not there; allowed: swarm-ctl in the PATH of this host")
    return Path(found).absolute()


def serial_port(endpoint: str) -> Iterator[str]:
    """Why this user can't speak on the serial port of an endpoint."""
    kind, _, rest = endpoint.partition(":")
    device = Path(rest.partition(":")[0])
    if kind != "serial":
        return
    if importlib.util.find_spec("serial") is None:
        yield "pyserial is missing: pip install 'swarm-ctl[serial]'"
    if not device.exists():
        yield f"{device} is not there: is the autopilot on, and plugged in?"
    elif not os.access(device, os.R_OK | os.W_OK):
        yield f"{device} is not this user's: sudo usermod -aG {device.group()} $USER, log in again"
