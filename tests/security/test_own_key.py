"""A stranger of an open mesh writes under an agent's own key, by links of its own."""

from __future__ import annotations

import json
import math
import random
import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing
from dataclasses import replace
from typing import Final

import pytest
import zenoh

from swarm_ctl.core.model.messages import (
    AgentState,
    Answers,
    ClockNews,
    Glimpse,
    Phase,
    RefusalReason,
)
from swarm_ctl.core.swarm.peers import Peers
from swarm_ctl.engine.launch.ports import free_ports
from swarm_ctl.mesh import keys
from swarm_ctl.mesh.keys import STATE
from swarm_ctl.mesh.memory_transport import MemoryHub, MemoryTransport
from swarm_ctl.mesh.node import Node
from swarm_ctl.mesh.payloads import encode
from swarm_ctl.mesh.transport import Transport
from swarm_ctl.mesh.zenoh_transport import ZenohTransport
from tests.unit.core.builders import plan

TICK_S: Final = 0.05
FLIES: Final = AgentState(
    2, 0, 0.0, 1, Phase.FLY, 0, False, True, (0, 0, -5), (1, 0, 0), (1, 0), (1, 0)
)
"""North, with 1 m/s; the flooder's are elsewhere, old, or from another time."""


def honest(now: float) -> AgentState:
    """Agent 2's state, in its tick at `now` [s]."""
    seq = round(now / TICK_S)
    return replace(FLIES, seq=seq, time_s=now, position_ned_m=(now, 0, -5), stop_point_m=(now, 0))


def forged(now: Callable[[], float]) -> Iterator[AgentState]:
    """Without end."""
    draw = random.Random(1)
    while True:
        yield replace(
            honest(max(0.0, now() + draw.choice([-1.0, 0.0, 5.0]))),
            seq=draw.choice([1, 10**6]),
            position_ned_m=(draw.choice([now(), 40.0]), draw.uniform(5, 50), -5),
        )


class Listener:
    """Agent 1: what it reads under agent 2's key, and what it believes."""

    def __init__(self, transport: Transport, *channels: keys.Channel[AgentState]) -> None:
        self.node = Node(transport, "s", 1)
        self.node.listen(*channels, keys.CLOCK, agents=(1, 2))
        self.peers = Peers(plan(agents=2), 1, same_clock=(2,))
        self.read = self.clock_words = 0

    def tick(self, now: float, channel: keys.Channel[AgentState] = STATE) -> None:
        """Take in what came; honest states and clock words are counted."""
        for state, at_s in self.node.take(channel, self.peers.likely):
            self.read += state == honest(state.time_s)
            self.peers.hear(state, at_s)
        for news, _ in self.node.take(keys.CLOCK, self.peers.likely):
            self.clock_words += news.wants is Answers.REGULAR


@pytest.mark.parametrize("channel", [keys.STATE, keys.FAR], ids=lambda each: each.name)
@pytest.mark.parametrize("per_s", [400, 3_700, 12_000])
def test_what_may_follow_is_read_first(per_s: int, channel: keys.Channel[AgentState]) -> None:
    """Beside a flood over whatever links, all of an agent's states and clock words are read, once
    the first hundreds have used up its allowance."""
    now, hub = 0.0, MemoryHub(lambda: now)
    stranger, agent = MemoryTransport(hub), Node(MemoryTransport(hub), "s", 2)
    listener, said = Listener(MemoryTransport(hub), channel), 0
    lie, every = forged(lambda: now), {"state": 1, "far": 10}[channel.name]
    for tick in range(1, 300):
        now = round(tick * TICK_S, 9)
        lies = round(per_s * TICK_S / 2) if tick > 20 else 0  # the agent was there before
        words = [encode(next(lie)) for _ in range(lies)]
        old = encode(ClockNews(2, now - 60.0, Answers.SOON, ()))
        for word in words:  # half of the flood before, half behind
            stranger.publish(channel.key("s", 2), word, STATE.qos)
            stranger.publish(keys.CLOCK.key("s", 2), old, keys.CLOCK.qos)
        if tick % every == 0:
            agent.send(channel, honest(now))
            agent.send(keys.CLOCK, ClockNews(2, now, Answers.REGULAR, ()))
            said += tick > 200
        for word in words:
            stranger.publish(channel.key("s", 2), word, STATE.qos)
        if tick == 200:
            listener.read = listener.clock_words = 0
        listener.tick(now, channel)
    assert listener.read >= 0.9 * said
    assert listener.clock_words >= 9
    assert math.isclose(listener.peers.age(2, now), 0.0, abs_tol=10 * TICK_S)


def test_a_glimpse_is_of_the_keys_owner() -> None:
    """A flood under agent 2's key that names an agent which is heard takes no place of agent 2."""
    now, hub = 0.0, MemoryHub(lambda: now)
    stranger, agent = MemoryTransport(hub), Node(MemoryTransport(hub), "s", 2)
    listener = Listener(MemoryTransport(hub), STATE)
    seen: set[int] = set()
    for tick in range(1, 200):
        now = round(tick * TICK_S, 9)
        agent.send(STATE, honest(now))
        for _ in range(100):
            other = replace(honest(now + 1.0), agent=3)
            stranger.publish(STATE.key("s", 2), encode(other), STATE.qos)
        if tick == 100:
            listener.read = 0

        def likely(word: Glimpse, at_s: float) -> bool:
            seen.add(word.agent)
            return listener.peers.likely(word, at_s)

        for state, at_s in listener.node.take(STATE, likely):
            listener.read += state == honest(now)
            listener.peers.hear(state, at_s)
    assert listener.read >= 98
    assert seen == {2}


@pytest.mark.realtime
def test_a_flood_over_several_links_takes_none_of_an_agents_words_and_its_links_are_named() -> None:
    """Some thousand a second by three links beside the agent's twenty. Each link brings 200, which
    together are three times the allowance."""
    at, ended = f"tcp/127.0.0.1:{free_ports(1, socket.SOCK_STREAM)[0]}", threading.Event()
    config = zenoh.Config()
    config.insert_json5("mode", '"client"')
    config.insert_json5("connect/endpoints", json.dumps([at]))
    config.insert_json5("scouting/multicast/enabled", "false")
    began_s = time.monotonic()

    def clock() -> float:
        return time.monotonic() - began_s

    def flood(session: zenoh.Session) -> None:
        lie = forged(clock)
        words = [encode(next(lie)) for _ in range(50)]
        while not ended.wait(0.001):
            for word in words[:4]:
                session.put(STATE.key("s", 2), word)
            words.append(words.pop(0))

    with ExitStack() as opened:
        victim = opened.enter_context(closing(ZenohTransport([at], [], clock)))
        agent = Node(opened.enter_context(closing(ZenohTransport([], [at], clock))), "s", 2)
        sessions = [opened.enter_context(zenoh.open(config)) for _ in range(3)]
        listener = Listener(victim, STATE)
        time.sleep(0.5)
        threads = [threading.Thread(target=flood, args=(session,)) for session in sessions]
        for thread in threads:
            thread.start()
        for tick in range(140):
            now = clock()
            agent.send(STATE, replace(honest(now), seq=tick + 10, time_s=now))
            time.sleep(TICK_S)
            if tick == 60:  # the first hundreds pass in any case
                heard = listener.peers._by_id[2].received
            listener.tick(clock())
        told = listener.node.refused(clock())
        ended.set()
        for thread in threads:
            thread.join()
    assert listener.peers._by_id[2].received - heard >= 72
    (refusal,) = [each for each in told if each.reason is RefusalReason.TOO_MANY]
    words, _, links = refusal.words.partition("; most comes by ")
    assert "under agent 2's key, which on an open mesh each may use" in words
    assert links.startswith("the links of 127.0.0.1:")
    assert links.count("127.0.0.1:") == 3
