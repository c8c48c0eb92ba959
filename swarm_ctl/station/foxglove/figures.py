"""A view's figures in one message, for plots and tables."""

from __future__ import annotations

import math

from swarm_ctl.core.model.rows import row
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
