"""`zones push`, `clear` and `show` on the simulated vehicles of both personas."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import pytest

from swarm_ctl.core.model.plan import Fence, Zone
from swarm_ctl.mavlink.fence_items import (
    CIRCLE_OUTSIDE,
    INSIDE,
    OUTSIDE,
    FenceItem,
    FenceReport,
    FenceTransfer,
    items_of,
)
from swarm_ctl.mavlink.wires import memory_wires
from swarm_sim.firmware.flying.mission_items import FENCE
from swarm_sim.network.hub import Hub
from swarm_sim.network.signing import VehicleSigning as VehicleSigning
from tests.unit.core.builders import plan
from tests.unit.sim.harness import config

BOX = ((-20.0, -20.0), (40.0, -20.0), (40.0, 40.0), (-20.0, 40.0))
TREE = Zone("tree", ((10.0, 12.0),), 2.5, 1.0)
HEDGE = Zone("hedge", ((20.0, 0.0), (22.0, 0.0), (22.0, 9.0)), 0.0, 1.0)
HUT = Zone("hut", ((30.0, 0.0),), 2.0, 1.0, None, 5.0)
PLAN = plan(fence=Fence(BOX, 30.0), zones=(TREE, HEDGE, HUT))
ITEMS, LEFT = items_of(PLAN)


class Bench:
    """A vehicle on a virtual clock, on a link that loses frames of ours."""

    def __init__(self, persona: str, every: int = 0) -> None:
        self.near, self.far = memory_wires()
        self.now, self._every, self._sent = 0.0, every, 0
        self.hub = Hub(
            config(1, persona=persona), 0.0, self._take, lambda _: VehicleSigning(None, lambda: 0)
        )

    def _take(self, _: int, data: bytes, __: Any) -> None:
        self.far.write(data)

    @property
    def has(self) -> int:
        return len(self.hub.world.vehicles[0].firmware.missions.lists[FENCE])

    def transfer(self, items: Sequence[FenceItem] | None) -> FenceReport:
        work = FenceTransfer(self.near, 1, items)
        while (report := work.step(self.now)) is None:
            self.now += 0.02
            while (data := self.far.read()) is not None:
                self._sent += 1
                if not self._every or self._sent % self._every:
                    self.hub.receive(0, data, ("127.0.0.1", 1))
            while self.hub.world.next_s <= self.now:
                self.hub.step()
        return report


def test_a_plan_as_items() -> None:
    """Zones with heights are left out: an item has none."""
    assert LEFT == ["hut"]
    assert [item.command for item in ITEMS] == [*[INSIDE] * 4, CIRCLE_OUTSIDE, *[OUTSIDE] * 3]
    assert [item.size for item in ITEMS] == [4, 4, 4, 4, 2.5, 3, 3, 3]
    north = (ITEMS[4].lat_e7 * 1e-7 - PLAN.origin.lat_deg) * 111_200
    assert math.isclose(north, 10.0, abs_tol=0.1)


@pytest.mark.parametrize("persona", ["ardupilot", "px4"])
@pytest.mark.parametrize("every", [0, 5])
def test_a_fence_is_sent_read_and_taken_off(persona: str, every: int) -> None:
    """Also where every fifth frame of ours is lost."""
    bench = Bench(persona, every)
    report = bench.transfer(ITEMS)
    assert report.trouble == ""
    assert bench.has == len(ITEMS)
    shown = bench.transfer(None)
    assert shown.words == "a fence of 4 corners, 1 polygons and 1 circles to keep out of"
    assert [item.lat_e7 for item in shown.items] == [item.lat_e7 for item in ITEMS]
    assert bench.transfer(()).words == "no fence"
    assert bench.has == 0


def test_what_does_not_go_is_said() -> None:
    bench = Bench("ardupilot")
    bench.hub.world.vehicles[0].firmware.set_armed()
    assert bench.transfer(ITEMS).trouble == "vehicle 1 is armed; allowed: a disarmed one"
    unknown = [replace_command(item, 5100) for item in ITEMS]
    assert "refuses the fence" in Bench("ardupilot").transfer(unknown).trouble
    silent = FenceTransfer(memory_wires()[0], 1, None)
    assert silent.step(0.0) is None
    report = silent.step(20.0)
    assert report is not None
    assert report.trouble == "vehicle 1 was not heard in 15 s"


def replace_command(item: FenceItem, command: int) -> FenceItem:
    return item._replace(command=command)
