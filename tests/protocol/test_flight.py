"""A real simulator process, a real UDP client: a whole flight per persona, in accelerated time."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.protocol.simulator import ORIGIN, Pilot, Simulator, pilot, settings, simulator

PERSONAS = pytest.mark.parametrize("persona", ["ardupilot", "px4"])
PREARM = 0x10000000
ARMED = 128
CUSTOM_MODE = {
    "GUIDED": 4,
    "LAND": 9,
    "OFFBOARD": 6 << 16,
    "POSCTL": 3 << 16,
    "AUTO.LAND": 4 << 16 | 6 << 24,
}


@pytest.fixture
def flown(tmp_path: Path, persona: str) -> Iterator[tuple[Simulator, Pilot]]:
    """A vehicle with streams, ready to arm, and another one that stands by."""
    with simulator(tmp_path, settings(tmp_path, persona, n=2)) as sim, pilot(sim) as p:
        for message_id, rate_hz in ((1, 2.0), (32, 20.0), (33, 5.0), (245, 5.0), (246, 2.0)):
            p.stream(message_id, rate_hz)
        yield sim, p


def wait_ready(p: Pilot) -> None:
    p.wait("SYS_STATUS", lambda m: bool(m.onboard_control_sensors_health & PREARM))


def take_off(p: Pilot, persona: str, height_m: float) -> None:
    wait_ready(p)
    if persona == "ardupilot":
        assert p.command(176, 1, CUSTOM_MODE["GUIDED"]) == 0
        assert p.command(400, 1) == 0
        assert p.command(22, 0, 0, 0, 0, 0, 0, height_m) == 0
    else:
        assert p.command(400, 1) == 0
        assert p.command(22, 0, 0, 0, math.nan, math.nan, math.nan, ORIGIN["alt_m"] + height_m) == 0
    p.wait("GLOBAL_POSITION_INT", lambda m: m.relative_alt > (height_m - 0.3) * 1000)


def follow_setpoints(p: Pilot, persona: str) -> None:
    """PX4 wants a stream before it enters OFFBOARD."""
    if persona == "px4":
        p.listen(1.3, each=p.velocity(0.0, 0.0, 0.0))
        for _ in range(5):  # a busy machine may have torn the stream
            if p.command(176, 1, 6, 0) == 0:
                return
            p.listen(1.3, each=p.velocity(0.0, 0.0, 0.0))
        raise TimeoutError("OFFBOARD was never accepted")


@PERSONAS
def test_a_whole_flight(flown: tuple[Simulator, Pilot], persona: str) -> None:
    """Arm, take off, fly, fall silent, see the failsafe, land, disarm; the truth tells the same."""
    sim, p = flown
    take_off(p, persona, 5.0)
    follow_setpoints(p, persona)
    p.wait(
        "LOCAL_POSITION_NED",
        lambda m: abs(m.vx - 2.0) < 0.3 and abs(m.vy - 1.0) < 0.2,
        each=p.velocity(2.0, 1.0, 0.0),
    )
    there = p.wait("LOCAL_POSITION_NED", each=p.velocity(2.0, 1.0, 0.0))
    if persona == "ardupilot":
        silence_holds(p)
        assert p.command(176, 1, CUSTOM_MODE["LAND"]) == 0
        p.wait("EXTENDED_SYS_STATE", lambda m: m.landed_state == 4)
    else:
        p.wait("HEARTBEAT", lambda m: m.custom_mode == CUSTOM_MODE["POSCTL"])
        assert any("Failsafe activated" in text for text in p.texts)
    p.wait("EXTENDED_SYS_STATE", lambda m: m.landed_state == 1)
    p.wait("HEARTBEAT", lambda m: not m.base_mode & ARMED)
    landed = p.wait("LOCAL_POSITION_NED")
    assert landed.x > there.x + 2.0
    sim.cut_lifeline()
    assert sim.end() == 0
    check_truth(sim, p)


def silence_holds(p: Pilot) -> None:
    """GUID_TIMEOUT: stops, keeps its mode, stays armed, says nothing."""
    said = len(p.texts)
    p.listen(2.5)
    assert p.latest["LOCAL_POSITION_NED"].vx > 1.8
    p.wait("LOCAL_POSITION_NED", lambda m: math.hypot(m.vx, m.vy) < 0.1)
    beat = p.wait("HEARTBEAT")
    assert (beat.custom_mode, bool(beat.base_mode & ARMED)) == (CUSTOM_MODE["GUIDED"], True)
    assert p.texts[said:] == []


def check_truth(sim: Simulator, p: Pilot) -> None:
    lines = sim.truth()
    assert lines[0]["type"] == "header"
    assert lines[0]["sysids"] == [1, 2]
    assert lines[-1]["type"] == "end"
    assert [(x["sysid"], x["event"]) for x in lines if x["type"] == "event"] == [
        (1, "liftoff"),
        (1, "touchdown"),
    ]
    states = [x for x in lines if x["type"] == "state"]
    times = [x["t"] for x in states]
    regular = times[:-1]  # the last one is written when the simulator ends, whatever the rate
    assert regular == pytest.approx([times[0] + 0.1 * i for i in range(len(regular))], abs=0.011)
    assert 0.0 < times[-1] - regular[-1] < 0.111
    assert states[-1]["ned"][1] == pytest.approx([5.559, 0.0, 0.0], abs=0.01)
    minima = [pair for x in lines if x["type"] == "min" for pair in x["pairs"]]
    # more than 3 m above a parked vehicle nothing counts
    low = [s["ned"] for s in states if s["airborne"][0] and s["ned"][0][2] > s["ned"][1][2] - 3.0]
    closest = min(math.dist(one[:2], other[:2]) for one, other in low)
    assert minima[-1][:2] == [1, 2]
    assert minima[-1][2] <= closest + 1e-3
    moved = [states[-1]["ned"][0][i] - states[0]["ned"][0][i] for i in (0, 1)]
    local = p.latest["LOCAL_POSITION_NED"]
    origin = [states[-1]["ned"][0][i] - (local.x, local.y)[i] for i in (0, 1)]
    assert math.hypot(*moved) > 5.0
    assert math.hypot(*origin) > 2.0, "the vehicle's own origin is elsewhere"


@PERSONAS
def test_the_other_vehicle_is_seen_as_traffic(flown: tuple[Simulator, Pilot], persona: str) -> None:
    _, p = flown
    seen = p.wait("ADSB_VEHICLE")
    assert (seen.ICAO_address, seen.lat) == (2, round((ORIGIN["lat_deg"] + 5e-5) * 1e7))


@PERSONAS
def test_garbage_on_the_port_harms_no_client(flown: tuple[Simulator, Pilot], persona: str) -> None:
    _, p = flown
    for junk in (
        b"",
        b"\x00" * 2000,
        b"\xfd" * 300,
        b"\xfd\xff\x01" + b"x" * 40,
        bytes(range(256)) * 5,
    ):
        p._link.write(junk)
    p.mav.command_long_send(99, 1, 400, 0, 1, 0, 0, 0, 0, 0, 0)
    assert p.command(512, 148) == 0
    assert p.latest["AUTOPILOT_VERSION"].get_srcSystem() == 1
    beat = p.wait("HEARTBEAT")
    assert not beat.base_mode & ARMED


@PERSONAS
def test_two_clients_at_once(flown: tuple[Simulator, Pilot], persona: str) -> None:
    sim, p = flown
    # a PX4 answers one partner on a link
    with pilot(sim, system=254, further=persona == "px4") as other:
        other.mav.param_request_list_send(1, 1)
        first = other.wait("PARAM_VALUE")
        other.wait("PARAM_VALUE", lambda m: m.param_index == first.param_count - 1)
        wait_ready(p)
        assert p.command(400, 1) == 0
        other.wait("HEARTBEAT", lambda m: bool(m.base_mode & ARMED))
        p.wait("HEARTBEAT", lambda m: bool(m.base_mode & ARMED))


@pytest.mark.parametrize("persona", ["ardupilot"])
def test_gcs_silence_lands_when_the_parameter_says_so(
    flown: tuple[Simulator, Pilot], persona: str
) -> None:
    """Also what ends a swarm whose agents died: the lifeline waits for the vehicle to come down by
    itself."""
    sim, p = flown
    p.mav.param_set_send(1, 1, b"FS_GCS_ENABLE", 5, 2)
    assert p.wait("PARAM_VALUE", lambda m: m.param_id == "FS_GCS_ENABLE").param_value == 5
    take_off(p, persona, 3.0)
    p.silent = True
    silent_since = sim.now()
    sim.cut_lifeline()
    p.wait("HEARTBEAT", lambda m: m.custom_mode == CUSTOM_MODE["LAND"])
    assert 4.0 < sim.now() - silent_since < 8.0
    assert sim.end() == 0
    assert [x["event"] for x in sim.truth() if x["type"] == "event"] == ["liftoff", "touchdown"]
