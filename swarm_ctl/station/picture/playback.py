"""A recorded flight that can be looked at from any moment: what a station saw and told then, alarms
included.

Pure: a fold over what was said, on a grid of looks that does not depend on how fast or in which
order one looks on. So a moment's picture is the same however one came there.
"""

from __future__ import annotations

import bisect
import math
import pickle
import re
import zlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Final, Protocol

from swarm_ctl.core.model.messages import Payload
from swarm_ctl.core.model.plan import Plan
from swarm_ctl.errors import InputError
from swarm_ctl.station.picture.alarms import Level
from swarm_ctl.station.picture.journal import EntryKind, Journal
from swarm_ctl.station.picture.model import Model
from swarm_ctl.station.picture.view import SwarmView

LOOK_S: Final = 0.25
"""Mission time between two looks for alarms: what a live station does at the speed of the wall
clock."""
_MANY: Final = 16
_KEYFRAME_LOOKS: Final = 40
_MOMENT_S: Final = 1e-6
_TYPED: Final = re.compile(
    r"(?P<sign>[+-]?)(?:(?P<minutes>\d{1,4}):)?(?P<seconds>\d{1,6}(?:\.\d*)?)"
)


class Scenes(Protocol):
    """Parts of a recording in order, each a list of (time heard [s], payload) by time. A list of
    lists is one."""

    def __len__(self) -> int: ...

    def __getitem__(self, k: int, /) -> Sequence[tuple[float, Payload]]: ...


@dataclass(frozen=True, slots=True)
class Mark:
    """Something was told at this moment."""

    time_s: float
    kind: EntryKind
    level: Level


@dataclass(slots=True)
class _Cursor:
    """A place in the film, and all that a station knew there."""

    model: Model
    journal: Journal = field(default_factory=Journal)
    scene: int = 0
    message: int = 0
    """The next one to fold, in its scene."""
    look: int = 0
    """The next one to take."""


class Film:
    """Seek to a moment, then ask for `view()` and `journal`. Times are mission seconds.

    Seeking is quick where `read_ahead` has been, which also finds the `marks`.
    """

    def __init__(
        self, scenes: Scenes, plan: Plan, *, speedup: float = 1.0, station: str = ""
    ) -> None:
        self._scenes = scenes
        self._scene = lru_cache(4)(scenes.__getitem__)  # two cursors, and those they come from
        times = _ends(scenes)
        if times is None:
            raise InputError(
                "the recording holds no message of an agent that this version can read"
            )
        self.plan = plan
        self.look_s: Final = LOOK_S * max(1, len(plan.agents) // _MANY)
        """A look costs n squared: large swarms are looked at less often."""
        self.start_s: Final = times[0]
        self._looks: Final = math.ceil((times[1] - times[0]) / self.look_s)
        self.end_s: Final = self._time_of(self._looks)
        """A look at or behind the last message."""
        first = _Cursor(Model(plan, speedup=speedup, since_s=times[0], station=station))
        self._keyframes = [_frozen(first)]
        self._here, self._ahead = first, _thawed(self._keyframes[0])
        self._flown = set[tuple[str, int]]()
        """The steps of groups that were seen so far."""
        self.time_s = self.start_s
        self.marks: list[Mark] = []
        """What was told up to `known_s`, in order."""
        self.seek(self.start_s)

    @property
    def journal(self) -> Journal:
        """The log at this moment."""
        return self._here.journal

    @property
    def known_s(self) -> float:
        """How far `read_ahead` has come."""
        return self._time_of(self._ahead.look - 1)

    def view(self) -> SwarmView:
        """The swarm at this moment."""
        return self._here.model.view(self.time_s)

    def read_ahead(self, enough: Callable[[], bool]) -> bool:
        """Read on until `enough` says so; True when all is read."""
        while self._ahead.look <= self._looks:
            if enough():
                return False
            told = self._ahead.journal.told
            view = self._look(self._ahead)
            self._mark(view, self._ahead.journal, told)
            if self._ahead.look % _KEYFRAME_LOOKS == 0:
                self._keyframes.append(_frozen(self._ahead))
        return True

    def seek(self, time_s: float, enough: Callable[[], bool] = lambda: False) -> None:
        """Go to the moment `time_s`, or to the nearest one there is; `enough` may end a way
        forwards early."""
        time_s = min(max(time_s, self.start_s), self.end_s)
        keyframe = self._keyframe(time_s)
        if time_s < self.time_s or keyframe * _KEYFRAME_LOOKS > self._here.look:
            self._here = _thawed(self._keyframes[keyframe])
        while self._time_of(self._here.look) <= time_s:
            self._look(self._here)
            if enough():
                time_s = self._time_of(self._here.look - 1)
        self._fold(self._here, time_s)
        self.time_s = time_s

    def moment(self, text: str) -> float:
        """`83`, `1:23`, `+10` or `-10` (from here), `start`, `end` as a time; InputError says what
        is allowed."""
        if text in ("start", "end"):
            return self.start_s if text == "start" else self.end_s
        found = _TYPED.fullmatch(text)
        if found is None:
            raise InputError(
                f"time {text!r}; allowed: seconds, MIN:SEC, +SECONDS, -SECONDS, start, end"
            )
        seconds = 60.0 * int(found["minutes"] or 0) + float(found["seconds"])
        return {"": seconds, "+": self.time_s + seconds, "-": self.time_s - seconds}[found["sign"]]

    def next_mark(self, wanted: Callable[[Mark], bool]) -> float | None:
        """When the next thing wanted is told; None: there is none, as far as is known."""
        at = bisect.bisect_right(self.marks, self.time_s + _MOMENT_S, key=lambda mark: mark.time_s)
        return next((mark.time_s for mark in self.marks[at:] if wanted(mark)), None)

    def last_mark(self, wanted: Callable[[Mark], bool]) -> float | None:
        """When the last thing wanted was told before this moment."""
        at = bisect.bisect_left(self.marks, self.time_s - _MOMENT_S, key=lambda mark: mark.time_s)
        return next((mark.time_s for mark in reversed(self.marks[:at]) if wanted(mark)), None)

    def _time_of(self, look: int) -> float:
        return self.start_s + look * self.look_s

    def _keyframe(self, time_s: float) -> int:
        """The last one that is not behind `time_s`: number k was taken after look k *
        _KEYFRAME_LOOKS - 1."""
        looks = int((time_s - self.start_s) / self.look_s + _MOMENT_S) + 1
        return min(looks // _KEYFRAME_LOOKS, len(self._keyframes) - 1)

    def _look(self, cursor: _Cursor) -> SwarmView:
        now_s = self._time_of(cursor.look)
        self._fold(cursor, now_s)
        view = cursor.model.view(now_s)
        cursor.journal.update(view)
        cursor.look += 1
        return view

    def _fold(self, cursor: _Cursor, until_s: float) -> None:
        """Take in all that was heard up to then."""
        while cursor.scene < len(self._scenes):
            said = self._scene(cursor.scene)
            while cursor.message < len(said) and said[cursor.message][0] <= until_s:
                heard_s, payload = said[cursor.message]
                cursor.model.fold(payload, heard_s)
                cursor.message += 1
            if cursor.message < len(said):
                return
            cursor.scene, cursor.message = cursor.scene + 1, 0

    def _mark(self, view: SwarmView, journal: Journal, told: int) -> None:
        flown = {(g.name, g.step) for g in view.groups if g.step and not g.plan.waits_on(g.step)}
        if not flown <= self._flown:
            self._flown |= flown
            self.marks.append(Mark(view.time_s, EntryKind.STEP, Level.WELL))
        fresh = journal.told - told
        self.marks += [
            Mark(view.time_s, entry.kind, entry.level) for entry in journal.newest(fresh)
        ]


def _ends(scenes: Scenes) -> tuple[float, float] | None:
    """Times of the first and the last message."""
    first = next((said[0][0] for k in range(len(scenes)) if (said := scenes[k])), None)
    last = next((said[-1][0] for k in reversed(range(len(scenes))) if (said := scenes[k])), None)
    return None if first is None or last is None else (first, last)


def _frozen(cursor: _Cursor) -> bytes:
    return zlib.compress(pickle.dumps(cursor, pickle.HIGHEST_PROTOCOL), 1)


def _thawed(keyframe: bytes) -> _Cursor:
    found: _Cursor = pickle.loads(zlib.decompress(keyframe))  # noqa: S301 - our own, of this process
    return found
