"""False places: those that an agent tells of itself, and those that a forger tells an agent of its
vehicle. The liar is named, and what comes of both is told."""

from __future__ import annotations

from dataclasses import replace

from pymavlink.dialects.v20 import ardupilotmega as dialect

from swarm_ctl.core.model.messages import AgentState
from swarm_ctl.mission.compile.loader import load
from tests.scenarios.swarm import VirtualSwarm, at_step, landing_fast, low_hexagon
from tests.system.running import LOW

FORM = 2
LIAR = 3
DRIFT_MPS = 0.3
NAMED_S = 16.0


def drifting(swarm: VirtualSwarm, begun_s: float, state: AgentState) -> AgentState:
    """The state of an agent that tells its place ever farther north."""
    off_m = DRIFT_MPS * (swarm.now - begun_s)
    (north, east, down), (stop_n, stop_e) = state.position_ned_m, state.stop_point_m
    return replace(
        state, position_ned_m=(north + off_m, east, down), stop_point_m=(stop_n + off_m, stop_e)
    )


def test_who_drifts_slowly_is_named_by_all_others() -> None:
    """No state of it jumps by more than a vehicle flies."""
    swarm = at_step(low_hexagon(), FORM)
    begun_s = swarm.now
    swarm.members[LIAR].tampered = lambda state: drifting(swarm, begun_s, state)
    swarm.run(NAMED_S)
    words = f"agent {LIAR} is not believed: its places drift"
    assert {e.agent for e in swarm.events if words in e.text} == set(swarm.members) - {LIAR}
    for agent, member in swarm.members.items():
        assert member.status is not None
        assert set(member.status.doubted) == ({LIAR} - {agent})


class Forged(VirtualSwarm):
    """A swarm; a forger that speaks with the address of one vehicle."""

    begun_s = float("inf")

    def _run_world(self) -> None:
        super()._run_world()
        since_ms = round(1000 * (self.now - self.begun_s)) if self.now >= self.begun_s else None
        for k in range(10) if since_ms is not None else ():
            place = dialect.MAVLink_local_position_ned_message(
                60_000 + since_ms + k, 8.0, 8.0, -10.0, 0.0, 0.0, 0.0
            )
            self._far[LIAR - 1].write(place.pack(dialect.MAVLink(None, LIAR, 1)))


def test_forged_positions_land_all_with_a_reason_and_are_told_where_they_jump() -> None:
    """LOCAL_POSITION_NED, 8 m off, a hundred a second, between the vehicle's own."""
    swarm = landing_fast(Forged(load(LOW)))
    swarm.wait(lambda s: s.in_step(FORM))
    swarm.begun_s = swarm.now
    swarm.fly(swarm.now + 60.0)
    assert swarm.all_down
    assert swarm.closest_m > swarm.plan.law.r_in * swarm.plan.unit_m
    assert set(swarm.outcomes().values()) == {"failed"}
    said = {agent: [e.text for e in swarm.events if e.agent == agent] for agent in swarm.members}
    assert "land: no position from the vehicle for 5 s" in said[LIAR]
    assert said[LIAR].count("vehicle: the vehicle restarted") <= 2
    for agent in set(said) - {LIAR}:
        assert f"land: agent {LIAR} has not been heard for 5 s" in said[agent]
        assert any(
            text.startswith(f"agent {LIAR} is not believed: it jumped") for text in said[agent]
        )
