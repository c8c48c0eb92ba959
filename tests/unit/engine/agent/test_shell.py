"""What an agent tells of itself never keeps back what the others fly by."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarm_ctl.core.agent.agent import Actions
from swarm_ctl.core.model.messages import Ack, Event, Payload, Severity
from swarm_ctl.core.model.vehicle import StandbyGoal
from swarm_ctl.engine.agent.shell import OwnTime, publish
from swarm_ctl.mesh import keys
from swarm_ctl.rim import Rim
from tests.unit.station.swarm import hexagon_plan, state_of, status_of

PLAN = hexagon_plan()


class Mesh:
    """Keeps what was sent; refuses the channels named."""

    def __init__(self, *broken: keys.Channel[Any]) -> None:
        self.sent: list[Payload] = []
        self._broken = {channel.name for channel in broken}

    def send(self, channel: keys.Channel[Any], payload: Payload) -> None:
        """Send, or fail."""
        if channel.name in self._broken:
            raise ValueError("can't be packed")
        self.sent.append(payload)


ACTIONS = Actions(
    StandbyGoal(),
    state_of(PLAN, 1, 5.0),
    status=status_of(PLAN, 1, 5.0),
    events=(Event(1, 5.0, Severity.INFO, "hello"),),
    acks=(Ack(1, "c", True, ""),),
)


@pytest.mark.parametrize("broken", [(keys.EVENT,), (keys.STATUS,), (keys.EVENT, keys.STATUS)])
def test_an_event_that_cannot_be_sent_keeps_no_state_back(broken: Any) -> None:
    """All else goes out at this tick and the next; the error is told once."""
    mesh, shown = Mesh(*broken), Rim("what this agent tells of itself")
    for _ in range(2):
        publish(mesh, ACTIONS, shown)  # type: ignore[arg-type]
    assert mesh.sent.count(ACTIONS.state) == 2  # type: ignore[arg-type]
    assert mesh.sent.count(ACTIONS.acks[0]) == 2
    assert len(mesh.sent) == 2 * (4 - len(broken))
    (trouble,) = shown.troubles()
    assert "ValueError: can't be packed" in str(trouble)


def test_a_state_that_cannot_be_sent_is_no_trouble_of_what_shows() -> None:
    """It ends the agent, and its vehicle's own failsafe acts."""
    with pytest.raises(ValueError, match="packed"):
        publish(Mesh(keys.STATE), ACTIONS, Rim("it"))  # type: ignore[arg-type]


@given(
    st.lists(st.tuples(st.floats(0.01, 2.0), st.just(0.0) | st.floats(-4000.0, 4000.0)), min_size=1)
)
def test_an_agents_time_never_goes_back(ticks: list[tuple[float, float]]) -> None:
    """However its clock is set, each tick is later than the one before, and goes on by the swarm's
    pace where the clock was set back; what came before the tick was heard before it."""
    swarm_s = ahead_s = 0.0
    own = OwnTime(lambda at_s: at_s + ahead_s)
    last_s = own.tick(swarm_s)
    for pace_s, jump_s in ticks:
        swarm_s, ahead_s = swarm_s + pace_s, ahead_s + jump_s
        now = own.tick(swarm_s)
        assert now > last_s
        if pace_s + jump_s < 0.0:
            assert now - last_s == pytest.approx(pace_s)
        assert own(swarm_s - 0.01) <= own(swarm_s) == pytest.approx(now)
        last_s = now
