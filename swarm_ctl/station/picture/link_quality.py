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
    if link.report.age_s is None:
        return Judgement(Level.WAITING, "not heard")
    return _judged(link.report.age_s, series.recent_loss)


def judge_vehicle(agent: AgentView) -> Judgement:
    """The link between an agent and its vehicle by the age of the last heartbeat."""
    age = agent.status.heartbeat_age_s if agent.status else None
    if age is None or agent.phase is Phase.ENDED:
        return Judgement(Level.WAITING)
    level = _level(age, HEARTBEAT_WARNING_S, HEARTBEAT_ERROR_S)
    return Judgement(level, f"heartbeat {age:.1f} s old" if level else "")


def judge_station(agent: AgentView) -> Judgement:
    """How an agent's states arrive at this station; a state is old from the error's age on."""
    age = agent.link.age_s
    if age is None or agent.phase is Phase.ENDED:
        return Judgement(Level.WAITING)
    if agent.lost or age > AGE_ERROR_S:
        return Judgement(Level.ERROR, f"last state {age:.1f} s old")
    return _judged(0.0, agent.link.recent_loss)


def _judged(age_s: float, loss: float) -> Judgement:
    ages = _level(age_s, AGE_WARNING_S, AGE_ERROR_S), f"last state {age_s:.1f} s old"
    losses = _level(loss, LOSS_WARNING, LOSS_ERROR), f"{loss:.0%} lost in 10 s"
    words = ", ".join(words for level, words in (ages, losses) if level)
    return Judgement(max(ages[0], losses[0]), words)


def _level(value: float, warning: float, error: float) -> Level:
    return Level.ERROR if value > error else Level.WARNING if value > warning else Level.WELL


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
    """Every bad link in words, the worst first; one sentence for an agent that all who listen to it
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
    by_sender: dict[int, dict[int, Judgement]] = {}
    for (receiver, sender), judgement in judged.items():
        by_sender.setdefault(sender, {})[receiver] = judgement
    for sender, heard in by_sender.items():
        bad = {r: j for r, j in heard.items() if j.level >= Level.WARNING}
        if len(bad) > 1 and len(bad) == len(heard):
            worst = max(bad.values(), key=lambda j: j.level)
            found.append((worst.level, f"all agents hear agent {sender} badly: {worst.words}"))
        else:
            found += [
                (j.level, f"agent {r} hears agent {sender} badly: {j.words}")
                for r, j in sorted(bad.items())
            ]
    return sorted(found, key=lambda item: -item[0])
