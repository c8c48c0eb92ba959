"""The system ids that agents speak with."""

from __future__ import annotations

from swarm_ctl.core.model.fleet import GROUND_STATION_SYSIDS, agent_sysids


def test_they_count_down_from_250_without_those_taken() -> None:
    assert agent_sysids(6, {249, 246}) == [250, 248, 247, 244, 243, 242]  # 245: MAVSDK


def test_no_agent_speaks_as_a_vehicle_or_a_ground_station() -> None:
    for vehicles in (6, 120, 249, 250):
        ids = agent_sysids(vehicles, range(1, vehicles + 1))
        assert not set(ids) & (set(range(1, vehicles + 1)) | GROUND_STATION_SYSIDS)
        assert set(ids) <= set(range(1, 255))


def test_all_are_different_while_there_are_enough() -> None:
    assert len(set(agent_sysids(125, range(1, 126)))) == 125
    assert len(set(agent_sysids(150, range(1, 151)))) == 103, "the rest repeat"
