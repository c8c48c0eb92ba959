"""What a screen draws as a line instead of a figure: trails, link series, pair series. Folded by
`model.Model`.

Everything kept is an immutable tuple, replaced and not changed, so that views share it. Times are
mission seconds.
"""

from __future__ import annotations

from collections.abc import Container, Mapping
from dataclasses import dataclass, field
from typing import Final, TypeVar

from swarm_ctl.core.model.messages import AgentState, AgentStatus, LinkReport, Phase, SigmaReport
from swarm_ctl.core.model.plan import Point
from swarm_ctl.core.model.vehicle import Vector3

TRAIL_EVERY_S: Final = 0.5
TRAIL_POINTS: Final = 80
"""40 s: where the agents came from in a step, not the whole flight."""
SAMPLES: Final = 40
LOSS_WINDOW_S: Final = 10.0
_TRIPS: Final = 8

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class LinkSeries:
    """One mesh link by its receiver's statuses, oldest first."""

    ages_s: tuple[float, ...] = ()
    counts: tuple[tuple[float, int, int], ...] = ()
    """(time, received, lost) over the last `LOSS_WINDOW_S`."""

    @property
    def recent_loss(self) -> float:
        """Share (0..1) lost over the window."""
        if len(self.counts) < 2:
            return 0.0
        (_, received_0, lost_0), (_, received_1, lost_1) = self.counts[0], self.counts[-1]
        lost, received = max(0, lost_1 - lost_0), max(0, received_1 - received_0)
        return lost / (lost + received) if lost + received else 0.0


@dataclass(frozen=True, slots=True)
class PairSeries:
    """One agent's view of one pair, oldest first: (time, distance in units, sigma, its lower
    bound)."""

    points: tuple[tuple[float, float, float, float], ...] = ()


@dataclass(frozen=True, slots=True)
class Histories:
    """What a view shows of the past."""

    trails: Mapping[int, tuple[Vector3, ...]] = field(default_factory=dict)
    """(north, east, down) [m] by agent, oldest first."""
    links: Mapping[tuple[int, int], LinkSeries] = field(default_factory=dict)
    """By (receiver, sender)."""
    pairs: Mapping[tuple[int, int], PairSeries] = field(default_factory=dict)
    """By (agent, peer)."""
    round_trips_s: Mapping[int, tuple[float, ...]] = field(default_factory=dict)
    """Station to agent and back, by agent."""
    homes: Mapping[int, Point] = field(default_factory=dict)
    """(north, east) [m] where each agent stood before it took off, as far as this station heard
    it."""


class HistoryKeeper:
    """Takes in what was accepted as newer than all before. Of links and pairs with agents that are
    not in `known`, whatever a message says of them, nothing is kept."""

    def __init__(self, known: Container[int]) -> None:
        self._known = known
        self._trails: dict[int, tuple[Vector3, ...]] = {}
        self._due: dict[int, float] = {}
        self._links: dict[tuple[int, int], LinkSeries] = {}
        self._pairs: dict[tuple[int, int], PairSeries] = {}
        self._round_trips: dict[int, tuple[float, ...]] = {}
        self._homes: dict[int, Point] = {}

    def state(self, state: AgentState) -> None:
        """Add a point to the agent's trail, if it is time; until it takes off it is at home."""
        if state.phase <= Phase.ARM and not state.airborne:
            self._homes[state.agent] = state.position_ned_m[:2]
        wait_s = self._due.get(state.agent, 0.0) - state.time_s
        if wait_s <= 0.0 or wait_s > TRAIL_EVERY_S:  # more: a new process, whose clock is behind
            self._due[state.agent] = state.time_s + TRAIL_EVERY_S
            self._trails[state.agent] = _put(
                self._trails.get(state.agent, ()), state.position_ned_m, TRAIL_POINTS
            )

    def status(self, status: AgentStatus) -> None:
        """Add a point to the series of each link that the agent receives on."""
        for sender, report in status.links.items():
            key = (status.agent, sender)
            if sender in self._known:
                self._links[key] = _grown(self._links.get(key, LinkSeries()), report, status.time_s)

    def sigma(self, report: SigmaReport) -> None:
        """Add a point to the series of each pair that the agent reports."""
        for pair in report.pairs:
            if pair.peer not in self._known:
                continue
            key = (report.agent, pair.peer)
            before = self._pairs.get(key, PairSeries()).points
            if before and before[-1][0] > report.time_s:
                before = ()  # of a process before, whose clock was ahead
            point = (report.time_s, pair.distance, pair.sigma, pair.sigma_lb)
            self._pairs[key] = PairSeries(_put(before, point, SAMPLES))

    def round_trip(self, agent: int, seconds: float) -> None:
        """Add the time that a beacon of this station took to the agent and back [s]."""
        self._round_trips[agent] = _put(self._round_trips.get(agent, ()), seconds, SAMPLES)

    def least_round_trip_s(self, agent: int) -> float | None:
        """The shortest of the last few: the rest is waiting for loops to look."""
        return min(self._round_trips.get(agent, ())[-_TRIPS:], default=None)

    def view(self) -> Histories:
        """Everything kept, as it is now."""
        return Histories(
            dict(self._trails),
            dict(self._links),
            dict(self._pairs),
            dict(self._round_trips),
            dict(self._homes),
        )


def _grown(series: LinkSeries, report: LinkReport, time_s: float) -> LinkSeries:
    ages = series.ages_s if report.age_s is None else _put(series.ages_s, report.age_s, SAMPLES)
    old, counts = 0, series.counts
    if counts and counts[-1][0] > time_s:
        counts = ()  # of a process before, whose clock was ahead
    while old < len(counts) and counts[old][0] < time_s - LOSS_WINDOW_S:
        old += 1
    return LinkSeries(ages, (*counts[old:], (time_s, report.received, report.lost)))


def _put(values: tuple[T, ...], value: T, most: int) -> tuple[T, ...]:
    return (*values[-(most - 1) :], value)
