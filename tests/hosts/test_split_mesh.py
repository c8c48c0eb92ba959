"""One swarm on two hosts: a mesh that is slow, lossy, cut and healed, with TCP's own answers to it.

Agents and a station of each side in a network namespace of their own, joined by a relay that
carries each frame late or never; every vehicle's own link stays whole. Ranks change sides through
each other's gaps while it happens.
"""

from __future__ import annotations

from pathlib import Path

import pytest

from swarm_ctl.runfolder.truth import load_truth
from tests.hosts.namespaces import why_not
from tests.hosts.relay import Air
from tests.hosts.split import Split

pytestmark = [
    pytest.mark.timeout(240),
    pytest.mark.skipif(bool(why_not()), reason=why_not() or "-"),
]

MISSION = """
version: 1
name: split
origin: {{lat_deg: 47.4, lon_deg: 8.5, alt_m: 400}}
lengths: metres
tick_s: 0.1
law: {{r: 40, r_out: 7, r_in: 2.5}}
agents:
  - {{id: 1, start: [0, 0]}}
  - {{id: 2, start: [0, 16]}}
  - {{id: 3, start: [26, 8]}}
  - {{id: 4, start: [26, 24]}}
policies: {{agent_lost: {lost}, agent_lost_after_s: {after_s}, station_lost: {lost}}}
shapes:
  swapped: {{kind: offsets, offsets: [[26, 0], [26, 16], [0, 8], [0, 24]]}}
steps:
  - takeoff: {{height_m: 2}}
  - form: {{shape: swapped, slots: fixed, timeout_s: 240}}
  - hold: {{duration_s: 3}}
  - land
"""
FORM = 2
SIDES = ((1, 2), (3, 4))


def split(where: Path, speedup: float, lost: str = "land", after_s: float = 5) -> Split:
    return Split(MISSION.format(lost=lost, after_s=after_s), SIDES, where, speedup)


def assert_apart_and_down(flight: Split) -> None:
    """No two vehicles were under r_in in the truth, and all stand at its end."""
    truth = load_truth(flight.truth_path)
    assert truth.complete
    assert min(truth.minima.values()) > flight.r_in_m
    assert not truth.airborne[-1].any()


def test_a_mesh_that_is_cut_in_flight(tmp_path: Path) -> None:
    """Each side finds the other lost, holds, lands where it stands, and says so; no two
    vehicles come near each other."""
    with split(tmp_path, speedup=3) as flight:
        flight.wait_step(FORM)
        flight.wait_s(3)
        flight.air(Air(cut=True))
        assert flight.finish() == dict.fromkeys((1, 2, 3, 4), 1)
        for side, others in enumerate(reversed(SIDES)):
            for agent in SIDES[side]:
                reasons = [
                    f"agent: failed: agent {other} has not been heard for 5 s\n" for other in others
                ]
                assert flight.said(agent).endswith(tuple(reasons))
        assert_apart_and_down(flight)


@pytest.mark.long
def test_a_slow_and_lossy_mesh(tmp_path: Path) -> None:
    """150 +- 50 ms each way, one frame of ten lost, in real time: the mission is flown to its
    end."""
    with split(tmp_path, speedup=1) as flight:
        flight.air(Air(delay_s=0.15, jitter_s=0.05, loss=0.1))
        assert flight.finish(180) == dict.fromkeys((1, 2, 3, 4), 0)
        assert flight.network.air(Air()).dropped > 100
        assert_apart_and_down(flight)


@pytest.mark.long
def test_a_narrow_mesh(tmp_path: Path) -> None:
    """1 Mbit/s each way, a little more than two agents on each side have to say to the others and
    to two stations."""
    with split(tmp_path, speedup=1) as flight:
        flight.air(Air(rate_bps=1e6))
        assert flight.finish(180) == dict.fromkeys((1, 2, 3, 4), 0)
        assert_apart_and_down(flight)


@pytest.mark.long
@pytest.mark.parametrize(
    ("lost", "after_s", "cut_s", "code"),
    [("land", 12, 4, 0), ("hold", 5, 12, 0), ("continue", 5, 12, 0), ("land", 5, 12, 1)],
    ids=["shorter than patience", "hold", "continue", "land"],
)
def test_a_mesh_that_is_cut_and_healed(
    tmp_path: Path, lost: str, after_s: float, cut_s: float, code: int
) -> None:
    """They find each other again; the mission goes on, or has ended, as the policy says."""
    with split(tmp_path, 1, lost, after_s) as flight:
        flight.wait_step(FORM)
        flight.wait_s(3)
        flight.air(Air(cut=True))
        flight.wait_s(cut_s)
        flight.air(Air())
        if not code:  # who has landed is gone before TCP comes back
            flight.wait_for(
                lambda: all(
                    agent["age_s"] < 1.0
                    for side in (0, 1)
                    for agent in flight.agents(side).values()
                )
            )
        assert flight.finish(180) == dict.fromkeys((1, 2, 3, 4), code)
        assert_apart_and_down(flight)
