"""`trust vehicle` on the simulated vehicles of both personas: the key goes in, is used, and goes
out; nothing is claimed that the vehicle did not show."""

from __future__ import annotations

from typing import Any

import pytest

from swarm_ctl.mavlink.key_setup import KeyReport, KeySetup, Signs
from swarm_ctl.mavlink.signing import UNITS_S, LinkSigning
from swarm_ctl.mavlink.wires import memory_wires
from swarm_sim.network.hub import Hub
from swarm_sim.network.signing import VehicleSigning as VehicleSigning
from tests.unit.sim.harness import config

KEY, OTHER = bytes(range(32)), bytes(range(1, 33))
START = 10**12


class Bench:
    """A vehicle on a virtual clock."""

    def __init__(self, persona: str, key: bytes | None = None) -> None:
        self.near, self.far = memory_wires()
        self.now = 0.0
        self.signing = VehicleSigning(key, self.stamp)
        self.hub = Hub(config(1, persona=persona), 0.0, self._take, lambda _: self.signing)

    def stamp(self) -> int:
        return START + round(self.now * UNITS_S)

    def _take(self, _: int, data: bytes, __: Any) -> None:
        self.far.write(data)

    def set_up(self, key: bytes = KEY, *, clear: bool = False) -> KeyReport:
        work = KeySetup(self.near, 1, key, LinkSigning(key, self.stamp()), clear=clear)
        while (report := work.step(self.now)) is None:
            self.now += 0.05
            while (data := self.far.read()) is not None:
                self.hub.receive(0, data, ("127.0.0.1", 1))
            while self.hub.world.next_s <= self.now:
                self.hub.step()
        return report


@pytest.fixture(params=["ardupilot", "px4"])
def persona(request: pytest.FixtureRequest) -> str:
    return str(request.param)


def test_a_key_is_set_up_used_and_taken_off(persona: str) -> None:
    bench = Bench(persona)
    px4 = persona == "px4"
    for _ in range(2):
        assert bench.set_up() == KeyReport("", px4, Signs.OURS, takes_unsigned=False)
        assert bench.signing.active
    assert bench.set_up(clear=True) == KeyReport("", px4, Signs.NOT, takes_unsigned=False)
    assert not bench.signing.active


@pytest.mark.parametrize("clear", [False, True])
def test_a_vehicle_with_another_key_keeps_it(persona: str, clear: bool) -> None:
    bench = Bench(persona, OTHER)
    report = bench.set_up(clear=clear)
    assert report.signs is Signs.OTHER
    assert "vehicle 1: it signs with another key; allowed: take that off first" in report.trouble
    assert bench.signing._key == OTHER


def test_an_armed_vehicle_is_left_alone(persona: str) -> None:
    bench = Bench(persona)
    bench.hub.world.vehicles[0].firmware.set_armed()
    assert bench.set_up().trouble == "vehicle 1 is armed; allowed: a disarmed one, on the bench"
    assert not bench.signing.active


def test_firmware_that_does_not_sign_is_told(persona: str, monkeypatch: pytest.MonkeyPatch) -> None:
    bench = Bench(persona)
    monkeypatch.setattr(bench.signing, "set_up", lambda *_: None)
    report = bench.set_up()
    assert report.signs is Signs.NOT
    assert ("PX4 signs from 1.18" in report.trouble) == (persona == "px4")


def test_a_port_that_takes_unsigned_frames_is_told(
    persona: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As ArduPilot's first port."""
    bench = Bench(persona)
    monkeypatch.setattr(bench.signing, "accepts", lambda *_: True)
    assert bench.set_up().takes_unsigned


def test_a_silent_link_is_told() -> None:
    near, _ = memory_wires()
    work, now = KeySetup(near, 1, KEY, LinkSigning(KEY, START)), 0.0
    while (report := work.step(now)) is None:
        now += 0.5
    assert report == KeyReport("vehicle 1 was not heard in 15 s")
