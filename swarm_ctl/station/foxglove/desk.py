"""What Foxglove's map, 3-D, plot and log panels show, made from the messages of the mesh.

A fold over what a station hears, in mission time: the same messages give the same desk.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any, Final

from pydantic import TypeAdapter

from swarm_ctl.core.model.frames import geodetic_from_ned
from swarm_ctl.core.model.messages import Payload
from swarm_ctl.core.model.plan import Plan
from swarm_ctl.core.model.rows import row
from swarm_ctl.core.model.text import agents_counted
from swarm_ctl.recording.topics import Derived, Topic, plain_schema
from swarm_ctl.station.foxglove.messages import FrameTransforms, LocationFix, Log, SceneUpdate, Time
from swarm_ctl.station.foxglove.scene import (
    color_of,
    east_north_up,
    formation,
    frame_of,
    trails,
    transforms,
    vehicles,
)
from swarm_ctl.station.picture.alarms import Level
from swarm_ctl.station.picture.journal import Journal
from swarm_ctl.station.picture.model import Model
from swarm_ctl.station.picture.view import AgentView, SwarmView


@row
class AgentFigures:
    """One agent. What is not known is not there."""

    id: int
    group: str | None
    """That it flies in now."""
    phase: str | None
    step: int | None
    done: bool | None
    lost: bool
    mode: str | None
    reason: str | None
    error_m: float | None
    """Its distance from its place in the formation."""
    nearest_m: float | None
    """Horizontal, to the nearest agent."""
    sigma: float | None
    """The largest of its pairs in the avoidance region."""
    speed_mps: float | None
    setpoint_mps: float | None
    height_m: float | None
    battery_percent: float | None
    age_s: float | None
    """Since its newest state was true."""
    loss: float
    """Share (0..1) of its states lost on the way to the station, last 10 s."""
    round_trip_s: float | None
    link_age_s: float | None
    """The oldest news that it has of a near peer."""
    link_loss: float
    """The largest share lost on one of its links from near peers, last 10 s."""


@row
class GroupFigures:
    """A group that flies now. What is not known is not there."""

    name: str
    step: int
    step_name: str
    agents: tuple[int, ...]
    error_m: float | None
    """The largest of its agents."""
    waits_s: float | None
    """How long it has waited for others."""


@row
class TargetFigures:
    """One target. What is not known is not there."""

    name: str
    age_s: float
    """Of the newest word of it."""
    off_m: float | None
    """How far the formation's centre is from its place about it."""


@row
class SwarmFigures:
    """The whole swarm at one time."""

    time_s: float
    """Mission time."""
    step: int
    step_name: str
    error_m: float | None
    """The largest of the agents in the formation."""
    nearest_m: float | None
    """The smallest of the agents in the air."""
    sigma: float | None
    """The largest."""
    loss: float
    link_loss: float
    alarms: int
    """How many stand."""
    groups: tuple[GroupFigures, ...]
    agents: tuple[AgentFigures, ...]
    targets: tuple[TargetFigures, ...]


def figures(view: SwarmView, alarms: int) -> SwarmFigures:
    """All figures of a view."""
    agents = tuple(_figures(agent, view) for agent in view.agents)
    near = [agent.nearest_m for agent in view.agents if agent.live and agent.nearest_m is not None]
    sigmas = [agent.sigma for agent in agents if agent.sigma is not None]
    return SwarmFigures(
        time_s=round(view.time_s, 3),
        step=view.step,
        step_name=view.group.step_name(view.step),
        error_m=_rounded(view.error_m),
        nearest_m=_rounded(min(near, default=None)),
        sigma=max(sigmas, default=None),
        loss=max((agent.loss for agent in agents), default=0.0),
        link_loss=max((agent.link_loss for agent in agents), default=0.0),
        alarms=alarms,
        groups=tuple(
            GroupFigures(
                name=group.name,
                step=group.step,
                step_name=group.step_name,
                agents=group.agents,
                error_m=_rounded(group.error_m),
                waits_s=_rounded(group.waits_s),
            )
            for group in view.groups
        ),
        agents=agents,
        targets=tuple(
            TargetFigures(target.name, round(target.age_s, 3), _rounded(target.off_m))
            for target in view.targets
        ),
    )


def _figures(agent: AgentView, view: SwarmView) -> AgentFigures:
    told, state, status = agent.newest, agent.state, agent.status
    links = status.links if status else {}
    losses = (view.histories.links.get((agent.id, peer)) for peer in links)
    ages = (link.age_s for link in links.values() if link.age_s is not None)
    pairs = agent.sigma.pairs if agent.sigma else ()
    group = view.group_now(agent.id)
    return AgentFigures(
        id=agent.id,
        group=group.name if group is not None else None,
        phase=told.phase.name.lower() if told else None,
        step=told.step if told else None,
        done=told.done if told else None,
        lost=agent.lost,
        mode=status.mode if status else None,
        reason=status.reason if status else None,
        error_m=_rounded(agent.error_m),
        nearest_m=_rounded(agent.nearest_m),
        sigma=_rounded(max((pair.sigma for pair in pairs), default=None)),
        speed_mps=_rounded(math.hypot(*state.velocity_ned_mps[:2])) if state else None,
        setpoint_mps=_rounded(math.hypot(*state.setpoint_mps)) if state else None,
        height_m=_rounded(-state.position_ned_m[2]) if state else None,
        battery_percent=status.battery_percent if status else None,
        age_s=_rounded(agent.link.age_s),
        loss=round(agent.link.recent_loss, 4),
        round_trip_s=_rounded(agent.round_trip_s),
        link_age_s=_rounded(max(ages, default=None)),
        link_loss=round(max((s.recent_loss for s in losses if s), default=0.0), 4),
    )


def _rounded(value: float | None) -> float | None:
    return None if value is None or not math.isfinite(value) else round(value, 3)


LOOK_S: Final = 0.2
_MANY: Final = 16
"""Of more agents there are fewer looks: one costs n squared."""
_SELDOM: Final = 5
"""Looks from one to the next of what changes slowly."""
_NANO: Final = 1_000_000_000
_UNKNOWN, _APPROXIMATED = 0, 1
_LEVELS: Final = {Level.WELL: 2, Level.WAITING: 2, Level.WARNING: 3, Level.ERROR: 4}


def _topic(template: str, kind: type[Any], owner: str = "foxglove.") -> Topic:
    name = template.replace("/agent/{id}", "").strip("/")
    title = owner + kind.__name__
    return Topic(name, template, None, lambda: {**plain_schema(kind), "title": title})


TRANSFORMS: Final = _topic("/tf", FrameTransforms)
VEHICLES: Final = _topic("/scene/vehicles", SceneUpdate)
FORMATION: Final = _topic("/scene/formation", SceneUpdate)
TRAILS: Final = _topic("/scene/trails", SceneUpdate)
LOCATION: Final = _topic("/agent/{id}/location", LocationFix)
LOG: Final = _topic("/log", Log)
FIGURES: Final = _topic("/swarm", SwarmFigures, owner="")
TOPICS: Final = (TRANSFORMS, VEHICLES, FORMATION, TRAILS, LOCATION, LOG, FIGURES)
_ADAPTERS: Final = {
    kind: TypeAdapter(kind)
    for kind in (FrameTransforms, SceneUpdate, LocationFix, Log, SwarmFigures)
}


class Desk:
    """Give `hear` all messages in their order. `start_ns`: Unix time of mission time 0."""

    def __init__(
        self, plan: Plan, start_ns: int, *, speedup: float = 1.0, station: str = ""
    ) -> None:
        self._plan = plan
        self._start_ns = start_ns
        self._speedup = speedup
        self._station = station
        self._model: Model | None = None
        self._journal = Journal()
        self._every_s = LOOK_S * max(1, len(plan.agents) // _MANY)
        self._due_s = -math.inf
        self._looks = 0

    def hear(self, payload: Payload, heard_s: float) -> Iterator[Derived]:
        """Take a message in; where a look is due, what it shows."""
        if self._model is None:  # no agent is missed before it
            self._model = Model(
                self._plan, speedup=self._speedup, since_s=heard_s, station=self._station
            )
        self._model.fold(payload, heard_s)
        if heard_s >= self._due_s:
            self._due_s = max(self._due_s + self._every_s, heard_s + 0.5 * self._every_s)
            yield from self._look(self._model.view(heard_s))

    def _look(self, view: SwarmView) -> Iterator[Derived]:
        told, now_s = self._journal.told, view.time_s
        self._journal.update(view)
        for entry in self._journal.newest(self._journal.told - told):
            line = Log(
                self._time(entry.time_s),
                _LEVELS[entry.level],
                f"{entry.kind}: {entry.text}",
                agents_counted(entry.agents) if entry.agents else "station",
            )
            yield _derived(LOG, None, now_s, line)
        now = self._time(now_s)
        yield _derived(TRANSFORMS, None, now_s, transforms(view, now))
        yield _derived(FORMATION, None, now_s, formation(view, now))
        yield _derived(FIGURES, None, now_s, figures(view, len(self._journal.standing)))
        if self._looks % _SELDOM == 0:
            yield from self._seldom(view, now_s, now)
        self._looks += 1

    def _seldom(self, view: SwarmView, now_s: float, now: Time) -> Iterator[Derived]:
        yield _derived(VEHICLES, None, now_s, vehicles(view, now))
        yield _derived(TRAILS, None, now_s, trails(view, now))
        for agent in view.agents:
            if agent.state is not None:
                yield _derived(LOCATION, agent.id, now_s, self._location(agent, now))

    def _location(self, agent: AgentView, now: Time) -> LocationFix:
        assert agent.state is not None  # noqa: S101 - the caller looks
        place = geodetic_from_ned(agent.state.position_ned_m, self._plan.origin)
        accuracy_m = agent.status.position_accuracy_m if agent.status else None
        square = 0.0 if accuracy_m is None else round(accuracy_m**2, 4)
        return LocationFix(
            timestamp=now,
            frame_id=frame_of(agent.id),
            latitude=round(place.lat_deg, 8),
            longitude=round(place.lon_deg, 8),
            altitude=round(place.alt_m, 2),
            position_covariance=(square, 0.0, 0.0, 0.0, square, 0.0, 0.0, 0.0, square),
            position_covariance_type=_UNKNOWN if accuracy_m is None else _APPROXIMATED,
            velocity=east_north_up(agent.state.velocity_ned_mps),
            color=color_of(agent),
        )

    def _time(self, time_s: float) -> Time:
        sec, nsec = divmod(max(0, self._start_ns + round(time_s * _NANO)), _NANO)
        return Time(sec, nsec)


def _derived(topic: Topic, agent: int | None, time_s: float, message: Any) -> Derived:
    data = _ADAPTERS[type(message)].dump_json(message, exclude_none=True)
    return Derived(topic, agent, time_s, data)
