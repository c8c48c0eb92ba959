"""The view as one line of JSON, for scripts. Lengths in metres, times in mission seconds; null: not
known."""

from __future__ import annotations

import json
from typing import Any

from swarm_ctl.station.picture.alarms import alarms
from swarm_ctl.station.picture.summaries import verdict
from swarm_ctl.station.picture.view import AgentView, CommandView, GroupView, SwarmView


def json_line(view: SwarmView) -> str:
    """Everything a script may want to act on; keys are only ever added."""
    standing = alarms(view)
    (level, text), *_ = verdict(view, standing)
    return json.dumps(
        {
            "version": 1,
            "time_s": round(view.time_s, 3),
            "since_s": round(view.since_s, 3),
            "mission": view.plan.name,
            "plan_hash": f"{view.plan_hash:016x}",
            "step": view.step,
            "steps": view.plan.last_step,
            "step_name": view.group.step_name(view.step),
            "level": level.name.lower(),
            "verdict": text,
            "error_m": _rounded(view.error_m),
            "groups": [_group(group) for group in view.groups],
            "agents": [_agent(agent, view) for agent in view.agents],
            "alarms": [
                {"name": a.name, "level": a.level.name.lower(), "agents": a.agents, "text": a.text}
                for a in standing
            ],
            "commands": [_command(command) for command in view.commands],
            "mesh": view.protection.mesh.lower(),
            "who": view.protection.who,
            "unreadable": view.health.bad_payloads,
            "skipped": view.health.frames_dropped,
        },
        separators=(",", ":"),
    )


def _group(group: GroupView) -> dict[str, Any]:
    """One that flies now; of a mission that never splits, the whole swarm."""
    return {
        "name": group.name,
        "step": group.step,
        "step_name": group.step_name,
        "agents": group.agents,
        "silent": group.silent,
        "error_m": _rounded(group.error_m),
        "waits_for": group.waits_for,
        "waits_s": _rounded(group.waits_s),
    }


def _agent(agent: AgentView, view: SwarmView) -> dict[str, Any]:
    told, state, status = agent.newest, agent.state, agent.status
    group = view.group_now(agent.id)
    return {
        "id": agent.id,
        "group": group.name if group is not None else None,
        "phase": agent.phase.name.lower() if agent.phase is not None else None,
        "step": told.step if told else None,
        "done": told.done if told else None,
        "airborne": agent.airborne,
        "lost": agent.lost,
        "outcome": status.outcome if status else None,
        "reason": status.reason if status else None,
        "mode": status.mode if status else None,
        "armed": status.armed if status else None,
        "battery_percent": status.battery_percent if status else None,
        "position_ned_m": [round(x, 3) for x in state.position_ned_m] if state else None,
        "velocity_ned_mps": [round(x, 3) for x in state.velocity_ned_mps] if state else None,
        "error_m": _rounded(agent.error_m),
        "nearest_agent": agent.nearest_agent,
        "nearest_m": _rounded(agent.nearest_m),
        "age_s": _rounded(agent.link.age_s),
        "loss": round(agent.link.recent_loss, 4),
        "round_trip_s": _rounded(agent.round_trip_s, 5),
        "heartbeat_age_s": _rounded(status.heartbeat_age_s) if status else None,
    }


def _command(command: CommandView) -> dict[str, Any]:
    return {
        "id": command.command.id,
        "kind": command.command.kind,
        "agents": command.command.agents,
        "accepted": sorted(i for i, ack in command.acks.items() if ack.accepted),
        "refused": {i: ack.reason for i, ack in sorted(command.acks.items()) if not ack.accepted},
    }


def _rounded(value: float | None, digits: int = 3) -> float | None:
    return None if value is None else round(value, digits)
