"""A stranger of an open mesh writes under an agent's own key, by a link of its own."""

from __future__ import annotations

import json
import socket
import threading
import time
from contextlib import closing

import pytest
import zenoh

from swarm_ctl.core.model.messages import RefusalReason
from swarm_ctl.mesh.gate import Gate, Stations
from swarm_ctl.mesh.keys import STATE
from swarm_ctl.mesh.refusals import Refusals
from swarm_ctl.mesh.zenoh_transport import ZenohTransport
from swarm_ctl.runtime.launch.ports import free_ports

pytestmark = pytest.mark.realtime


def test_a_flood_under_an_agents_key_takes_none_of_its_words() -> None:
    """Some thousand a second beside the agent's twenty, of which nine tenths and more are read."""
    at = f"tcp/127.0.0.1:{free_ports(1, socket.SOCK_STREAM)[0]}"
    key, refusals, ended = STATE.key("s", 1), Refusals(), threading.Event()
    config = zenoh.Config()
    config.insert_json5("mode", '"client"')
    config.insert_json5("connect/endpoints", json.dumps([at]))
    config.insert_json5("scouting/multicast/enabled", "false")

    def flood(session: zenoh.Session) -> None:
        while not ended.wait(0.001):
            for _ in range(4):
                session.put(key, b"f" * 140)

    with (
        closing(ZenohTransport([at], [], time.monotonic)) as victim,
        closing(ZenohTransport([], [at], time.monotonic)) as agent,
        zenoh.open(config) as session,
    ):
        inlet = victim.subscribe(STATE.key_expression("s"))
        gate, honest = Gate(STATE, [key], refusals, Stations()), 0
        time.sleep(1.0)
        thread = threading.Thread(target=flood, args=(session,))
        thread.start()
        for tick in range(140):
            agent.publish(key, b"h" * 140, STATE.qos)
            time.sleep(0.05)
            read = gate.admit(inlet.drain())
            if tick >= 60:  # the first hundreds pass in any case
                honest += sum(data[:1] == b"h" for _, _, data in read)
        ended.set()
        thread.join()
    assert honest >= 72
    for told in refusals.recent(time.monotonic()):
        assert told.reason is RefusalReason.TOO_MANY
        assert "under agent 1's key, which on an open mesh each may use" in told.words
