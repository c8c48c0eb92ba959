"""Agents that no longer fly the mission, or pause it: words for a screen, or None. Pure."""

from __future__ import annotations

from typing import Final

from swarm_ctl.core.model.causes import Cause, FailsafeAction
from swarm_ctl.core.model.messages import AgentStatus, Outcome, Phase
from swarm_ctl.station.picture.view import AgentView

_FALLEN: Final = frozenset({FailsafeAction.FALL, FailsafeAction.KILL})
_ORDERED: Final = frozenset({Cause.ORDER, Cause.STARTER})


def fallen(agent: AgentView) -> str | None:
    """Its vehicle fell, or its motors were switched off, by an order too."""
    status = agent.status
    fell = status and (status.action in _FALLEN or status.cause is Cause.FALL)
    return _reason(status) if status and fell else None


def failed(agent: AgentView) -> str | None:
    """It failed by itself: from the moment on at which it breaks the mission off."""
    gone = _breaks_off(agent)
    return _reason(gone) if gone is not None and gone.cause is not Cause.PEER else None


def follows(agent: AgentView) -> str | None:
    """It breaks the mission off because of another agent: the alarm is that one's."""
    gone = _breaks_off(agent)
    return _reason(gone) if gone is not None and gone.cause is Cause.PEER else None


def _breaks_off(agent: AgentView) -> AgentStatus | None:
    """Its status, from the moment on at which it breaks the mission off by no order."""
    status = agent.status
    if status is None or fallen(agent) or status.cause in _ORDERED or _yields(agent):
        return None
    gone = status.action not in (None, FailsafeAction.HOLD) or status.outcome is Outcome.FAILED
    return status if gone else None


def out_by_order(agent: AgentView) -> str | None:
    """It was landed or called back, or the process that started it is gone."""
    status = agent.status
    if status is None or status.cause not in _ORDERED or fallen(agent):
        return None
    # others than those that an order named may hold because of it (`policies.left_by_order`)
    return None if status.action is FailsafeAction.HOLD else _reason(status)


def taken_over(agent: AgentView) -> str | None:
    """Others fly its vehicle."""
    if not _yields(agent):
        return None
    told = agent.status.reason if agent.status else ""
    return told or "a pilot or a failsafe has taken the vehicle"


def holding(agent: AgentView) -> str | None:
    """A policy stopped it; it may go on."""
    status = agent.status
    held = status is not None and status.action is FailsafeAction.HOLD
    return f"holds: {_reason(status)}" if status and held else None


def is_out(agent: AgentView) -> bool:
    """It no longer flies the mission, and will not again."""
    acts = agent.status.action if agent.status else None
    return agent.phase is Phase.ENDED or acts not in (None, FailsafeAction.HOLD)


def _yields(agent: AgentView) -> bool:
    return agent.phase is Phase.YIELD and not fallen(agent)


def _reason(status: AgentStatus) -> str:
    return status.reason or "gives no reason"
