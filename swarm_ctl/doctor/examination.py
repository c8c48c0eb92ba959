"""Asks the vehicles of a fleet, side by side, for their failsafe parameters, and puts remembered
ones back where that is wanted. Nothing is armed; without `restore` nothing is changed."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from swarm_ctl.core.model.fleet import Fleet, FleetAgent
from swarm_ctl.core.model.vehicle import OwnValue, VehicleView
from swarm_ctl.engine.link_keys import OPEN, LinkKeys
from swarm_ctl.engine.ticker import Ticker
from swarm_ctl.engine.vehicle_memory import RememberedVehicle, VehicleMemory
from swarm_ctl.errors import InputError, LinkError
from swarm_ctl.mavlink.autopilots.failsafe_words import NAMES, failsafe_words
from swarm_ctl.mavlink.link import Examined, VehicleLink
from swarm_ctl.mavlink.signing import LinkSigning
from swarm_ctl.mission.compile.loader import load
from swarm_ctl.mission.fleet.fleet_file import read_fleet
from swarm_ctl.mission.input import yaml_file

ANSWERS_S = 3.0
"""A parameter that was asked for this long after the vehicle was first heard is not there."""


@dataclass(frozen=True, slots=True)
class ParameterRow:
    """One failsafe parameter of a vehicle; None: the vehicle does not have it, agents do not set
    it, nothing is remembered of it."""

    name: str
    value: float | None
    in_flight: float | None
    remembered: float | None

    @property
    def left(self) -> bool:
        """The vehicle has not its own value."""
        return self.remembered is not None and self.value != self.remembered


@dataclass(frozen=True, slots=True)
class VehicleReport:
    """What was found of one vehicle."""

    agent: int
    endpoint: str
    sysid: int
    autopilot: str
    reached: bool
    firmware: str = ""
    uid: str = ""
    armed: bool = False
    mode: str = ""
    attention: tuple[str, ...] = ()
    """What the operator has to mend before a flight."""
    notes: tuple[str, ...] = ()
    """Worth a look, and no more."""
    restored: tuple[str, ...] = ()
    """The parameters whose own values the vehicle has confirmed again."""
    flight: str = ""
    """The flight that left our values, where one is remembered."""
    parameters: tuple[ParameterRow, ...] = ()
    now: tuple[str, ...] = ()
    """What it would do as it is."""
    in_flight: tuple[str, ...] = ()
    """What it would do while an agent flies it."""


def examine(
    fleet: Sequence[FleetAgent],
    memory: VehicleMemory,
    ticker: Ticker,
    *,
    within_s: float,
    restore: bool,
    keys: LinkKeys = OPEN,
) -> list[VehicleReport]:
    """Ask all vehicles that have an endpoint, for at most `within_s`."""
    with contextlib.ExitStack() as opened:
        exams = [
            _Exam(agent, memory, restore, opened.enter_context(keys.signing(agent.id)))
            for agent in fleet
            if agent.endpoint
        ]
        for exam in exams:
            opened.callback(exam.close)
        until = ticker.clock.now() + within_s
        while (now := ticker.wait()) < until and not all(exam.done for exam in exams):
            for exam in exams:
                exam.step(now)
        return [exam.report() for exam in exams]


@dataclass
class _Exam:
    """The examination of one vehicle."""

    agent: FleetAgent
    memory: VehicleMemory
    restore: bool
    signing: LinkSigning | None
    trouble: str = ""
    """Why its endpoint or its memory can't be used."""
    entry: RememberedVehicle | None = None
    found: Examined = field(default_factory=lambda: Examined("", {}, {}, frozenset()))
    first_s: float = math.inf
    """When the vehicle was first heard."""
    complete: bool = False
    given_back: bool = False

    def __post_init__(self) -> None:
        self.link: VehicleLink | None = None
        vehicle = (self.agent.endpoint or "", self.agent.autopilot, self.agent.sysid)
        try:
            self.link = VehicleLink(
                *vehicle, remembers=True, agent_sysid=self.agent.agent_sysid, signing=self.signing
            )
        except LinkError as error:
            self.trouble = str(error)

    def close(self) -> None:
        if self.link is not None:
            self.link.close()

    @property
    def done(self) -> bool:
        if self.link is None:
            return True
        return self.complete and (self.given_back or not self._may_restore(self.link))

    def step(self, now: float) -> None:
        link = self.link
        if link is None:
            return
        link.receive(now)
        names = {**dict.fromkeys(NAMES[self.agent.autopilot]), **self._remembered()}
        self.found = link.examine(names, now)
        self._recall(link)
        if math.isfinite(link.view().heartbeat_s):
            self.first_s = min(self.first_s, now)
        late = now - self.first_s > ANSWERS_S
        self.complete = link.recalled and (late or names.keys() <= self.found.values.keys())
        if self.complete and self._may_restore(link):
            self._put_back(link, now)

    def _recall(self, link: VehicleLink) -> None:
        identity = link.identity
        if link.recalled or identity is None:
            return
        try:
            self.entry = self.memory.recall(identity, self.agent.endpoint or "")
        except OSError as error:
            self.trouble = f"{error.filename}: {error.strerror}"
        link.recall(self.entry.remembered() if self.entry else None)

    def _remembered(self) -> dict[str, OwnValue]:
        return self.entry.values if self.entry is not None else {}

    def _may_restore(self, link: VehicleLink) -> bool:
        return self.restore and self.entry is not None and not link.view().armed

    def _put_back(self, link: VehicleLink, now: float) -> None:
        link.put_back(now)
        own = link.view().own
        if own is None:
            return
        link.kept(own.values)
        if own.given_back and self.entry is not None and not self.given_back:
            self.given_back = True
            self.memory.forget(own.vehicle, self.entry.endpoint)

    def report(self) -> VehicleReport:
        agent, link = self.agent, self.link
        about = (agent.id, agent.endpoint or "", agent.sysid, agent.autopilot)
        if link is None or not math.isfinite(self.first_s):
            missing = link.view().health_reason if link is not None else ""
            return VehicleReport(*about, False, attention=(self.trouble or missing,))
        view, found = link.view(), self.found
        rows = self._rows()
        values = {row.name: row.value for row in rows if row.value is not None}
        in_flight = {**values, **{n: v for n, v in found.in_flight.items() if n in values}}
        return VehicleReport(
            *about,
            True,
            firmware=found.firmware,
            uid=link.identity.uid if link.identity else "",
            armed=view.armed,
            mode=view.mode,
            attention=tuple(self._attention(rows, view)),
            notes=tuple(self._notes(rows)),
            restored=tuple(self._remembered()) if self.given_back else (),
            flight=f"{self.entry.flight} of {self.entry.since}" if self.entry else "",
            parameters=tuple(rows),
            now=tuple(failsafe_words(agent.autopilot, values)),
            in_flight=tuple(failsafe_words(agent.autopilot, in_flight)),
        )

    def _rows(self) -> list[ParameterRow]:
        found, remembered = self.found, self._remembered()
        values = found.values
        names = {**dict.fromkeys(found.in_flight), **remembered}
        names |= dict.fromkeys(NAMES[self.agent.autopilot])
        return [
            ParameterRow(
                name,
                values.get(name),
                found.in_flight.get(name),
                remembered[name].own if name in remembered else None,
            )
            for name in names
            if name in values or name in remembered
        ]

    def _attention(self, rows: list[ParameterRow], view: VehicleView) -> Iterator[str]:
        if self.trouble or view.fault:
            yield self.trouble or view.fault
        if self.found.clash:
            yield self.found.clash
        if not self.found.values:
            yield "it is heard, and answers for no parameter"
        left = [row for row in rows if row.left and not self.given_back]
        if not left:
            return
        values = ", ".join(
            f"{row.name} {_shown(row)} (its own: {row.remembered:g})" for row in left
        )
        if view.armed:
            how = "it is armed, so nothing is put back"
        elif self.restore:
            how = "not confirmed in time"
        else:
            how = "the next flight puts them back, or --restore"
        yield f"not its own values: {values}; {how}"

    def _notes(self, rows: list[ParameterRow]) -> Iterator[str]:
        if self.found.stranger:
            yield f"another vehicle is heard at this endpoint, too: sysid {self.found.stranger}"
        ours = [
            f"{row.name} {row.value:g}"
            for row in rows
            if row.value is not None
            and row.value == row.in_flight
            and row.name in self.found.telling
        ]
        if ours and self.entry is None:
            yield (
                f"what agents set, and no flight is remembered that left it: {', '.join(ours)};"
                " its own, or a leftover"
            )


def _shown(row: ParameterRow) -> str:
    return "not there" if row.value is None else f"{row.value:g}"


def fleet_in(path: Path) -> Fleet:
    """The fleet of a fleet file or a mission; MissionError with every mistake in the file."""
    return load(path).fleet if is_mission(path) else read_fleet(path)


def is_mission(path: Path) -> bool:
    """Whether it is a mission and no fleet file; MissionError where it can't be read."""
    data = yaml_file.read(path, what="fleet", also=("mission",)).data
    return isinstance(data, dict) and "steps" in data


def vehicles_of(path: Path) -> Fleet:
    """The fleet of a fleet file or a mission, with those alone that have an endpoint.

    InputError where there are none, MissionError with every mistake in the file.
    """
    fleet = fleet_in(path)
    found = tuple(agent for agent in fleet.agents if agent.endpoint)
    if not found:
        raise InputError(
            f"{path}: no vehicle has an endpoint: run provides them all;"
            " allowed: a fleet with an endpoint for each vehicle to ask"
        )
    return replace(fleet, agents=found)
