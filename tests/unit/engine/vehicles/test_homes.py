"""Where ArduCopters stand that others start."""

from pathlib import Path

import pytest

from swarm_ctl.engine.vehicles.homes import DEFAULTS, start_of, write_homes
from swarm_ctl.mission.compile.loader import load

HEXAGON = Path(__file__).parents[4] / "missions" / "hexagon.yaml"


def test_each_stands_where_its_agent_starts(tmp_path: Path) -> None:
    """A file for each agent has its start to a centimetre, as ArduCopter's `--home` reads it; the
    parameters are those of `run --vehicles arducopter`."""
    plan = load(HEXAGON).plan
    write_homes(plan, tmp_path)
    for agent in plan.agents:
        lat, lon, alt, heading = map(float, (tmp_path / f"home-{agent.id}").read_text().split(","))
        start = start_of(plan, agent.id)
        assert (lat, lon) == pytest.approx((start.lat_deg, start.lon_deg), abs=1e-7)
        assert (alt, heading) == (plan.origin.alt_m, 0.0)
    assert (tmp_path / DEFAULTS.name).read_bytes() == DEFAULTS.read_bytes()
