"""A minute of flight as a recording holds it: agent 3 is silent for a while, an order comes, all
end."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

from swarm_ctl.core.model.messages import Ack, Command, Event, Payload, Phase, Severity
from swarm_ctl.station.picture.playback import Film
from tests.unit.station.swarm import FORM, hexagon_plan, state_of, status_of

PLAN = replace(hexagon_plan(), tick_s=0.25)
START_S, END_S = 5.0, 65.0
SILENT_S = (20.0, 30.0)
"""Agent 3's; the plan's limit is 3 s."""
COMMAND_S = 50.0


def said() -> list[tuple[float, Payload]]:
    """(time heard, payload), by time."""
    found: list[tuple[float, Payload]] = []
    for k in range(int((END_S - START_S) * 4) + 1):
        now_s = START_S + k / 4
        for agent in range(1, 7):
            if agent == 3 and SILENT_S[0] < now_s < SILENT_S[1]:
                continue
            step = FORM - 1 if now_s < 15.0 else FORM
            phase = Phase.ENDED if now_s > 60.0 else Phase.FLY
            changed = {"step": step, "phase": phase, "airborne": phase is Phase.FLY}
            heard_s = now_s + 0.001 * agent
            found.append((heard_s, replace(state_of(PLAN, agent, now_s, seq=k), **changed)))  # type: ignore[arg-type]
            if k % 4 == 0:
                found.append((heard_s, replace(status_of(PLAN, agent, now_s), **changed)))  # type: ignore[arg-type]
    found.append((40.0, Event(2, 39.9, Severity.WARNING, "vehicle: low battery")))
    found.append((COMMAND_S, Command("c", "land", (), COMMAND_S)))
    found += [(COMMAND_S + 0.1, Ack(agent, "c", True, "")) for agent in range(1, 7)]
    return sorted(found, key=lambda one: one[0])


@cache
def scenes() -> list[list[tuple[float, Payload]]]:
    """In parts of a few seconds, the last one empty (as a chunk of truth alone is): shared."""
    all_said = said()
    return [[one for one in all_said if at_s <= one[0] < at_s + 4] for at_s in range(0, 70, 4)]


def film() -> Film:
    """Ready to be looked at, not read ahead."""
    return Film(scenes(), PLAN)
