"""What a map in a browser gets of a flight: the moments of all views so far, and the newest
picture in words."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from swarm_ctl.core.model.messages import Phase
from swarm_ctl.core.model.plan import EVERYONE, Plan
from swarm_ctl.core.model.text import printable
from swarm_ctl.report.page.player_parts import Floats, curves, drawn_zone, flown_moments, labels
from swarm_ctl.station.picture.alarms import alarms
from swarm_ctl.station.picture.colours import inks
from swarm_ctl.station.picture.journal import EntryKind, Journal
from swarm_ctl.station.picture.summaries import flown_order, verdict
from swarm_ctl.station.picture.view import AgentView, SwarmView

_MOST: Final = 60_000
"""Moments times agents that are kept at most, about 15 bytes each: then every second one goes."""
_MARKS: Final = 200
_DOWN: Final[dict[Phase | None, str]] = {
    Phase.RETURN: "return",
    Phase.LAND: "land",
    Phase.YIELD: "a pilot flies",
}
_MARKED: Final = (EntryKind.EVENT, EntryKind.ALARM, EntryKind.COMMAND)


@dataclass(frozen=True, slots=True)
class _Moment:
    """One view, as it is drawn; by agent, in the plan's order."""

    time_s: float
    ned_m: Floats
    """(n, 3); nan: not known."""
    away_m: Floats
    """(n, 2); nan: it has no slot."""
    states: NDArray[np.uint8]
    """(n,)"""
    near_m: float
    pair: tuple[int, int]
    error_m: float
    targets: tuple[tuple[str, tuple[float, float, float]], ...]
    """Name, and where it is by fresh news [m]."""


class Version(NamedTuple):
    """How much a page knows."""

    anew: int = -1
    """How often what was told before no longer held."""
    moments: int = 0
    line: tuple[int, int] = (0, 0)
    """Steps and entries of the log."""


class LiveFlight:
    """A fold over views. What it tells is JSON without NaN. One thread at a time may use it."""

    def __init__(self, plan: Plan) -> None:
        self.plan: Final = plan
        self._columns = {agent.id: k for k, agent in enumerate(plan.agents)}
        self._moments: list[_Moment] = []
        self._homes: list[list[float] | None] = [None] * len(self._columns)
        self._journal = Journal()
        self._steps: list[dict[str, Any]] = []
        self._view: SwarmView | None = None
        self._anew = 0

    @property
    def version(self) -> Version:
        """Of what there is now to tell."""
        return Version(self._anew, len(self._moments), (len(self._steps), self._journal.told))

    def take(self, view: SwarmView) -> None:
        """Take the newest view in. A clock that was set back begins the flight anew."""
        if self._moments and view.time_s < self._moments[-1].time_s:
            self._anew += 1
            self._moments, self._steps, self._journal = [], [], Journal()
        self._view = view
        self._journal.update(view)
        words = _flown(view)
        if not self._steps or self._steps[-1]["text"] != words:
            self._steps.append({"t": round(view.time_s, 3), "text": words})
        if self._moments and view.time_s == self._moments[-1].time_s:
            return
        self._moments.append(self._moment(view))
        if len(self._moments) * len(self._columns) > _MOST:
            self._anew += 1
            self._moments = [*self._moments[:-1:2], self._moments[-1]]

    def _moment(self, view: SwarmView) -> _Moment:
        n = len(self._columns)
        ned_m, away_m = np.full((n, 3), np.nan), np.full((n, 2), np.nan)
        states = np.zeros(n, np.uint8)
        near_m, pair = math.nan, (0, 0)
        for agent in view.agents:
            if (k := self._columns.get(agent.id)) is None or agent.state is None:
                continue
            ned_m[k] = agent.state.position_ned_m
            if agent.target_m is not None:
                away_m[k] = ned_m[k, :2] - agent.target_m
            states[k] = agent.off_ground + 2 * agent.live
            if self._homes[k] is None and not agent.airborne:
                self._homes[k] = np.round(ned_m[k, :2], 2).tolist()
            other, nearest_m = self._columns.get(agent.nearest_agent or 0), agent.nearest_m
            if not agent.live or other is None or nearest_m is None:
                continue
            if math.isnan(near_m) or nearest_m < near_m:
                near_m, pair = nearest_m, (k, other)
        targets = tuple(
            (target.name, (*target.at_m, -(target.up_m or 0.0)))
            for target in view.targets
            if target.fresh
        )
        error_m = math.nan if view.error_m is None else view.error_m
        return _Moment(
            time_s=view.time_s,
            ned_m=ned_m,
            away_m=away_m,
            states=states,
            near_m=near_m,
            pair=pair,
            error_m=error_m,
            targets=targets,
        )

    def beginning(self) -> dict[str, Any]:
        """The flight before its first moment, for the page itself."""
        plan = self.plan
        return {
            "name": printable(plan.name),
            "agents": [agent.id for agent in plan.agents],
            "labels": labels(plan),
            "inks": inks(plan),
            "r_in_m": round(plan.law.r_in * plan.unit_m, 6),
            "r_out_m": round(plan.law.r_out * plan.unit_m, 6),
            "zero_s": 0.0,
            **self._flown([]),
            "links": [],
            "zones": [],
            "targets": [],
            "fence_m": plan.fence.polygon_m if plan.fence else [],
            "fence_height_m": plan.fence.height_m if plan.fence else None,
            "homes": self._homes,
            "steps": [],
            "marks": [],
        }

    def since(self, version: Version) -> dict[str, Any]:
        """What a page that has `version` lacks; empty before the first view."""
        view, now = self._view, self.version
        if view is None:
            return {}
        whole = version.anew != now.anew
        moments = self._moments if whole else self._moments[version.moments :]
        return {
            "whole": whole,
            **self._flown(moments),
            "links": [
                [self._columns[edge.a], self._columns[edge.b]]
                for edge in view.edges
                if edge.a in self._columns and edge.b in self._columns
            ],
            "zones": [drawn_zone(zone, None, None) for zone in view.zones],
            "homes": self._homes,
            "targets": _targets(moments),
            **(self._line() if whole or version.line != now.line else {}),
            "now": _now(view),
        }

    def _line(self) -> dict[str, Any]:
        """What lies on the line of time."""
        marks = [
            {
                "t": round(entry.time_s, 3),
                "level": entry.level.name.lower(),
                "text": f"{entry.kind}: {printable(entry.text)}",
            }
            for entry in self._journal.newest(_MARKS)
            if entry.kind in _MARKED
        ]
        return {"steps": self._steps, "marks": marks}

    def _flown(self, moments: Sequence[_Moment]) -> dict[str, Any]:
        count, n = len(moments), len(self._columns)
        time_s = np.array([each.time_s for each in moments])
        return {
            **flown_moments(
                time_s,
                np.array([each.ned_m for each in moments]).reshape(count, n, 3),
                np.array([each.away_m for each in moments]).reshape(count, n, 2),
                np.array([each.states for each in moments]),
            ),
            "curves": curves(
                time_s,
                np.array([each.near_m for each in moments]),
                np.array([each.pair for each in moments]),
                np.array([each.error_m for each in moments]),
            ),
        }


def _targets(moments: Sequence[_Moment]) -> list[dict[str, Any]]:
    found: dict[str, dict[str, Any]] = {}
    for moment in moments:
        for name, at in moment.targets:
            of = found.setdefault(name, {"name": printable(name), "times": [], "at": []})
            of["times"].append(round(moment.time_s, 2))
            of["at"].append([round(value, 2) for value in at])
    return list(found.values())


def _now(view: SwarmView) -> dict[str, Any]:
    """The newest picture in words."""
    (level, first), *others = verdict(view, alarms(view))
    heard = sum(agent.phase is not None and not agent.lost for agent in view.agents)
    return {
        "level": level.name.lower(),
        "verdict": printable(first),
        "others": [{"level": level.name.lower(), "text": text} for level, text in others],
        "over": all(agent.phase is Phase.ENDED for agent in view.agents),
        "time_s": round(view.time_s, 1),
        "speedup": view.speedup,
        "step": _flown(view),
        "agents": f"{heard} of {len(view.agents)} agents heard",
    }


def _flown(view: SwarmView) -> str:
    """What is flown now: of each group its step, or the order that all of it fly instead."""
    if len(view.groups) < 2:
        name = view.groups[0].name if view.groups else EVERYONE
        before = f"step {view.step} of {view.plan.last_step}: "
        orders = _orders(view, view.agents)
        return f"{'' if name == EVERYONE else f'{name}, '}{before}" + (
            orders or printable(view.group.step_name(view.step))
        )
    return ", ".join(
        f"{group.name} "
        + (
            _orders(view, [agent for agent in view.agents if agent.id in group.agents])
            or printable(group.step_name)
        )
        for group in view.groups
        if group.agents
    )


def _orders(view: SwarmView, agents: Sequence[AgentView]) -> str:
    """The order, or the way down, that all of those in the air fly; ''."""
    aloft = [agent for agent in agents if agent.live]
    found = {_DOWN.get(agent.phase) or flown_order(agent, view) for agent in aloft}
    return found.pop() if len(found) == 1 else ""
