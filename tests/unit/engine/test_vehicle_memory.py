"""What the vehicles' own parameters are remembered by: whatever ends an agent, and whenever, the
next orderly flight gives the vehicle its own values back."""

from __future__ import annotations

import tempfile
from collections import deque
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from random import Random
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from swarm_ctl.core.model.messages import AgentStatus
from swarm_ctl.core.model.vehicle import (
    Goal,
    OwnParameters,
    OwnValue,
    ReleaseGoal,
    StandbyGoal,
    VehicleIdentity,
)
from swarm_ctl.engine.vehicle_memory import (
    Remembering,
    SwarmMemory,
    VehicleMemory,
    left_changed,
    state_folder,
)
from swarm_ctl.mavlink.autopilots import AUTOPILOTS, Autopilot
from swarm_ctl.mavlink.autopilots.failsafe_parameters import ParameterRule
from swarm_ctl.mavlink.link import VehicleLink
from swarm_ctl.mavlink.wires import memory_wires
from tests.unit.mavlink import wire
from tests.unit.station.swarm import hexagon_plan, status_of

TICK_S, STATUS_TICKS = 0.05, 10
OWN, OTHER = 3.0, 7.0
ENDPOINT = "udpin:127.0.0.1:14540"


class World:
    """A vehicle that has parameters and no more, behind a lossy link with a delay, and the agents
    that come and go."""

    def __init__(self, folder: Path, *, uid: int = 77, loss: float = 0.0, delay: int = 0) -> None:
        self.memory = VehicleMemory(folder)
        self.uid, self.loss, self.delay = uid, loss, delay
        self.random = Random(1)
        self.now, self.ticks = 0.0, 0
        self.values = {"GUID_TIMEOUT": OWN, "FS_GCS_ENABLE": 0.0}
        self.up: deque[tuple[int, Any]] = deque()
        self.notes: list[str] = []
        self.before_set: list[bool] = []
        """For each PARAM_SET of our value: whether the memory had the vehicle's own."""

    def start(self) -> None:
        """A new agent."""
        near, far = memory_wires()
        self.link = VehicleLink(near, "ardupilot", 7, remembers=True)
        self.vehicle = wire.Vehicle(far, 7)
        self.down: deque[tuple[int, Any]] = deque()
        self.remembering = Remembering(self.memory, ENDPOINT, "test")

    def run(self, goal: Goal, ticks: int) -> None:
        for _ in range(ticks):
            self.ticks, self.now = self.ticks + 1, self.now + TICK_S
            self.answer()
            self.link.receive(self.now)
            view = self.link.view()
            self.notes += [note.text for note in view.notes]
            self.link.pursue(goal, self.now)
            if self.ticks % STATUS_TICKS == 0:
                self.remembering.serve(self.link, view.own)
            for message in self.vehicle.heard():
                if self.random.random() >= self.loss:
                    self.up.append((self.ticks + self.delay, message))

    def answer(self) -> None:
        """The vehicle hears what has arrived and answers; a heartbeat each second."""
        while self.up and self.up[0][0] <= self.ticks:
            self.hear(self.up.popleft()[1])
        if self.ticks % 20 == 1:
            self.say(wire.heartbeat())
        while self.down and self.down[0][0] <= self.ticks:
            self.vehicle.say(self.down.popleft()[1])

    def say(self, message: Any) -> None:
        if self.random.random() >= self.loss:
            self.down.append((self.ticks + self.delay, message))

    def hear(self, message: Any) -> None:
        name = message.get_type()
        if name == "PARAM_SET":
            remembered = [entry.values.get(message.param_id) for entry in self.memory.entries()]
            if message.param_value in (0.5, 0.25, 5.0):
                self.before_set.append(any(remembered))
            self.values[message.param_id] = message.param_value
        if name in ("PARAM_SET", "PARAM_REQUEST_READ") and message.param_id in self.values:
            self.say(wire.parameter(message.param_id, self.values[message.param_id]))
        elif name == "COMMAND_LONG" and message.param1 == 148 and self.uid >= 0:
            self.say(wire.version(self.uid))

    def settle(self) -> None:
        """All that is on its way to the vehicle arrives, or is gone."""
        while self.up:
            self.hear(self.up.popleft()[1])

    def orderly(self) -> None:
        """A flight from its beginning to its end."""
        self.start()
        self.run(StandbyGoal(), 400)
        self.run(ReleaseGoal(), 400)


def rules_of(ours: dict[str, float]) -> Callable[[Autopilot], tuple[ParameterRule, ...]]:
    """What a driver's agents set: these."""
    return lambda _: tuple(ParameterRule(name, value) for name, value in ours.items())


@pytest.fixture
def wanted(monkeypatch: pytest.MonkeyPatch) -> dict[str, float]:
    """The two parameters that this test's agents set."""
    ours = {"GUID_TIMEOUT": 0.5, "FS_GCS_ENABLE": 5.0}
    monkeypatch.setattr(AUTOPILOTS["ardupilot"], "failsafes", rules_of(ours))
    return ours


@pytest.fixture
def world(tmp_path: Path, wanted: dict[str, float]) -> World:
    return World(tmp_path)


def test_a_folder_that_cannot_be_written_keeps_the_vehicle_on_the_ground(
    tmp_path: Path, wanted: dict[str, float]
) -> None:
    """The reason names the file; nothing was set."""
    (tmp_path / "file").write_text("")
    world = World(tmp_path / "file" / "below")
    own = dict(world.values)
    world.start()
    world.run(StandbyGoal(), 200)
    assert world.values == own
    assert "its own can't be remembered" in world.link._autopilot.parameters.obstacle
    assert str(tmp_path / "file") in world.link._autopilot.parameters.obstacle


def test_a_damaged_file_is_named_and_not_taken_for_an_empty_one(world: World) -> None:
    world.start()
    world.run(StandbyGoal(), 100)
    (file,) = world.memory.folder.glob("*.json")
    file.write_text("{")
    world.start()
    world.run(StandbyGoal(), 100)
    obstacle = world.link._autopilot.parameters.obstacle
    assert str(file) in obstacle
    assert "no memory of a vehicle" in obstacle


def test_what_was_changed_meanwhile_counts(world: World) -> None:
    world.start()
    world.run(StandbyGoal(), 100)
    world.values["GUID_TIMEOUT"] = OTHER
    world.orderly()
    assert world.values == {"GUID_TIMEOUT": OTHER, "FS_GCS_ENABLE": 0.0}
    assert any("GUID_TIMEOUT 7 was changed since our flight" in note for note in world.notes)


def test_our_value_without_a_memory_is_noted_and_kept(world: World) -> None:
    world.values["FS_GCS_ENABLE"] = 5.0
    world.orderly()
    assert world.values["FS_GCS_ENABLE"] == 5.0
    assert any("FS_GCS_ENABLE 5 is what agents set" in note for note in world.notes)


def test_a_parameter_that_agents_no_longer_set_is_put_back(
    world: World, wanted: dict[str, float]
) -> None:
    world.start()
    world.run(StandbyGoal(), 100)
    del wanted["GUID_TIMEOUT"]
    world.orderly()
    assert world.values == {"GUID_TIMEOUT": OWN, "FS_GCS_ENABLE": 0.0}
    assert world.memory.entries() == []


lives = st.lists(
    st.tuples(
        st.integers(0, 60),  # ticks in which the agent takes its parameters
        st.integers(0, 60),  # ticks in which it gives them back, until it is killed
        st.sampled_from([0.5, 0.25]),  # what agents of its version want
        st.sampled_from([None, None, OWN, OTHER, 9.0]),  # what is then set by hand
    ),
    max_size=6,
)


@given(lives, st.sampled_from([0.0, 0.2, 0.5]), st.integers(0, 12), st.sampled_from([-1, 77]))
@settings(max_examples=30)
def test_after_any_crashes_and_one_orderly_flight_the_vehicle_has_its_own_values(
    lived: list[tuple[int, int, float, float | None]], loss: float, delay: int, uid: int
) -> None:
    """Agents killed at random moments of the exchange, over a link that loses and delays; between
    them a value may be changed by hand, which then is the vehicle's own."""
    ours = {"GUID_TIMEOUT": 0.5, "FS_GCS_ENABLE": 5.0}
    with tempfile.TemporaryDirectory() as folder, pytest.MonkeyPatch.context() as patch:
        patch.setattr(AUTOPILOTS["ardupilot"], "failsafes", rules_of(ours))
        world = World(Path(folder), uid=uid, loss=loss, delay=delay)
        own = dict(world.values)
        for taking, giving, want, by_hand in lived:
            ours["GUID_TIMEOUT"] = want
            world.start()
            world.run(StandbyGoal(), taking)
            world.run(ReleaseGoal(), giving)
            world.settle()
            if by_hand is not None:
                own["GUID_TIMEOUT"] = world.values["GUID_TIMEOUT"] = by_hand
        world.start()
        world.run(StandbyGoal(), 100)
        for _ in range(20):  # half of all messages are lost, both ways
            world.run(ReleaseGoal(), 100)
            if not world.memory.entries():
                break
        assert world.memory.entries() == []
        assert world.values == own
        assert all(world.before_set)


def test_the_newest_entry_of_a_vehicle_is_the_only_one(tmp_path: Path) -> None:
    """By endpoint at first, then by uid; another vehicle's stays."""
    memory = VehicleMemory(tmp_path)
    for uid, sysid in (("", 1), ("aa", 1), ("aa", 2)):
        vehicle = VehicleIdentity("px4", sysid, uid)
        memory.write(OwnParameters(vehicle, {"COM_OBL_RC_ACT": OwnValue(0.0, (4.0,))}), "e", "run")
    assert [entry.vehicle.sysid for entry in memory.entries()] == [1, 2]
    memory.forget(VehicleIdentity("px4", 1, "aa"), "elsewhere")
    assert [entry.vehicle.sysid for entry in memory.entries()] == [2]
    assert len(list(tmp_path.iterdir())) == 1, "no part of a file is left"


def test_where_it_is(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("SWARM_CTL_STATE", raising=False)
    monkeypatch.setenv("XDG_STATE_HOME", "/state")
    assert state_folder() == Path("/state/swarm_ctl")
    monkeypatch.delenv("XDG_STATE_HOME")
    monkeypatch.setenv("HOME", "/home/pilot")
    assert state_folder() == Path("/home/pilot/.local/state/swarm_ctl")
    monkeypatch.setenv("SWARM_CTL_STATE", "/elsewhere")
    assert state_folder() == Path("/elsewhere")


def status_with(own: OwnParameters) -> AgentStatus:
    return status_of(hexagon_plan(), 1, 1.0, own=own)


def test_a_station_remembers_too_and_forgets_when_the_vehicle_has_confirmed(tmp_path: Path) -> None:
    """In the run's folder, and for this user; a store that can't be written is said once."""
    run, state = tmp_path / "run", VehicleMemory(tmp_path / "state")
    run.mkdir()
    vehicle = VehicleIdentity("ardupilot", 1, "aa")
    taken = OwnParameters(vehicle, {"GUID_TIMEOUT": OwnValue(3.0, (0.5,))})
    station = SwarmMemory(state, "run", {1: ENDPOINT}, run)
    assert station.hear(status_with(taken)) == ""
    assert left_changed(run) == {1: taken}
    assert [entry.values for entry in state.entries()] == [taken.values]
    assert station.hear(status_with(replace(taken, given_back=True))) == ""
    assert left_changed(run) == {}
    assert state.entries() == []
    (tmp_path / "file").write_text("")
    blocked = SwarmMemory(VehicleMemory(tmp_path / "file"), "run", {1: ENDPOINT})
    assert "can't be remembered" in blocked.hear(status_with(taken))
    assert blocked.hear(status_with(taken)) == ""
