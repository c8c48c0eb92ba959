"""What starts, signals and watches a host's processes: systemd where it runs, else ourselves."""

from __future__ import annotations

import json
import os
import signal
import subprocess
from collections.abc import Mapping
from pathlib import Path
from typing import Final, Protocol

from swarm_ctl.deploy.bundle import ROOT, BundleManifest, Service
from swarm_ctl.errors import StartError
from swarm_ctl.files import replacing

_BOOTED: Final = Path("/run/systemd/system")
"""There where systemd runs this host (sd_booted(3))."""
_BOOT: Final = Path("/proc/sys/kernel/random/boot_id")
_ANSWER_S: Final = 20.0


class Services(Protocol):
    """The processes of a host."""

    name: str
    """What looks after them, in words."""

    def install(self, units: Mapping[str, str]) -> None:
        """Take these unit files, by name, over from now on."""

    def start(self, service: Service) -> None:
        """Start it; nothing where it runs."""

    def interrupt(self, service: Service) -> None:
        """Send SIGINT and do not wait; nothing where it does not run."""

    def runs(self, service: Service) -> bool:
        """It runs, or starts, or lands."""


def services_of(root: Path) -> Services:
    """This host's: systemd where it runs, else our own pid files."""
    return Systemd(root) if _BOOTED.is_dir() else Plain(root)


class Systemd:
    """Units of this user's service manager."""

    name = "systemd"

    def __init__(self, root: Path) -> None:
        self._units = root.parents[3] / ".config/systemd/user"

    def install(self, units: Mapping[str, str]) -> None:
        """Write the unit files where systemd reads them."""
        self._units.mkdir(parents=True, exist_ok=True)
        for name, text in units.items():
            with replacing(self._units / name, 0o644) as file:
                file.write(text.encode())
        self._ask("daemon-reload")

    def start(self, service: Service) -> None:
        """Of a unit that has crashed too often the count begins anew."""
        if not self.runs(service):
            self._ask("reset-failed", service.unit, fails=True)
        self._ask("start", service.unit)

    def interrupt(self, service: Service) -> None:
        """The unit's KillSignal is SIGINT; a router that Restart= keeps alive stays down."""
        self._ask("stop", "--no-block", service.unit)

    def runs(self, service: Service) -> bool:
        """Every state but inactive and failed."""
        said = self._ask("show", "--property=ActiveState", "--value", service.unit)
        return said not in ("inactive", "failed")

    def _ask(self, *words: str, fails: bool = False) -> str:
        line = ["systemctl", "--user", *words]
        manager = {"XDG_RUNTIME_DIR": f"/run/user/{os.getuid()}"}  # not of every login
        done = subprocess.run(
            line,
            env=manager | os.environ,
            capture_output=True,
            text=True,
            timeout=_ANSWER_S,
            check=False,
        )
        if done.returncode and not fails:
            raise StartError(
                f"{' '.join(line)}: {done.stderr.strip() or done.returncode}; allowed: a user with"
                " a service manager of its own (sudo loginctl enable-linger USER)"
            )
        return done.stdout.strip()


class Plain:
    """Processes without systemd, as in a container: sessions of their own, known by pid files. What
    crashes is not started again."""

    name = "no systemd"

    def __init__(self, root: Path) -> None:
        self._root = root
        self._pids = root / "pids"

    def install(self, units: Mapping[str, str]) -> None:
        """Nothing reads unit files here."""

    def start(self, service: Service) -> None:
        if self.runs(service):
            return
        self._pids.mkdir(exist_ok=True)
        log = self._root / "flight" / f"{service.name}.log"
        pid = os.posix_spawn(
            service.words[0],
            service.words,
            os.environ,
            file_actions=[
                (os.POSIX_SPAWN_OPEN, 0, os.devnull, os.O_RDONLY, 0),
                (os.POSIX_SPAWN_OPEN, 1, log, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o644),
                (os.POSIX_SPAWN_DUP2, 1, 2),
            ],
            setsid=True,
        )
        with replacing(self._file(service), 0o600) as file:
            file.write(json.dumps([pid, _began(pid)]).encode())

    def interrupt(self, service: Service) -> None:
        pid = self._pid(service)
        if pid is not None:
            os.kill(pid, signal.SIGINT)

    def runs(self, service: Service) -> bool:
        return self._pid(service) is not None

    def _file(self, service: Service) -> Path:
        return self._pids / f"{service.name}.json"

    def _pid(self, service: Service) -> int | None:
        """Of the process that was started, none that has its number since."""
        try:
            pid, began = json.loads(self._file(service).read_bytes())
        except FileNotFoundError:
            return None
        return int(pid) if began and _began(int(pid)) == began else None


def _began(pid: int) -> str:
    """The boot, and the ticks since then, at which a process has started; '' where it has ended
    (proc_pid_stat(5))."""
    try:
        fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    except (FileNotFoundError, ProcessLookupError):
        return ""
    return "" if fields[0] in ("Z", "X") else f"{_BOOT.read_text().strip()} {fields[19]}"


_AGENT_UNIT: Final = "swarm-ctl-agent@.service"
_ROUTER_UNIT: Final = "swarm-ctl-router.service"
_HOME: Final = f"%h/{ROOT}"
"""systemd puts the user's home in."""

_AGENT: Final = """\
# Written by swarm-ctl deploy, which overwrites what is changed here.
[Unit]
Description=swarm-ctl: agent %i of {swarm}
{after}# Ended so three times in a minute, an agent is left alone: its vehicle lands by itself.
StartLimitIntervalSec=60
StartLimitBurst=3

[Service]
ExecStart={command}
# SIGINT lands the vehicle. An agent in the air is never killed, however long it needs.
KillSignal=SIGINT
SendSIGKILL=no
TimeoutStopSec=infinity
# One that a signal has ended (out of memory, a fault of a library) starts again at once and takes
# its vehicle over, if it stands in the air as it was left. One that has ended by its own word, or
# by an error in its code, which would come again, does not fly again: its vehicle lands.
Restart=on-abnormal
RestartSec=200ms
StandardOutput=append:{home}/flight/agent-%i.log
StandardError=inherit
"""

_ROUTER: Final = """\
# Written by swarm-ctl deploy, which overwrites what is changed here.
[Unit]
Description=swarm-ctl: router of {swarm} on this host
StartLimitIntervalSec=0

[Service]
ExecStart={command}
# It ends with its last client, after five minutes at most.
KillSignal=SIGINT
TimeoutStopSec=330
Restart=always
RestartSec=200ms
StandardOutput=append:{home}/flight/router.log
StandardError=inherit
"""


def units_of(manifest: BundleManifest) -> dict[str, str]:
    """The unit files of a host by name: the template of its agents, in which `%i` is the agent's
    id, and its router's, if it has one. The host itself makes them, of a bundle's manifest: a
    bundle is data and brings none.

    They are units of the user who logs in over SSH, so nothing runs as root. None is started when
    the host boots: a drone that is switched on does not fly before an operator has said so.
    """
    after = f"After={_ROUTER_UNIT}\nWants={_ROUTER_UNIT}\n" if manifest.router else ""
    words, swarm = " ".join(manifest.agent_words(_HOME, "%i")), manifest.swarm
    units = {_AGENT_UNIT: _AGENT.format(swarm=swarm, after=after, command=words, home=_HOME)}
    if manifest.router:
        words = " ".join(manifest.router_words(_HOME))
        units[_ROUTER_UNIT] = _ROUTER.format(swarm=swarm, command=words, home=_HOME)
    return units
