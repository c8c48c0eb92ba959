"""The own parameters of vehicles that agents have changed: one small file for each vehicle, outside
the agents, so that the next flight can put back what a killed agent could not.

The folder is `SWARM_CTL_STATE`, else `swarm_ctl` in XDG_STATE_HOME, else in `~/.local/state`.
"""

from __future__ import annotations

import errno
import hashlib
import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Final

from pydantic import TypeAdapter, ValidationError

from swarm_ctl.core.model.messages import AgentStatus
from swarm_ctl.core.model.vehicle import OwnParameters, OwnValue, Remembered, VehicleIdentity
from swarm_ctl.engine.clock import date_and_time
from swarm_ctl.files import read_bytes, replacing

if TYPE_CHECKING:  # a station remembers, and speaks no MAVLink
    from swarm_ctl.mavlink.link import VehicleLink

FOLDER_VARIABLE: Final = "SWARM_CTL_STATE"
RECORD: Final = "own_parameters.json"
"""In a run's folder: what the run's station remembers of each agent's vehicle."""


@dataclass(frozen=True, slots=True)
class RememberedVehicle:
    """What is remembered of one vehicle."""

    vehicle: VehicleIdentity
    endpoint: str
    flight: str
    """The run or mission that changed the parameters."""
    since: str
    """Date and time."""
    values: dict[str, OwnValue] = field(default_factory=dict)
    version: int = 1

    def remembered(self) -> Remembered:
        """As an agent is told of it."""
        return Remembered(self.values, f"{self.flight} of {self.since}")

    def concerns(self, vehicle: VehicleIdentity, endpoint: str) -> bool:
        """It is the same vehicle: by uid, or by its endpoint where one of both has no uid."""
        mine, other = self.vehicle, vehicle
        if (mine.autopilot, mine.sysid) != (other.autopilot, other.sysid):
            return False
        if mine.uid and other.uid:
            return mine.uid == other.uid
        return self.endpoint == endpoint


_MOST_BYTES: Final = 1 << 20
"""Of a file here."""
_ENTRY: Final = TypeAdapter(RememberedVehicle)
_VEHICLES: Final = TypeAdapter(dict[int, OwnParameters])


def state_folder() -> Path:
    """Where this user's vehicles are remembered."""
    given = os.environ.get(FOLDER_VARIABLE)
    if given:
        return Path(given)
    base = os.environ.get("XDG_STATE_HOME")
    return (Path(base) if base else Path.home() / ".local" / "state") / "swarm_ctl"


class VehicleMemory:
    """The entries in one folder. Methods raise OSError where the folder or a file can't be used,
    a damaged file included."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def entries(self) -> list[RememberedVehicle]:
        """All of them, the oldest first."""
        return sorted((entry for _, entry in self._read()), key=lambda entry: entry.since)

    def recall(self, vehicle: VehicleIdentity, endpoint: str) -> RememberedVehicle | None:
        """The newest entry of this vehicle."""
        found = [e for _, e in self._read(_prefix(vehicle)) if e.concerns(vehicle, endpoint)]
        return max(found, key=lambda entry: entry.since, default=None)

    def write(self, own: OwnParameters, endpoint: str, flight: str) -> None:
        """Remember these values, and those that are remembered already of other parameters. When
        this returns they are on the disk."""
        before = self.recall(own.vehicle, endpoint)
        values = {**(before.values if before else {}), **own.values}
        if before is not None and (before.vehicle, before.values) == (own.vehicle, values):
            return
        since = f"{date_and_time():%Y-%m-%d %H:%M:%S}"
        entry = RememberedVehicle(own.vehicle, endpoint, flight, since, values)
        self.folder.mkdir(0o700, parents=True, exist_ok=True)
        path = self.folder / _name(own.vehicle, endpoint)
        _write_durably(path, _ENTRY.dump_json(entry, indent=1) + b"\n")
        self._remove(own.vehicle, endpoint, but=path)

    def forget(self, vehicle: VehicleIdentity, endpoint: str) -> None:
        """The vehicle has its own values: nothing is to be put back."""
        self._remove(vehicle, endpoint)

    def _remove(self, vehicle: VehicleIdentity, endpoint: str, but: Path | None = None) -> None:
        for path, entry in self._read(_prefix(vehicle)):
            if path != but and entry.concerns(vehicle, endpoint):
                path.unlink(missing_ok=True)

    def _read(self, prefix: str = "") -> Iterator[tuple[Path, RememberedVehicle]]:
        for path in sorted(self.folder.glob(f"{prefix}*.json")):
            try:
                yield path, _ENTRY.validate_json(read_bytes(path, _MOST_BYTES))
            except FileNotFoundError:
                continue  # another process has just removed it
            except ValidationError:
                why = "is no memory of a vehicle; read and remove it by hand"
                raise OSError(errno.EINVAL, why, str(path)) from None


class Remembering:
    """Keeps one vehicle's own values in the memory while an agent changes them; without a memory
    it does nothing."""

    def __init__(self, memory: VehicleMemory | None, endpoint: str, flight: str) -> None:
        self._memory = memory
        self._endpoint = endpoint
        self._flight = flight
        self._done: OwnParameters | None = None

    def serve(self, link: VehicleLink, own: OwnParameters | None) -> None:
        """Tell the link what is remembered of its vehicle, and store what it says of its own
        values. What can't be stored is not set."""
        if self._memory is None:
            return
        try:
            if not link.recalled and link.identity is not None:
                entry = self._memory.recall(link.identity, self._endpoint)
                link.recall(entry.remembered() if entry else None)
            if own is not None and own != self._done:
                self.note(own)
                link.kept(own.values)  # also after they were given back: nothing is set any more
        except OSError as error:
            link.not_kept(f"its own can't be remembered: {error.filename}: {error.strerror}")

    def note(self, own: OwnParameters) -> None:
        """Store what an agent says of its vehicle's own values; OSError where that can't be."""
        if self._memory is None or own == self._done:
            return
        if own.given_back:
            self._memory.forget(own.vehicle, self._endpoint)
        else:
            self._memory.write(own, self._endpoint, self._flight)
        self._done = own


class SwarmMemory:
    """What a station remembers of the agents' vehicles, by their statuses: for the case that an
    agent's computer is lost.

    Args:
        memory: of this user.
        flight: what this flight is called there.
        endpoints: of the vehicles, by agent.
        folder: of the run, if it is this station's: it gets `own_parameters.json`.
    """

    def __init__(
        self,
        memory: VehicleMemory,
        flight: str,
        endpoints: Mapping[int, str | None],
        folder: Path | None = None,
    ) -> None:
        self._remembering = {
            agent: Remembering(memory, endpoint or f"agent {agent} of {flight}", flight)
            for agent, endpoint in endpoints.items()
        }
        self._record = folder / RECORD if folder else None
        self._own: dict[int, OwnParameters] = {}
        self._told: set[str] = set()

    def hear(self, status: AgentStatus) -> str:
        """Store what is new in a status; what went wrong with that, once, or ''."""
        own, agent = status.own, status.agent
        if own is None or agent not in self._remembering or own == self._own.get(agent):
            return ""
        self._own[agent] = own
        try:
            if self._record is not None:
                _write_durably(self._record, _VEHICLES.dump_json(self._own, indent=1) + b"\n")
            self._remembering[agent].note(own)
        except OSError as error:
            text = f"own parameters can't be remembered: {error.filename}: {error.strerror}"
            told = text in self._told
            self._told.add(text)
            return "" if told else text
        return ""


def left_changed(folder: Path) -> dict[int, OwnParameters]:
    """The vehicles of a run, by agent, that have not confirmed their own values."""
    try:
        vehicles = _VEHICLES.validate_json(read_bytes(folder / RECORD, _MOST_BYTES))
    except (OSError, ValidationError):
        return {}  # none is remembered in this run, or its station wrote nothing
    return {agent: own for agent, own in vehicles.items() if not own.given_back}


def _prefix(vehicle: VehicleIdentity) -> str:
    return f"{vehicle.autopilot}-{vehicle.sysid}-"


def _name(vehicle: VehicleIdentity, endpoint: str) -> str:
    tail = vehicle.uid or hashlib.sha256(endpoint.encode()).hexdigest()[:16]
    return f"{_prefix(vehicle)}{tail}.json"


def _write_durably(path: Path, data: bytes) -> None:
    """In one move, and past the caches: the computer may be lost the next moment."""
    with replacing(path, 0o600, durable=True) as file:
        file.write(data)
