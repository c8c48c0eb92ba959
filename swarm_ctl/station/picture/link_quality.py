"""How good a link is, and in which words: thresholds and judgement, pure. Mission time
throughout."""

from __future__ import annotations

from collections.abc import Container
from dataclasses import dataclass
from typing import Final

from swarm_ctl.core.model.messages import Phase
from swarm_ctl.core.model.timeouts import FRESH_S, NEIGHBOUR_S, OWN_LOST_S
from swarm_ctl.station.picture.alarms import Level
from swarm_ctl.station.picture.history import LinkSeries
from swarm_ctl.station.picture.view import AgentView, LinkView, SwarmView

LOSS_WARNING: Final = 0.05
LOSS_ERROR: Final = 0.2
"""What the law was tried with."""
AGE_WARNING_S: Final = FRESH_S
AGE_ERROR_S: Final = NEIGHBOUR_S
HEARTBEAT_WARNING_S: Final = 1.5
"""Heartbeats come at 1 Hz."""
HEARTBEAT_ERROR_S: Final = OWN_LOST_S


@dataclass(frozen=True, slots=True)
class Judgement:
    """What is wrong with a link; nothing, where `words` is empty."""

    level: Level
    words: str = ""


def judge(link: LinkView, series: LinkSeries) -> Judgement:
    """A mesh link by the age of its newest state and its loss over the last ten seconds."""
    age, loss = link.report.age_s, series.recent_loss
    if age is None:
        return Judgement(Level.WAITING, "never heard")
    level, words = Level.WELL, []
    if age > AGE_WARNING_S:
        level = Level.ERROR if age > AGE_ERROR_S else Level.WARNING
        words.append(f"last state {age:.1f} s old")
    if loss > LOSS_WARNING:
        level = max(level, Level.ERROR if loss > LOSS_ERROR else Level.WARNING)
        words.append(f"{loss:.0%} lost in 10 s")
    return Judgement(level, ", ".join(words))


def judge_vehicle(agent: AgentView) -> Judgement:
    """The link between an agent and its vehicle by the age of the last heartbeat."""
    age = agent.status.heartbeat_age_s if agent.status else None
    if age is None or agent.phase is Phase.ENDED:
        return Judgement(Level.WAITING)
    if age > HEARTBEAT_WARNING_S:
        level = Level.ERROR if age > HEARTBEAT_ERROR_S else Level.WARNING
        return Judgement(level, f"heartbeat {age:.1f} s old")
    return Judgement(Level.WELL)


def judge_station(agent: AgentView) -> Judgement:
    """How an agent's states arrive at this station."""
    if agent.link.age_s is None or agent.phase is Phase.ENDED:
        return Judgement(Level.WAITING)
    if agent.lost or agent.link.age_s > AGE_ERROR_S:
        return Judgement(Level.ERROR, f"last state {agent.link.age_s:.1f} s old")
    if agent.link.recent_loss > LOSS_WARNING:
        level = Level.ERROR if agent.link.recent_loss > LOSS_ERROR else Level.WARNING
        return Judgement(level, f"{agent.link.recent_loss:.0%} lost in 10 s")
    return Judgement(Level.WELL)


def jitter_s(p50_s: float | None, p99_s: float | None) -> float | None:
    """How far the worst hundredth of the ages lies over the usual one."""
    return None if p50_s is None or p99_s is None else max(0.0, p99_s - p50_s)


def mesh_judgements(
    view: SwarmView, only: Container[tuple[int, int]] | None = None
) -> dict[tuple[int, int], Judgement]:
    """Every mesh link (or `only` these) by (receiver, sender); those of agents that are through
    count as waiting."""
    ended = {agent.id for agent in view.agents if agent.phase is Phase.ENDED}
    none = LinkSeries()
    return {
        (link.receiver, link.sender): Judgement(Level.WAITING)
        if {link.receiver, link.sender} & ended
        else judge(link, view.histories.links.get((link.receiver, link.sender), none))
        for link in view.links
        if only is None or (link.receiver, link.sender) in only
    }


def bad_links(view: SwarmView, judged: dict[tuple[int, int], Judgement]) -> list[tuple[Level, str]]:
    """Every bad link in words, the worst first; one sentence for an agent that all others
    hear badly."""
    found = [
        (judgement.level, f"{what} of agent {agent.id}: {judgement.words}")
        for agent in view.agents
        for what, judgement in (
            ("vehicle link", judge_vehicle(agent)),
            ("station link", judge_station(agent)),
        )
        if judgement.level >= Level.WARNING
    ]
    for sender in {sender for _, sender in judged}:
        bad = {r: j for (r, s), j in judged.items() if s == sender and j.level >= Level.WARNING}
        heard_by = sum(s == sender for _, s in judged)
        if len(bad) > 1 and len(bad) == heard_by:
            worst = max(bad.values(), key=lambda j: j.level)
            found.append((worst.level, f"agent {sender} is heard badly by everyone: {worst.words}"))
        else:
            found += [
                (j.level, f"agent {r} hears agent {sender} badly: {j.words}")
                for r, j in sorted(bad.items())
            ]
    return sorted(found, key=lambda item: -item[0])
