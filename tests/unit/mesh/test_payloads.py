"""Payloads survive the wire; anything else is refused with PayloadError and nothing more."""

from __future__ import annotations

import json
import math
import re
from dataclasses import fields, replace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarm_ctl.core.model.messages import (
    Ack,
    AgentState,
    AgentStatus,
    Answers,
    ClockEcho,
    ClockNews,
    Command,
    Event,
    Gains,
    LawNews,
    LinkReport,
    Outcome,
    PairReport,
    Phase,
    Severity,
    SigmaReport,
    StationBeacon,
    StepOutcome,
    StepResult,
    TargetWord,
    Tuning,
)
from swarm_ctl.core.model.planned_formation import Frame
from swarm_ctl.core.model.steps.form import FormStep
from swarm_ctl.core.model.steps.move import MoveStep
from swarm_ctl.core.model.vehicle import OwnParameters, OwnValue, VehicleIdentity
from swarm_ctl.core.model.zones import Zone
from swarm_ctl.errors import PayloadError
from swarm_ctl.mesh.keys import CHANNELS
from swarm_ctl.mesh.payloads import VERSION, decode, encode, is_json
from tests.unit.docs.pages import PAGES

FLOAT = st.floats(-1e9, 1e9)
FLOAT32 = st.floats(-1e3, 1e3, width=32)

STATES = st.builds(
    AgentState,
    agent=st.integers(1, 65535),
    seq=st.integers(0, 2**32 - 1),
    time_s=FLOAT,
    plan_hash=st.integers(0, 2**64 - 1),
    phase=st.sampled_from(Phase),
    step=st.integers(0, 65535),
    done=st.booleans(),
    airborne=st.booleans(),
    position_ned_m=st.tuples(FLOAT, FLOAT, FLOAT),
    velocity_ned_mps=st.tuples(FLOAT32, FLOAT32, FLOAT32),
    stop_point_m=st.tuples(FLOAT, FLOAT),
    setpoint_mps=st.tuples(FLOAT32, FLOAT32),
    frame=st.none()
    | st.builds(
        Frame,
        point_m=st.tuples(FLOAT, FLOAT),
        angle_rad=FLOAT32,
        scale=FLOAT32,
        leg=st.integers(0, 255),
        rate=st.floats(0, 1, width=32),
        velocity_mps=st.tuples(FLOAT32, FLOAT32),
    ),
    stage=st.integers(0, 3),
    override=st.integers(0, 2**32 - 1),
    gains_tag=st.integers(0, 2**32 - 1),
    next_gains_tag=st.integers(0, 2**32 - 1),
)

OTHERS: list[Any] = [
    Event(3, 1.5, Severity.WARNING, "ünïcode"),
    Command("abc", "land", (1, 2), 2.0),
    Command(
        "f", "form", (), 2.0, FormStep("vee", ((0.0, 0.5), (2.0, 1.0)), 0.5, 5.0, 60.0), 2**64 - 1
    ),
    Command("m", "move", (), 2.0, MoveStep(((10.0, -5.5),), 2.5, 0.5, 2.0, 60.0), 7, 3),
    Command(
        "t",
        "tune",
        (1, 2),
        2.0,
        plan_hash=7,
        tuning=Tuning(Gains(0.1, 2.0, 0.04, 15.0), 4.0, ((2, -0.5),)),
    ),
    Command("t-apply", "apply", (1, 2), 2.5, commits=2**32 - 1),
    LawNews(1, 2**32 - 1, 12.5, Gains(0.1, 2.0, 0.04, 15.0)),
    TargetWord("boat", -35.36, 149.16, 0.3, altitude_m=584.0, agent=1),
    TargetWord("boat", -35.36, 149.16, 0.0, velocity_ned_mps=(1.0, 2.0, 0.0), station="boat.1"),
    LawNews(1, 7, 0.0, Gains(0.1, 2.0, 0.04, 15.0), (Zone("z", ((1.0, 2.0),), 3.0, 1.25),)),
    Ack(1, "abc", False, "no"),
    ClockNews(1, 2.5, Answers.REGULAR, ()),
    ClockNews(65535, -1e9, Answers.SOON, (ClockEcho(2, 1e6 + 0.1, 1e-6), ClockEcho(50, -3.0, 0.9))),
    StationBeacon("s", 1.0, 2**64 - 1),
    SigmaReport(
        1,
        2.0,
        (0.1, 0.2),
        (0.3, 0.4),
        (PairReport(2, True, "inactive", 1.2, 0.1, 0.0, 3.0, 4.0, None, 1e-5),),
    ),
    AgentStatus(
        agent=1,
        time_s=3.0,
        phase=Phase.FLY,
        step=2,
        done=False,
        reason="",
        outcome=Outcome.RUNNING,
        mode="GUIDED",
        armed=True,
        airborne=True,
        battery_percent=None,
        height_m=9.9,
        formation_error_m=None,
        nearest_agent=2,
        nearest_m=7.0,
        heartbeat_age_s=0.5,
        station_age_s=None,
        setpoints=100,
        setpoint_rate_hz=20.0,
        neighbours=(2, 3),
        sigma_tally={"paper": 3},
        overspeed_ticks=0,
        links={2: LinkReport(0.05, 0.05, 0.1, 100, 1)},
        steps=(StepResult("prepare", StepOutcome.DONE, 0.0, 3.0),),
        own=OwnParameters(
            VehicleIdentity("px4", 2, "ab01"), {"COM_OF_LOSS_T": OwnValue(1.5, (1.0, 0.5))}, True
        ),
    ),
]


@given(STATES)
def test_state_round_trip(state: AgentState) -> None:
    """The fixed layout keeps every field exactly (velocities are 32-bit)."""
    assert decode(AgentState, encode(state)) == state


@pytest.mark.parametrize("payload", OTHERS, ids=lambda p: type(p).__name__)
def test_round_trip(payload: Any) -> None:
    assert decode(type(payload), encode(payload)) == payload


def test_every_channel_has_a_payload_tested_here() -> None:
    assert {c.payload for c in CHANNELS} == {AgentState, *(type(p) for p in OTHERS)}


@given(st.sampled_from([c.payload for c in CHANNELS]), st.binary(max_size=300))
def test_random_bytes_are_refused(kind: type, data: bytes) -> None:
    """Whatever comes, the only answer is PayloadError (or, against all odds, a valid payload)."""
    try:
        decode(kind, bytes([VERSION]) + data)
    except PayloadError:
        return


@pytest.mark.parametrize("bad", [float("nan"), float("inf")])
def test_numbers_that_are_none_are_refused(bad: float) -> None:
    """NaN in any number of a state would poison the law of every agent that hears it."""
    good = AgentState(1, 1, 1.0, 1, Phase.FLY, 1, False, True, (1, 2, 3), (0, 0, 0), (1, 2), (0, 0))
    for field, value in (
        ("position_ned_m", (bad, 0, 0)),
        ("stop_point_m", (0, bad)),
        ("time_s", bad),
    ):
        broken = {name: getattr(good, name) for name in AgentState.__dataclass_fields__} | {
            field: value
        }
        with pytest.raises(PayloadError):
            decode(AgentState, encode(AgentState(**broken)))


@pytest.mark.parametrize("words", [("x" * 101, "hold"), ("a", "x" * 101)])
def test_a_commands_id_and_kind_are_short(words: tuple[str, str]) -> None:
    """Agents give them back, and keep them."""
    with pytest.raises(PayloadError, match="100 characters"):
        decode(Command, encode(Command(*words, (), 1.0)))


@pytest.mark.parametrize(
    "changes",
    [
        {"latitude_deg": 1e308},
        {"latitude_deg": math.nan},
        {"longitude_deg": 200.0},
        {"altitude_m": 1e9},
        {"velocity_ned_mps": (0.0, 1e9, 0.0)},
        {"age_s": -1.0},
        {"accuracy_m": math.nan},
    ],
)
def test_a_target_that_is_nowhere_is_refused(changes: dict[str, Any]) -> None:
    """Before anything is reckoned with it: a forged word ends no agent."""
    word = replace(TargetWord("boat", -35.36, 149.16, 0.3), **changes)
    with pytest.raises(PayloadError, match="TargetWord"):
        decode(TargetWord, encode(word))


@pytest.mark.parametrize("payload", [p for p in OTHERS if not isinstance(p, ClockNews)])
def test_json_is_json_to_any_tool(payload: Any) -> None:
    """With its version byte: a tool that trusts the encoding `application/json` reads it. All of
    it is there, but for the closings of a shape that is whole."""
    assert is_json(type(payload))
    told = json.loads(encode(payload))
    unsaid = {"closings"} if getattr(payload, "closings", None) == () else set[str]()
    assert {field.name for field in fields(payload)} - unsaid == set(told)


def test_the_document_has_every_channel() -> None:
    """The table for other tools names each key, and which of them are JSON."""
    page = PAGES["mesh"].read_text()
    rows = [row for row in page.splitlines() if row.startswith("| `swarm/")]
    for channel in CHANNELS:
        key = rf"/{channel.publisher}/.*\b{channel.name}\b"
        [row] = [row for row in rows if re.search(key, row)]
        assert ("application/json" in row) == is_json(channel.payload)
