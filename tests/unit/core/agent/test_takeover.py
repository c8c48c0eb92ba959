"""A vehicle found in the air: the evidence that a takeover needs, each piece missing once, and what
comes of it."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import pytest

from swarm_ctl.core.agent.failsafes import FailsafeTrigger
from swarm_ctl.core.agent.steering import KeepClear
from swarm_ctl.core.agent.takeover import EVIDENCE_S, LEARN_S, Takeover
from swarm_ctl.core.model.causes import FailsafeAction
from swarm_ctl.core.model.frames import geodetic_from_ned
from swarm_ctl.core.model.messages import Outcome, Phase
from swarm_ctl.core.model.vehicle import GlobalFix
from tests.unit.core.builders import (
    HEIGHT_M,
    HOLD,
    LAST,
    NOW,
    ORIGIN,
    TAKEOFF,
    Own,
    fix,
    peer,
    tick,
    view,
)

YIELDS, LEAVES, LANDS = FailsafeAction.YIELD, FailsafeAction.LEAVE, FailsafeAction.LAND


def started(**changes: Any) -> tuple[Own, Takeover]:
    """A new process, in preparation."""
    fresh = {"arming_s": -math.inf, "was_armed": False, "had_control": False}
    own = Own(step=0, **(fresh | {"target_height_m": 0.0} | changes))
    own.phase = Phase.CONNECT
    return own, own.takeover


def looking(seconds: float, *peers: Any, **seen: Any) -> tuple[Own, str]:
    """What it says after looking at one and the same thing for so long."""
    own, takeover = started()
    said = takeover.look(tick(*peers, **seen))
    if seconds:
        said = takeover.look(tick(*peers, now=NOW + seconds, **seen))
    return own, said


# --- the evidence ---


def far() -> GlobalFix:
    place = geodetic_from_ned((9.0, 0.0, -HEIGHT_M), ORIGIN)
    return GlobalFix(NOW, place, HEIGHT_M, (0.0, 0.0, 0.0))


RISING = {"phase": Phase.TAKEOFF, "airborne": False, "step": TAKEOFF}
DOWN = {"phase": Phase.PREPARE, "airborne": False, "step": 0}
MISSING: list[tuple[str, tuple[Any, ...], dict[str, Any], str]] = [
    ("unhealthy", (), {"healthy": False, "health_reason": "no SYS_STATUS"}, "no SYS_STATUS"),
    ("no position", (), {"fix": None}, "no position yet"),
    ("an old position", (), {"fix": fix(age_s=0.51)}, "no position yet"),
    ("no global position", (), {"global_": None}, "no position yet"),
    ("two positions", (), {"global_": far()}, "global and local position differ by 9.0 m"),
    ("no peer", (peer(2, math.inf), peer(3, math.inf)), {}, "no agent that flies this mission"),
    ("silent peers", (peer(2, 0.51), peer(3, 0.51)), {}, "no agent that flies this mission"),
    ("peers on the ground", (peer(2, **DOWN), peer(3, **DOWN)), {}, "no agent that flies this"),
    ("peers not up yet", (peer(2, **RISING), peer(3, **RISING)), {}, "no agent that flies this"),
    ("another plan", (peer(2), peer(3, plan_hash=7)), {}, "agent 3 has another plan"),
    ("it moves", (), {"fix": fix(velocity=(0.4, 0.4, 0.0))}, "it moves at 0.6 m/s"),
]


@pytest.mark.parametrize(("what", "peers", "seen", "why"), MISSING, ids=[m[0] for m in MISSING])
def test_without_a_piece_of_the_evidence_it_waits_and_then_leaves(
    what: str, peers: tuple[Any, ...], seen: dict[str, Any], why: str
) -> None:
    """It says what is missing for `EVIDENCE_S`, then ends without having sent a setpoint."""
    own, said = looking(EVIDENCE_S, *peers, **seen)
    assert said.startswith(f"the vehicle is in the air; {why}")
    assert own.interruption.trigger is None
    own, _ = looking(EVIDENCE_S + 0.1, *peers, **seen)
    assert own.interruption.trigger is not None
    assert own.interruption.trigger.action is LEAVES
    assert why in own.interruption.trigger.reason
    assert not own.vehicle.ours


@pytest.mark.parametrize(
    ("what", "outcome", "seen", "lands"),
    [
        ("the operator's order", Outcome.ABORTED, {}, True),
        ("a policy", Outcome.FAILED, {}, False),
        ("in a pilot's mode", Outcome.ABORTED, {"controlled": False}, False),
        ("it moves", Outcome.ABORTED, {"fix": fix(velocity=(0.4, 0.4, 0.0))}, False),
    ],
)
def test_an_order_to_land_is_as_good_as_a_peer(
    what: str, outcome: Outcome, seen: dict[str, Any], lands: bool
) -> None:
    """Of all the evidence, it stands for the peer alone."""
    own, takeover = started()
    own.interruption.heed(tick(), FailsafeTrigger(LANDS, outcome, "landed by the operator"))
    for seconds in (0.0, 1.0, EVIDENCE_S + 0.1):
        if takeover.pending(view()):
            takeover.look(tick(peer(2, math.inf), peer(3, math.inf), now=NOW + seconds, **seen))
    trigger = own.interruption.trigger
    assert trigger is not None
    assert (own.vehicle.ours, trigger.action) == ((True, LANDS) if lands else (False, LEAVES))
    assert not takeover.took


# --- the vehicle's mode ---

PILOT = {"controlled": False, "mode": "LOITER"}
LANDING = {"controlled": False, "landing": True, "mode": "LAND"}
MODES: list[tuple[str, dict[str, Any], int, FailsafeAction | None, str]] = [
    ("follows setpoints", {}, HOLD, None, ""),
    ("a pilot's", PILOT, HOLD, YIELDS, "in the air in LOITER"),
    ("landing", LANDING, HOLD, LANDS, "the vehicle lands already (LAND): seen down"),
    ("landing as the swarm does", LANDING, LAST, None, ""),
]


@pytest.mark.parametrize(
    ("what", "seen", "step", "action", "why"), MODES, ids=[m[0] for m in MODES]
)
def test_which_modes_are_taken_over(
    what: str, seen: dict[str, Any], step: int, action: FailsafeAction | None, why: str
) -> None:
    """A mode that follows setpoints, or what the swarm does as well."""
    own, said = looking(0.0 if action else 1.0, peer(2, step=step), peer(3, step=step), **seen)
    if action is None:
        assert own.interruption.trigger is None
        assert own.progress.step == step
        return
    assert own.interruption.trigger is not None
    assert own.interruption.trigger.action is action
    assert why in said


# --- what is taken over ---


def taken(*peers: Any, **seen: Any) -> tuple[Own, Takeover]:
    own, takeover = started()
    takeover.look(tick(*peers, **seen))
    assert takeover.look(tick(*peers, now=NOW + 1.0, **seen)) == ""
    return own, takeover


# --- learning ---


def test_it_holds_for_a_second_while_it_learns() -> None:
    _, takeover = taken()
    held = takeover.learning(tick(now=NOW + 1.0 + LEARN_S - 0.01), 0)
    assert held is not None
    assert isinstance(held.course, KeepClear)
    assert held.phase is Phase.HOLD
    assert takeover.learning(tick(now=NOW + 1.0 + LEARN_S), 0) is None
    assert takeover.learning(tick(now=NOW + 1.1), 0) is None  # once and for all


@pytest.mark.parametrize("step", [TAKEOFF, LAST])
def test_on_the_way_up_and_down_it_does_not_hold(step: int) -> None:
    _, takeover = taken(peer(2, step=step), peer(3, step=step))
    assert takeover.learning(tick(now=NOW + 1.01), 0) is None


DONE: list[tuple[str, Callable[[], Any], bool]] = [
    ("a peer is done", lambda: peer(2, done=True), True),
    ("a peer is further", lambda: peer(2, step=HOLD + 1), True),
    ("none is done", lambda: peer(2), False),
]


@pytest.mark.parametrize(("what", "other", "done"), DONE, ids=[row[0] for row in DONE])
def test_a_hold_step_is_over_when_a_peer_says_so(
    what: str, other: Callable[[], Any], done: bool
) -> None:
    """It has not seen the beginning of the step."""
    own, takeover = taken()
    takeover.learning(tick(other(), now=NOW + 1.5), 0)
    assert own.progress.done is done
