"""Four on a square that change to the opposite corner, through each other's midst."""

from __future__ import annotations

import functools
from collections.abc import Callable

from swarm_ctl.mission.compile.loader import LoadedMission, loads

IDS = (1, 2, 3, 4)
FORM = 2
TEXT = """\
version: 1
name: swap
origin: {{lat_deg: -35.36, lon_deg: 149.16, alt_m: 584}}
unit_m: 1
law: {{r: 30, r_out: 7, r_in: 2.5, kappa: {rate_hz}}}
tick_s: {tick_s}
agents:
  - {{id: 1, start: [0, 0]}}
  - {{id: 2, start: [0, 14]}}
  - {{id: 3, start: [14, 0]}}
  - {{id: 4, start: [14, 14]}}
shapes:
  swapped: {{kind: offsets, offsets: [[14, 14], [14, 0], [0, 14], [0, 0]]}}
policies: {{agent_lost: {policy}}}
steps:
  - takeoff: {{height_m: 5}}
  - form: {{shape: swapped, slots: fixed, settle_s: 2, timeout_s: 60}}
  - hold: {{duration_s: 1}}
  - move: {{to: [12, 9], speed_mps: 2}}
  - land
"""


def text(policy: str = "land", rate_hz: int = 20) -> str:
    """The mission's file; `rate_hz`: of ticks, and of the law."""
    return TEXT.format(policy=policy, rate_hz=rate_hz, tick_s=1.0 / rate_hz)


@functools.cache
def mission(policy: str = "land", rate_hz: int = 20) -> LoadedMission:
    """They fly a bit after that."""
    return loads(text(policy, rate_hz))


def ahead(offset_s: float, drift: float = 0.0) -> Callable[[float], float]:
    """A clock that is so far ahead, and gains so much a second."""
    return lambda now: now * (1.0 + drift) + offset_s
