"""The log: each thing once, alarms from raised to cleared, flapping ones counted."""

from __future__ import annotations

from typing import Any

import pytest

from swarm_ctl.commands.parse import Order
from swarm_ctl.core.model.causes import Cause, FailsafeAction
from swarm_ctl.core.model.messages import Ack, Command, CommandKind, Event, Phase
from swarm_ctl.engine.station.ground_station import swarm_now
from swarm_ctl.station.picture.alarms import Level
from swarm_ctl.station.picture.journal import Journal, JournalLine
from swarm_ctl.station.picture.model import Model
from swarm_ctl.station.picture.view import SwarmView
from tests.unit.station.swarm import flying_model, hexagon_plan, state_of, status_of

PLAN = hexagon_plan()


class Flight:
    """Six agents at 20 Hz, agent 2 with a battery of its own."""

    def __init__(self) -> None:
        self.model = flying_model(PLAN)
        self._seq = 1199
        self._sent = 29.97

    def view(self, now: float, percent: float) -> SwarmView:
        while self._sent + 0.05 < now:
            self._seq, self._sent = self._seq + 1, self._sent + 0.05
            for agent in PLAN.agents:
                self.model.fold(state_of(PLAN, agent.id, self._sent, seq=self._seq), self._sent)
        for agent in PLAN.agents:
            charge = percent if agent.id == 2 else 90.0
            self.model.fold(status_of(PLAN, agent.id, now, battery_percent=charge), now)
        return self.model.view(now)


def _kinds(journal: Journal) -> list[tuple[str, tuple[int, ...]]]:
    return [(entry.kind, entry.agents) for entry in journal.entries]


def test_an_alarm_is_raised_once_acknowledged_and_cleared() -> None:
    flight, journal = Flight(), Journal()
    for now in (30.1, 30.3, 30.5):
        journal.update(flight.view(now, 10.0))
    assert _kinds(journal) == [("alarm", (2,))]
    assert journal.unacknowledged == 1
    assert journal.acknowledge(30.6) == 1
    assert (journal.unacknowledged, journal.entries[0].acknowledged) == (0, True)
    assert journal.acknowledge(30.7) == 0
    for now in (31.0, 36.0, 41.0, 42.0):
        journal.update(flight.view(now, 80.0))
    assert _kinds(journal) == [("alarm", (2,)), ("station", ()), ("cleared", (2,))]
    assert journal.entries[-1] == JournalLine(
        31.0, "cleared", Level.WELL, (2,), "battery (agent 2)"
    )
    assert journal.standing == ()


def test_a_flapping_alarm_is_counted_not_repeated() -> None:
    flight, journal = Flight(), Journal()
    for k in range(10):
        journal.update(flight.view(30.1 + k, 10.0 if k % 2 == 0 else 80.0))
    assert [entry.count for entry in journal.entries] == [5]


def test_events_of_several_agents_and_views_become_one_line() -> None:
    model, journal = flying_model(PLAN), Journal()
    for now, agents in ((30.0, (1, 2)), (30.2, (3,)), (30.4, (4, 5, 6))):
        for agent in agents:
            model.fold(Event(agent, now, "info", "step 3: hold"), now)
        journal.update(model.view(now))
    assert journal.entries == (
        JournalLine(30.0, "event", Level.WELL, (1, 2, 3, 4, 5, 6), "step 3: hold"),
    )


def test_a_command_is_one_line_that_grows() -> None:
    model, journal = flying_model(PLAN), Journal()
    model.fold(Command("c", "land", (), 30.0), 30.0)
    journal.update(model.view(30.0))
    for agent in range(1, 7):
        model.fold(Ack(agent, "c", agent < 6, "" if agent < 6 else "no"), 30.1)
        journal.update(model.view(30.1))
    (entry,) = journal.entries
    assert (entry.text, entry.level) == (
        "land: acknowledged by agents 1-5, refused by agent 6: no",
        Level.WARNING,
    )


def _orders(journal: Journal) -> list[str]:
    return [entry.text for entry in journal.entries if entry.kind == "command"]


_SIX = "land: acknowledged by agents 1-6"


@pytest.mark.parametrize(
    ("kind", "early", "later", "told"),
    [
        ("land", True, {}, _SIX),
        ("land", False, {"phase": Phase.LAND}, _SIX),
        ("hold", False, {"override": Command("c", "", (), 0.0).tag}, _SIX.replace("land", "hold")),
        ("resume", False, {"override": 0}, _SIX.replace("land", "resume")),
        (
            "readmit",
            False,
            {"override": 0},
            _SIX.replace("land", "readmit")[:-1] + "5, no answer heard from agent 6",
        ),
        ("land", False, {}, "land: acknowledged by agents 1-5, no answer heard from agent 6"),
    ],
)
def test_a_station_does_not_wait_for_an_answer_that_it_missed(
    kind: str, early: bool, later: dict[str, Any], told: str
) -> None:
    """Nobody sends it again: it came before the command, by another link; what the agent flies says
    the same; or it never came."""
    model, journal = flying_model(PLAN), Journal()
    model.fold(state_of(PLAN, 6, 29.98, seq=1200, override=5), 29.98)
    if early:
        model.fold(Ack(6, "c", True, ""), 30.0)
    model.fold(Command("c", kind, (), 30.0), 30.0)
    for agent in range(1, 6):
        model.fold(Ack(agent, "c", True, ""), 30.1)
    journal.update(model.view(30.2))
    open_ = f"{kind}: acknowledged by agents 1-5, waiting for agent 6"
    assert _orders(journal) == [told if early else open_]
    model.fold(state_of(PLAN, 6, 36.0, seq=1201, **{"override": 5} | later), 36.0)
    model.fold(state_of(PLAN, 6, 38.0, seq=1202), 38.0)
    journal.update(model.view(81.0))
    assert _orders(journal) == [told]


def test_a_refusal_by_many_is_one_reason_and_agents_that_were_not_meant_do_not_refuse() -> None:
    model, journal = flying_model(PLAN), Journal()
    model.fold(Command("c", "hold", (), 30.0), 30.0)
    model.fold(Command("d", "land", (3,), 30.0), 30.0)
    for agent in range(1, 7):
        model.fold(Ack(agent, "c", False, f"agent {agent} is on its way down"), 30.1)
        model.fold(Ack(agent, "d", agent == 3, "" if agent == 3 else "not meant"), 30.1)
    journal.update(model.view(30.1))
    assert [(entry.text, entry.level) for entry in journal.entries] == [
        ("hold: refused by agents 1-6: it is on its way down", Level.WARNING),
        (
            (
                "land: acknowledged by agent 3;"
                " agents 1-2, 4-6 go on without it (policies.left_by_order)"
            ),
            Level.WELL,
        ),
    ]


def test_an_order_to_all_does_not_wait_for_those_that_have_left() -> None:
    """An agent that has left says so in its state; of one that this station never heard, its peers
    tell. Another order names neither among the others."""
    model, journal = flying_model(PLAN), Journal()
    model.fold(state_of(PLAN, 3, 30.05, seq=9999, left=CommandKind.RETURN), 30.0)
    assert model.view(30.0).left == {3}
    model.fold(Command("c", "hold", (), 30.1), 30.1)
    model.fold(Command("d", "land", (1,), 30.1), 30.1)
    for agent in (1, 2, 4, 5, 6):
        model.fold(Ack(agent, "c", True, ""), 30.2)
    model.fold(Ack(1, "d", True, ""), 30.2)
    journal.update(model.view(30.2))
    assert [entry.text for entry in journal.entries][:2] == [
        "hold: acknowledged by agents 1-2, 4-6",
        ("land: acknowledged by agent 1; agents 2, 4-6 go on without it (policies.left_by_order)"),
    ]
    joined = Model(PLAN)
    joined.fold(status_of(PLAN, 2, 30.0, without=(3,)), 30.0)
    assert joined.view(30.0).left == {3}


def test_alarms_of_one_reason_from_several_views_are_one_line() -> None:
    model, journal = flying_model(PLAN), Journal()
    landed = {"action": FailsafeAction.LAND, "cause": Cause.ORDER, "reason": "landed"}
    for k, agents in enumerate(((1, 2), (3,), (4, 5, 6))):
        for agent in agents:
            model.fold(status_of(PLAN, agent, 30.0, **landed), 30.0)
        journal.update(model.view(30.0 + 0.2 * k))
    assert journal.entries == (
        JournalLine(30.0, "alarm", Level.WARNING, (1, 2, 3, 4, 5, 6), "agents 1-6: landed"),
    )


def test_the_log_is_in_the_order_of_the_times_that_it_shows() -> None:
    """What cleared is known ten seconds later, and stands where it was over."""
    flight, journal = Flight(), Journal()
    journal.update(flight.view(30.1, 10.0))
    journal.update(flight.view(31.0, 80.0))
    flight.model.fold(Event(3, 35.0, "info", "meanwhile"), 35.0)
    for now in (35.1, 42.0):
        journal.update(flight.view(now, 80.0))
    assert _kinds(journal) == [("alarm", (2,)), ("cleared", (2,)), ("event", (3,))]
    times = [entry.time_s for entry in journal.entries]
    assert times == sorted(times)
    assert [entry.kind for entry in journal.newest(1)] == ["cleared"]


def test_a_flood_of_events_is_bounded_and_said() -> None:
    model, journal = flying_model(PLAN), Journal()
    for k in range(2000):
        model.fold(Event(1, 30.0, "info", f"event {k}"), 30.0)
        if k % 100 == 99:
            journal.update(model.view(30.0))
    for k in range(1100):
        model.fold(Event(1, 30.0, "info", f"more {k}"), 30.0)
    journal.update(model.view(30.0))
    assert len(journal.entries) == 2000
    assert any("100 events came too fast" in entry.text for entry in journal.entries)


@pytest.mark.parametrize("down", [True, False])
@pytest.mark.parametrize("kind", ["land", "return", "resume"])
def test_one_that_has_left_and_is_down_does_not_refuse_an_order_to_all(
    kind: str, down: bool
) -> None:
    """As `swarm-ctl send` has it: it was not meant. While it comes down it may refuse to land, and
    that is told. By `return` and `resume` it is called back by its name alone."""
    meant = kind == "land" and not down
    model, journal = flying_model(PLAN), Journal()
    model.fold(state_of(PLAN, 3, 30.05, seq=9999, left=CommandKind.LAND, down=down), 30.0)
    model.fold(Command("c", kind, (), 30.1), 30.1)
    for agent in (1, 2, 4, 5, 6):
        model.fold(Ack(agent, "c", True, ""), 30.2)
    model.fold(Ack(3, "c", False, "no"), 30.2)
    view = model.view(30.2)
    assert (3 in swarm_now(view).meant(Order(kind))) is meant
    journal.update(view)
    told = f"{kind}: acknowledged by agents 1-2, 4-6"
    assert journal.entries[0].text == told + (", refused by agent 3: no" if meant else "")
