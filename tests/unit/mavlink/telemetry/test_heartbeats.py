"""Which heartbeats of a vehicle are believed: rows of what they say, when, and what comes of it."""

from __future__ import annotations

from dataclasses import dataclass

import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarm_ctl.mavlink.telemetry import incoming
from swarm_ctl.mavlink.telemetry.heartbeats import FlightState
from swarm_ctl.mavlink.telemetry.vehicle_telemetry import Telemetry
from tests.unit.mavlink import wire

GUIDED, LOITER, LAND = 4, 5, 9
BEGUN_S = 10.0


def flying(on_ground: bool = False) -> Telemetry:
    """Armed, in GUIDED, in the air."""
    heard = Telemetry()
    say(heard, "G", BEGUN_S)
    incoming.fold(heard, wire.extended_state(1 if on_ground else 2), BEGUN_S)
    return heard


HEARTBEATS = {
    "G": wire.heartbeat(custom_mode=GUIDED, armed=True),
    "L": wire.heartbeat(custom_mode=LOITER, armed=True),
    "D": wire.heartbeat(custom_mode=LAND, armed=True),
    "g": wire.heartbeat(custom_mode=GUIDED, armed=False),
    "l": wire.heartbeat(custom_mode=LOITER, armed=False),
}


def say(heard: Telemetry, what: str, now: float, *, down_mps: float | None = 0.0) -> None:
    """A heartbeat; before it a local position, if `down_mps` is given."""
    if down_mps is not None:
        position = wire.local_position(velocity=(0.0, 0.0, down_mps), boot_ms=round(1000 * now))
        incoming.fold(heard, position, now)
    incoming.fold(heard, HEARTBEATS[what], now)


@dataclass(frozen=True)
class Row:
    """Heartbeats after one of armed GUIDED, `every_s` apart, and what is believed at the end."""

    what: str
    said: str
    every_s: float
    believed: str
    expects: str = ""
    """What the goal asks for."""
    down_mps: float | None = 0.0
    on_ground: bool = False
    refuted: int = 0

    def __str__(self) -> str:
        return self.what


ROWS = (
    Row("one", "L", 1.0, "G"),
    Row("one, then the vehicle's own", "LG", 0.5, "G", refuted=1),
    Row("two", "LL", 1.0, "G"),
    Row("three, a second apart", "LLL", 1.0, "L"),
    Row("three of two other modes", "LDL", 1.0, "L"),
    Row("three within a moment", "LLL", 0.1, "G"),
    Row("asked for, five a second: six", "LLLLLL", 0.2, "G"),
    Row("asked for, five a second: seven", "LLLLLLL", 0.2, "L"),
    Row("many, with the vehicle's own in between", "LLLGLLLGLLLG", 0.3, "G", refuted=3),
    Row("of a vehicle that says nothing else: three", "LLL", 1.0, "G", down_mps=None),
    Row("of a vehicle that says nothing else: four", "LLLL", 1.0, "L", down_mps=None),
    Row("expected: one", "D", 1.0, "G", expects="D"),
    Row("expected: two in a moment", "DD", 0.1, "G", expects="D"),
    Row("expected: two", "DD", 0.2, "D", expects="D"),
    Row("another than expected", "LL", 0.2, "G", expects="D"),
    Row("disarmed: one", "g", 1.0, "G"),
    Row("disarmed: two", "gg", 1.0, "G"),
    Row("disarmed: three", "ggg", 1.0, "g"),
    Row("disarmed and falling", "g", 1.0, "g", down_mps=4.5),
    Row("disarmed and descending", "g", 1.0, "G", down_mps=3.5),
    Row("a mode while falling", "L", 1.0, "G", down_mps=9.0),
    Row("disarmed on the ground: one", "g", 1.0, "G", on_ground=True),
    Row("disarmed on the ground: two", "gg", 0.2, "g", on_ground=True),
    Row("armed again", "gggG", 1.0, "G"),
)


@pytest.mark.parametrize("row", ROWS, ids=str)
def test_heartbeats(row: Row) -> None:
    heard = flying(row.on_ground)
    if row.expects:
        wanted = state(row.expects)
        heard.evidence.expects = lambda told: told == wanted
    for k, what in enumerate(row.said):
        say(heard, what, BEGUN_S + (k + 1) * row.every_s, down_mps=row.down_mps)
    assert FlightState(heard.armed, heard.custom_mode) == state(row.believed)
    assert heard.evidence.refuted == row.refuted


def state(what: str) -> FlightState:
    heard = Telemetry()
    incoming.fold(heard, HEARTBEATS[what], 0.0)
    return FlightState(heard.armed, heard.custom_mode)


@given(
    st.lists(st.tuples(st.sampled_from("LDgl"), st.floats(0.0, 60.0)), max_size=200),
    st.floats(0.0, 1.0),
)
def test_no_forged_heartbeats_are_believed_while_the_vehicle_sends_its_own(
    forged: list[tuple[str, float]], first_s: float
) -> None:
    """However many there are, whenever they come: the vehicle says GUIDED once a second."""
    own = [("G", first_s + second) for second in range(60)]
    heard = flying()
    for what, at_s in sorted([*forged, *own], key=lambda said: said[1]):
        say(heard, what, BEGUN_S + at_s)
        assert heard.armed
        assert heard.custom_mode == GUIDED
