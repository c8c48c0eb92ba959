"""The log of a flight: events, alarms raised, acknowledged and cleared, commands and their answers;
each thing once.

A fold over views, so that every station that saw the same views has the same log. Times are mission
seconds.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Final, NamedTuple

from swarm_ctl.core.model.messages import Event
from swarm_ctl.core.model.text import agents_counted
from swarm_ctl.station.picture.alarms import LEVEL_OF, Alarm, Level, alarms
from swarm_ctl.station.picture.summaries import answers, by_reason, gather_events, line_of, refusals
from swarm_ctl.station.picture.view import SwarmView

_ENTRIES: Final = 2000
_FLAPS_S: Final = 10.0
"""An alarm that comes back within this time is the same one: counted, not told again."""
TREND_S: Final = 240.0
"""So far back trends go, with a point a second."""


class EntryKind(StrEnum):
    """What an entry of the log, or a mark on the line of time, tells."""

    EVENT = "event"
    VEHICLE = "vehicle"
    """A status text of an autopilot."""
    ALARM = "alarm"
    CLEARED = "cleared"
    COMMAND = "command"
    STATION = "station"
    """A word of the station itself."""
    STEP = "step"
    """The mission's step changed: a mark alone."""


@dataclass(frozen=True, slots=True)
class JournalLine:
    """One line of the log."""

    time_s: float
    kind: EntryKind
    level: Level
    agents: tuple[int, ...]
    text: str
    acknowledged: bool = False
    count: int = 1


class TrendPoint(NamedTuple):
    """The swarm at one moment; None: not known."""

    time_s: float
    nearest_m: float | None
    """Of any two in the air."""
    error_m: float | None


@dataclass(slots=True)
class _Standing:
    """An alarm that stands, or stood until a moment ago."""

    alarm: Alarm
    entry: int
    """Its number in the log."""
    raised_s: float
    acknowledged: bool = False
    gone_s: float | None = None


class Journal:
    """What has been told so far."""

    def __init__(self) -> None:
        self._entries: deque[JournalLine] = deque(maxlen=_ENTRIES)
        self._first = 0
        """The number of the oldest entry that is kept."""
        self._alarms: dict[tuple[str, tuple[int, ...]], _Standing] = {}
        self._commands: dict[str, tuple[int, str]] = {}
        self._told_events = 0
        self._trends: deque[TrendPoint] = deque(maxlen=round(TREND_S) + 1)
        self.standing: tuple[Alarm, ...] = ()
        """Alarms of the newest view, the worst first."""

    @property
    def entries(self) -> tuple[JournalLine, ...]:
        """By the times that they show: what cleared is told later than it was over."""
        return tuple(sorted(self._entries, key=lambda entry: entry.time_s))

    def newest(self, count: int) -> tuple[JournalLine, ...]:
        """The last ones told."""
        return tuple(self._entries)[-count:] if count > 0 else ()

    @property
    def told(self) -> int:
        """How many entries there were in all."""
        return self._first + len(self._entries)

    @property
    def unacknowledged(self) -> int:
        """How many alarms stand that the operator has not acknowledged."""
        return sum(s.gone_s is None and not s.acknowledged for s in self._alarms.values())

    @property
    def trends(self) -> tuple[TrendPoint, ...]:
        """The last `TREND_S`, oldest first."""
        return tuple(self._trends)

    def update(self, view: SwarmView) -> None:
        """Take a newer view in."""
        if not self._trends or view.time_s - self._trends[-1].time_s >= 1.0:
            near = [a.nearest_m for a in view.agents if a.live and a.nearest_m is not None]
            self._trends.append(TrendPoint(view.time_s, min(near, default=None), view.error_m))
        self._take_events(view)
        self._take_commands(view)
        self._take_alarms(view)

    def acknowledge(self, now_s: float) -> int:
        """Acknowledge all alarms that stand; how many of them were new to the operator."""
        seen = [s for s in self._alarms.values() if s.gone_s is None and not s.acknowledged]
        for standing in seen:
            standing.acknowledged = True
            self._change(standing.entry, acknowledged=True)
        if seen:
            names = ", ".join(dict.fromkeys(s.alarm.name for s in seen))
            self._add(
                JournalLine(now_s, EntryKind.STATION, Level.WELL, (), f"acknowledged: {names}")
            )
        return len(seen)

    def note(self, now_s: float, text: str, level: Level = Level.WELL) -> None:
        """A word of the station itself."""
        self._add(JournalLine(now_s, EntryKind.STATION, level, (), text))

    def _take_events(self, view: SwarmView) -> None:
        fresh = view.event_count - self._told_events
        self._told_events = view.event_count
        new: tuple[Event, ...] = view.events[-fresh:] if fresh > 0 else ()
        if fresh > len(new):
            text = f"{fresh - len(new)} events came too fast to be told"
            self._add(JournalLine(view.time_s, EntryKind.STATION, Level.WARNING, (), text))
        for saying in gather_events(new):
            before = self._entries[-1] if self._entries else None
            if before is not None and before.kind is EntryKind.EVENT and before.text == saying.text:
                # the others' same words, a view later
                self._change(
                    self._first + len(self._entries) - 1,
                    agents=_joined(before.agents, saying.agents),
                )
                continue
            text = saying.text.removeprefix("vehicle: ")
            kind = EntryKind.EVENT if text == saying.text else EntryKind.VEHICLE
            level = LEVEL_OF[saying.level]
            self._add(JournalLine(saying.time_s, kind, level, saying.agents, text))

    def _take_commands(self, view: SwarmView) -> None:
        for command in view.commands:
            text = answers(command, view)
            refused = refusals(command, view)
            level = Level.WARNING if refused else Level.WELL
            number, told = self._commands.get(command.command.id, (-1, ""))
            if number < 0:
                self._add(
                    JournalLine(
                        command.received_s, EntryKind.COMMAND, level, command.command.agents, text
                    )
                )
                self._commands[command.command.id] = (self._first + len(self._entries) - 1, text)
            elif told != text:
                self._change(number, text=text, level=level)
                self._commands[command.command.id] = (number, text)

    def _take_alarms(self, view: SwarmView) -> None:
        self.standing = alarms(view)
        found = {alarm.key: alarm for alarm in self.standing}
        self._raise([alarm for key, alarm in found.items() if key not in self._alarms], view.time_s)
        for key in found:
            standing = self._alarms[key]
            if standing.gone_s is not None:
                standing.gone_s = None
                self._change(standing.entry, count_more=1)
        gone = [standing for key, standing in self._alarms.items() if key not in found]
        for standing in gone:
            standing.gone_s = view.time_s if standing.gone_s is None else standing.gone_s
        self._clear([s for s in gone if s.gone_s is not None and view.time_s - s.gone_s > _FLAPS_S])

    def _raise(self, new: list[Alarm], now_s: float) -> None:
        """One entry for all alarms of a reason that came up within a few views."""
        for fresh in by_reason(new):
            told = [s for s in self._alarms.values() if self._goes_on(s, fresh[0], now_s)]
            same = [*(standing.alarm for standing in told), *fresh]
            agents, text = _all_agents(same), line_of(same)
            if told:
                number, raised_s = told[0].entry, told[0].raised_s
                self._change(number, agents=agents, text=text)
            else:
                self._add(JournalLine(now_s, EntryKind.ALARM, fresh[0].level, agents, text))
                number, raised_s = self._first + len(self._entries) - 1, now_s
            for alarm in fresh:
                self._alarms[alarm.key] = _Standing(alarm, number, raised_s)

    @staticmethod
    def _goes_on(standing: _Standing, alarm: Alarm, now_s: float) -> bool:
        """Whether the alarm belongs into the entry of one that stands, or stood until a moment
        ago."""
        recent = now_s - standing.raised_s <= _FLAPS_S and not standing.acknowledged
        return recent and standing.alarm.line == alarm.line

    def _clear(self, over: list[_Standing]) -> None:
        """One entry for all alarms of a kind that cleared together."""
        for name in dict.fromkeys(standing.alarm.name for standing in over):
            same = [standing for standing in over if standing.alarm.name == name]
            ids = _all_agents([standing.alarm for standing in same])
            last_s = max(standing.gone_s or 0.0 for standing in same)
            self._add(
                JournalLine(
                    last_s, EntryKind.CLEARED, Level.WELL, ids, f"{name} ({agents_counted(ids)})"
                )
            )
        for standing in over:
            del self._alarms[standing.alarm.key]

    def _add(self, entry: JournalLine) -> None:
        if len(self._entries) == _ENTRIES:
            self._first += 1
        self._entries.append(entry)

    def _change(self, number: int, *, count_more: int = 0, **changes: object) -> None:
        index = number - self._first
        if 0 <= index < len(self._entries):
            entry = self._entries[index]
            self._entries[index] = replace(entry, count=entry.count + count_more, **changes)  # type: ignore[arg-type]


def _all_agents(found: list[Alarm]) -> tuple[int, ...]:
    return tuple(sorted({agent for alarm in found for agent in alarm.agents}))


def _joined(a: tuple[int, ...], b: tuple[int, ...]) -> tuple[int, ...]:
    return tuple(sorted({*a, *b}))
