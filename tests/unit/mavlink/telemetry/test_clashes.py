"""Two that speak with one system id: found before arming, said in the air, and not where one sender
is lossy, echoed or garbled."""

from __future__ import annotations

from random import Random

import pytest

from swarm_ctl.core.model.vehicle import StandbyGoal
from swarm_ctl.mavlink import outgoing
from swarm_ctl.mavlink.autopilots.timing import LISTEN_S
from swarm_ctl.mavlink.link import VehicleLink
from swarm_ctl.mavlink.wires import memory_wires
from tests.unit.mavlink import wire

OTHER = "another sender speaks with our system id 250"
TWO = "two vehicles speak with system id 7"
TICK_S = 0.05


READY = (
    wire.heartbeat(),
    wire.local_position(),
    wire.global_position(),
    wire.global_origin(),
    wire.system_status(),
    wire.extended_state(1),
    wire.ekf_report(),
    wire.gps_raw(),
    wire.parameter("GUID_TIMEOUT", 0.5),
    wire.parameter("FS_GCS_ENABLE", 5.0, kind=2),
    wire.parameter("FS_GCS_TIMEOUT", 5.0),
    wire.parameter("MAV_GCS_SYSID", 250.0, kind=4),
    wire.parameter("MAV_GCS_SYSID_HI", 0.0, kind=4),
    wire.parameter("SYSID_MYGCS", 250.0, kind=4),
)
"""All that an agent waits for, in the vehicle's first frames."""


class Shared:
    """A link with one vehicle, and others that a test adds."""

    def __init__(self) -> None:
        ours, self.end = memory_wires()
        self.link = VehicleLink(ours, "ardupilot", 7)
        self.vehicle = wire.Vehicle(self.end, 7)
        self.now = 0.0
        self.texts: list[str] = []

    def tick(self, *senders: wire.Vehicle) -> str:
        """What is missing after a tick in which all have sent."""
        self.now += TICK_S
        second = round(self.now / TICK_S) % 20 == 0
        for k, sender in enumerate((self.vehicle, *senders)):
            boot_ms = round(self.now * 1000) + 3 * k
            sender.say(wire.local_position((0.0, 0.0, 0.0), boot_ms=boot_ms), wire.system_status())
            if second:
                sender.say(wire.heartbeat())
        return self.look()

    def look(self) -> str:
        self.link.receive(self.now)
        view = self.link.view()
        self.link.pursue(StandbyGoal(), self.now)
        self.texts += view.texts
        return view.health_reason

    def run(self, seconds: float, *senders: wire.Vehicle) -> str:
        reason = ""
        for _ in range(round(seconds / TICK_S)):
            reason = self.tick(*senders)
        return reason


@pytest.mark.parametrize("component", [191, 190])
def test_another_sender_of_our_id_is_named(component: int) -> None:
    """Another agent's, too, which has our component."""
    shared = Shared()
    other = wire.Vehicle(shared.end, 250, component)
    other.codec.seq = 77
    for _ in range(3):
        other.say(outgoing.heartbeat())
        reason = shared.run(1.0)
    assert reason.startswith(OTHER)
    assert "agent_sysid in the fleet" in reason
    assert len([text for text in shared.texts if text.startswith(OTHER)]) == 1
    assert not shared.run(12.0).startswith(OTHER), "it is gone"


@pytest.mark.parametrize("late_s", [0.0, 0.05, 0.3, 0.6, 0.95])
def test_a_vehicle_that_is_ready_at_once_waits_until_another_sender_would_be_named(
    late_s: float,
) -> None:
    """Whenever in the first second the other one's first heartbeat comes."""
    shared, alone = Shared(), Shared()
    other = wire.Vehicle(shared.end, 250, 190)
    for each in (shared, alone):
        each.vehicle.say(*READY)
    told, quiet = [], []
    for k in range(round(4.0 / TICK_S)):
        if k % 20 == round(late_s / TICK_S):
            other.say(outgoing.heartbeat())
        told.append(shared.tick())
        quiet.append(alone.tick())
    assert "" not in told
    assert told[-1].startswith(OTHER)
    assert quiet[0] == "listening for others with its system id or ours"
    assert quiet.index("") * TICK_S == pytest.approx(LISTEN_S, abs=2 * TICK_S)


def test_two_vehicles_that_are_ready_at_once_are_never_ready_to_arm() -> None:
    shared = Shared()
    twin = wire.Vehicle(shared.end, 7)
    twin.codec.seq = 100
    shared.vehicle.say(*READY)
    told = [shared.tick(twin) for _ in range(round(4.0 / TICK_S))]
    assert "" not in told
    assert told[-1].startswith(TWO)


def test_a_vehicle_that_flies_is_not_kept_waiting() -> None:
    """An agent that starts anew takes its vehicle over within seconds, or not at all."""
    shared = Shared()
    flying = (wire.heartbeat(custom_mode=4, armed=True), wire.extended_state(2))
    shared.vehicle.say(*READY[1:], *flying)
    assert shared.look() == ""


def test_an_echo_of_our_heartbeats_is_no_clash() -> None:
    shared = Shared()
    for _ in range(10):
        while (data := shared.end.read()) is not None:
            if data[7] == 0:
                shared.end.write(data)
        assert "system id 250" not in shared.run(1.0)


def test_a_vehicle_with_our_id_is_named() -> None:
    shared = Shared()
    reason = shared.run(3.0, wire.Vehicle(shared.end, 250))
    assert reason.startswith("a vehicle speaks with our system id 250")


@pytest.mark.parametrize("apart", [0, 1, 5, 15, 17, 60, 128, 200, 250])
def test_two_vehicles_of_one_id_are_told_by_their_counters(apart: int) -> None:
    """Soon: an agent may be ready to arm after some seconds."""
    shared = Shared()
    twin = wire.Vehicle(shared.end, 7)
    twin.codec.seq = apart
    assert shared.run(2.5, twin).startswith(TWO)


def test_two_kinds_of_vehicle_of_one_id_are_named() -> None:
    shared = Shared()
    other = wire.Vehicle(shared.end, 7)
    for _ in range(4):
        shared.run(1.0)
        other.codec.seq = shared.vehicle.codec.seq
        other.say(wire.heartbeat(autopilot=12))
    assert shared.tick().startswith(TWO)


@pytest.mark.parametrize("loss", [0.0, 0.3, 0.7])
def test_one_vehicle_is_one_whatever_its_link_does(loss: float) -> None:
    """Lost, late, repeated frames, and silences."""
    shared, draw = Shared(), Random(3)
    late: list[bytes] = []
    for k in range(1200):
        shared.now += TICK_S
        frames = [
            shared.vehicle.bytes_of(message)
            for message in (wire.local_position(), wire.system_status(), wire.heartbeat())
        ]
        silent = k % 100 > 90
        for frame in (*late, *frames):
            if not silent and draw.random() >= loss:
                shared.end.write(frame)
        late = [frame for frame in frames if draw.random() < 0.1]
        assert "system id" not in shared.look()


def test_one_garbled_frame_is_no_clash() -> None:
    shared = Shared()
    wire.Vehicle(shared.end, 250, 190).say(outgoing.heartbeat())
    wire.Vehicle(shared.end, 250).say(wire.local_position())
    assert "system id" not in shared.run(5.0)
