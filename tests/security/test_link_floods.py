"""Floods on a vehicle's link, open and signed: a tick's work and memory are bounded, so that
setpoints go on at 19 Hz and more. Work is counted in calls, which are the same on any machine; even
the ratio of a tick's time to that of a loop beside it varied by half."""

from __future__ import annotations

import random
import resource
import sys
import tracemalloc
from collections.abc import Callable
from types import FrameType
from typing import Final

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from swarm_ctl.core.model.vehicle import FlyGoal
from swarm_ctl.mavlink.link import MAX_TRIED, VehicleLink
from swarm_ctl.mavlink.signing import LinkSigning
from swarm_ctl.mavlink.wires import MemoryWire, memory_wires
from swarm_sim.network.codec import Codec
from tests.unit.mavlink import wire

KEY: Final = bytes(range(32))
START: Final = 10**12
_VEHICLE: Final = dialect.MAVLink(None, 7, 1)
_NOISE: Final = random.Random(1).randbytes(4096)
_LONG: Final = wire.text("x" * 50).pack(_VEHICLE)
FLOODS: Final = {
    "zeros": bytes(4096),
    "noise": _NOISE,
    "beginnings": b"\xfd" * 4096,
    "long frames that are none": (b"\xfd\xff\0\0" * 1024),
    "MAVLink 1 beginnings": (b"\xfe\xfe\0\0\0" * 820)[:4096],
    "heartbeats": wire.heartbeat().pack(_VEHICLE) * 195,
    "positions": wire.local_position().pack(_VEHICLE) * 100,
    "texts": _LONG * 60,
}
MOST_CALLS: Final = 230_000
"""What a tick of an agent, or a step of the simulator, may take: 40 of its 50 ms on a slow machine,
half of that on a good one. The worst floods make 216,266 calls (texts, unsigned, at an agent) and
224,834 (heartbeats at the simulator), on Python 3.11 as on 3.13."""
FRAMES: Final = 10_000_000


@pytest.mark.parametrize("is_signed", [False, True], ids=["open", "signed"])
@pytest.mark.parametrize("flood", FLOODS)
def test_a_flood_leaves_an_agent_its_tick(flood: str, is_signed: bool) -> None:
    near, far = memory_wires(limit=600)
    signing = LinkSigning(KEY, START) if is_signed else None
    link = VehicleLink(near, "ardupilot", 7, signing=signing)
    for tick in range(2):
        before = sum(framer.tried for framer in link._framers)
        _write(far, FLOODS[flood])
        assert _calls(lambda now=tick * 0.05: _turn(link, now)) < MOST_CALLS
        assert sum(framer.tried for framer in link._framers) - before < MAX_TRIED + 400
    tracemalloc.start()
    _write(far, FLOODS[flood])
    _turn(link, 0.1)
    grown, _ = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert grown < 4e6, "the flood itself included"


def _write(far: MemoryWire, data: bytes) -> None:
    """More than a link takes in a tick."""
    for _ in range(600):
        far.write(data)


def _turn(link: VehicleLink, now: float) -> None:
    link.receive(now)
    link.view()
    link.pursue(FlyGoal((1.0, 0.0, 0.0)), now)


def _calls(work: Callable[[], None]) -> int:
    """Of functions, Python's and C's, in `work`."""
    count = 0

    def hear(_frame: FrameType, event: str, _argument: object) -> None:
        nonlocal count
        count += event in ("call", "c_call")

    sys.setprofile(hear)
    try:
        work()
    finally:
        sys.setprofile(None)
    return count


@pytest.mark.parametrize("flood", FLOODS)
def test_a_flood_leaves_the_simulator_its_step(flood: str) -> None:
    """64 datagrams are taken at once from one socket."""
    codec = Codec(7)

    def step() -> None:
        for _ in range(64):
            for _ in codec.messages(FLOODS[flood]):
                pass

    assert _calls(step) < MOST_CALLS


@pytest.mark.long
@pytest.mark.timeout(1800)
@pytest.mark.parametrize("persona", ["ardupilot", "px4"])
def test_ten_million_hostile_frames_cost_no_honest_one_and_no_memory(persona: str) -> None:
    near, far = memory_wires(limit=8)
    link = VehicleLink(near, persona, 7, signing=LinkSigning(KEY, START))
    own = dialect.MAVLink(None, 7, 1)
    own.signing.secret_key, own.signing.sign_outgoing = KEY, True
    own.signing.timestamp = START
    wrong = dialect.MAVLink(None, 7, 1)
    wrong.signing.secret_key, wrong.signing.sign_outgoing = bytes(32), True
    wrong.signing.timestamp = 2**48 - 1
    replayed = wire.heartbeat().pack(own)
    kinds = (
        wire.heartbeat().pack(_VEHICLE),
        wire.heartbeat().pack(_VEHICLE, force_mavlink1=True),
        wire.heartbeat().pack(wrong),
        replayed,
    )
    far.write(replayed)
    link.receive(0.0)
    chunks = [frame * (4096 // len(frame)) for frame in kinds]
    sent, honest, now = 0, 1, 0.0
    before_kb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    while sent < FRAMES:
        for chunk, frame in zip(chunks, kinds, strict=True):
            far.write(chunk)
            sent += len(chunk) // len(frame)
        far.write(wire.heartbeat().pack(own))
        honest, now = honest + 1, now + 0.05
        link.receive(now)
        link.view()
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before_kb < 16_000
    assert link.counters.frames == honest
    assert link.counters.refused == sent
