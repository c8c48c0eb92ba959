"""Orders and answers in a line."""

from __future__ import annotations

from swarm_ctl.core.model.messages import Command, CommandKind, Gains, Tuning
from swarm_ctl.core.model.zones import Zone
from swarm_ctl.station.picture.summaries import command_words


def test_a_change_that_is_decided_tells_law_and_zones() -> None:
    """While zones were added, a `tune` brings them along: its own values are told all the same."""
    pond = Zone("pond", ((30.0, 0.0),), 8.0, 1.25)
    tuning = Tuning(Gains(delta_a=0.1, delta_l=2.0, h=0.04, kappa=20.0), 43.7, zones=(pond,))
    words = command_words(Command("c", CommandKind.APPLY, (1,), 41.0, tuning=tuning, commits=7))
    assert words.startswith("zones pond; h 0.04, kappa 20")
    assert words.endswith("from 43.7 s")
