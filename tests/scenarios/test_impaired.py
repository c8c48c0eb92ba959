"""The impaired transport does what it says: shares of loss and duplicates, bounds of delay,
silence, the seed."""

from __future__ import annotations

from swarm_ctl.mesh.impaired import ImpairedTransport, Impairment
from swarm_ctl.mesh.keys import NEWEST
from swarm_ctl.mesh.memory_transport import MemoryHub, MemoryTransport
from swarm_ctl.mesh.transport import Inlet


class Pair:
    """One speaks, the other listens through an impairment; a message says when it was sent."""

    def __init__(self, impairment: Impairment, seed: int = 1) -> None:
        self.now = 0.0
        hub = MemoryHub(lambda: self.now)
        self.speaker = MemoryTransport(hub)
        self.transport = ImpairedTransport(
            MemoryTransport(hub), [7, 8], impairment, lambda: self.now, seed
        )
        self.inlet: Inlet = self.transport.subscribe("swarm/x/agent/*/state")

    def hear(self, count: int, name: int = 7) -> list[tuple[float, float]]:
        """Send one every 10 ms; (received, sent) of what comes, up to a second after the last."""
        heard = []
        for k in range(count + 100):
            self.now += 0.01
            if k < count:
                self.speaker.publish(f"swarm/x/agent/{name}/state", repr(self.now).encode(), NEWEST)
            heard += [(at, float(bytes(data))) for at, _, data in self.inlet.drain()]
        return heard


def test_nothing_wrong_changes_nothing() -> None:
    heard = Pair(Impairment()).hear(50)
    assert len(heard) == 50
    assert all(received == sent for received, sent in heard)


def test_loss_and_duplicates_have_their_shares() -> None:
    assert 560 < len(Pair(Impairment(loss=0.4)).hear(1000)) < 640
    twice = [sent for _, sent in Pair(Impairment(duplicate=0.3)).hear(1000)]
    assert 1260 < len(twice) < 1340
    assert len(set(twice)) == 1000


def test_jitter_delays_within_its_bounds_and_reorders() -> None:
    heard = Pair(Impairment(delay_s=0.1, jitter_s=0.2)).hear(500)
    late = [received - sent for received, sent in heard]
    assert 0.1 - 1e-9 <= min(late) < 0.12
    assert 0.28 < max(late) <= 0.3 + 1e-9
    received = [at for at, _ in heard]
    sent = [at for _, at in heard]
    assert received == sorted(received)
    assert sent != sorted(sent)


def test_a_silent_publisher_is_not_heard_and_another_is() -> None:
    pair = Pair(Impairment(delay_s=0.05))
    pair.transport.silent.add("7")
    assert not pair.hear(20)
    assert len(pair.hear(20, name=8)) == 20
    pair.transport.silent.clear()
    assert len(pair.hear(20)) == 20


def test_the_seed_decides() -> None:
    bad = Impairment(0.3, 0.05, 0.1, 0.1)
    first, again, other = (Pair(bad, seed).hear(200) for seed in (1, 1, 2))
    assert first == again
    assert first != other
