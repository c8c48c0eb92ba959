"""A stranger on an open mesh that sends as fast as it can: `python -m tests.security.flooder KIND
SWARM SECONDS ENDPOINT [aside]`; prints how much it has sent."""

from __future__ import annotations

import json
import os
import socket
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import count, cycle

import zenoh

from swarm_ctl.core.model.messages import AgentState, Command, Event, Phase, Severity
from swarm_ctl.core.model.steps.form import FormStep
from swarm_ctl.mesh import keys
from swarm_ctl.mesh.payloads import VERSION, encode

STATE = AgentState(99, 1, 1.0, 1, Phase.FLY, 1, False, True, (1, 2, 3), (0, 0, 0), (1, 2), (0, 0))
HUGE = bytes([VERSION]) + bytes(10_000_000)
Words = Iterator[tuple[str, bytes]]
"""(key, bytes)."""


def _states(swarm: str) -> Words:
    """Of an agent that the plan does not have."""
    key = keys.STATE.key(swarm, 99)
    for k in count(1):
        yield key, encode(replace(STATE, seq=k, time_s=k / 20))


def _liars(swarm: str) -> Words:
    """Under the key of agent 99, of agent 1."""
    key = keys.STATE.key(swarm, 99)
    for k in count(1):
        yield key, encode(replace(STATE, agent=1, seq=k, time_s=k / 20))


def _holds(swarm: str) -> Words:
    """For an agent that is none."""
    key = keys.COMMAND.key(swarm, "evil")
    for k in count(1):
        yield key, encode(Command(f"h{k}", "hold", (99,), 1.0))


def _names(swarm: str) -> Words:
    """The same, of a new station each."""
    for k in count(1):
        yield keys.COMMAND.key(swarm, f"evil-{k}"), encode(Command(f"n{k}", "hold", (99,), 1.0))


def _commands(swarm: str) -> Words:
    """As large as a command may be."""
    key, shape = keys.COMMAND.key(swarm, "evil"), "x" * (keys.COMMAND.bounds.size - 1000)
    step = FormStep(shape, ((0.0, 0.0),), 1.0, 1.0, 1.0)
    for k in count(1):
        yield key, encode(Command(f"{k}", "form", (), 1.0, step))


def _events(swarm: str) -> Words:
    key = keys.EVENT.key(swarm, 99)
    for k in count(1):
        yield key, encode(Event(99, k / 20, Severity.INFO, f"event {k} " + "x" * 1000))


def _clocks(swarm: str) -> Words:
    """Small ones, each of which wants to be stamped when it comes."""
    return cycle([(keys.CLOCK.key(swarm, 99), bytes([VERSION]) + bytes(11))])


def _huge(channel: keys.Channel[object], owner: str) -> Callable[[str], Words]:
    return lambda swarm: cycle([(channel.key(swarm, owner), HUGE)])


WORDS: dict[str, Callable[[str], Words]] = {
    "states of an unknown agent": _states,
    "states that say another agent": _liars,
    "holds for an agent that is none": _holds,
    "stations without number": _names,
    "commands of 24 kB": _commands,
    "events": _events,
    "clock words": _clocks,
    "clock words of 10 MB": _huge(keys.CHANNELS[1], "99"),
    "commands of 10 MB": _huge(keys.CHANNELS[6], "evil"),
    "events of 10 MB": _huge(keys.CHANNELS[4], "99"),
}
SILENT = "500 silent connections"
KINDS = (*WORDS, SILENT)


def flood(words: Words, endpoint: str, seconds: float) -> int:
    """Put them, each when the link takes it; how many."""
    config = zenoh.Config()
    for name, value in (
        ("mode", "client"),
        ("connect/endpoints", [endpoint]),
        ("connect/timeout_ms", 5000),
    ):
        config.insert_json5(name, json.dumps(value))
    config.insert_json5("scouting/multicast/enabled", "false")
    session, sent = zenoh.open(config), 0
    until_s = time.monotonic() + seconds
    for key, data in words:
        if time.monotonic() > until_s:
            break
        session.put(key, data, congestion_control=zenoh.CongestionControl.BLOCK)
        sent += 1
    session.close()  # type: ignore[no-untyped-call]
    return sent


def connect(endpoint: str, seconds: float) -> int:
    """500 connections that say nothing, each opened again when it is closed; how many."""
    host, port = endpoint.removeprefix("tcp/").rsplit(":", 1)
    open_: list[socket.socket | None] = [None] * 500
    opened, until_s = 0, time.monotonic() + seconds
    while time.monotonic() < until_s:
        for k, each in enumerate(open_):
            if each is not None and not _closed(each):
                continue
            try:
                open_[k] = socket.create_connection((host, int(port)), 1.0)
                opened += 1
            except OSError:
                open_[k] = None
        time.sleep(0.01)
    return opened


def _closed(one: socket.socket) -> bool:
    one.setblocking(False)
    try:
        gone = one.recv(4096) == b""
    except BlockingIOError:
        return False
    except OSError:
        gone = True
    if gone:
        one.close()
    return gone


def main() -> None:
    """Say what was done."""
    kind, swarm, seconds, endpoint = sys.argv[1:5]
    os.nice(10)  # a stranger has a machine of its own
    if "aside" in sys.argv[5:] and hasattr(os, "SCHED_IDLE"):
        # Beside nice 10 an agent waited up to 20 ms of each tick for a core that floods had. What
        # a flood costs the swarm's own processes is the same.
        os.sched_setscheduler(0, os.SCHED_IDLE, os.sched_param(0))
    if kind == SILENT:
        print(connect(endpoint, float(seconds)))
    else:
        print(flood(WORDS[kind](swarm), endpoint, float(seconds)))


if __name__ == "__main__":
    main()
