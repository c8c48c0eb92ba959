"""Whose key signs a vehicle's link."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path

import pytest

from swarm_ctl.core.model.fleet import Fleet, FleetAgent, SigningPolicy
from swarm_ctl.engine.link_keys import LinkKeys
from swarm_ctl.errors import TrustError
from swarm_ctl.trust import provision


@pytest.fixture
def trust(tmp_path: Path) -> Path:
    agents = dict.fromkeys((1, 2), "127.0.0.1")
    folder = tmp_path / "field"
    provision.new(folder, "field", agents, ["anna"], [], provision.Terms(datetime.now(UTC)))
    return folder


def test_the_fleet_s_folder_or_the_identity_that_is_given(trust: Path) -> None:
    """An identity serves its own agent's vehicle, with a fleet without `trust` as well; with
    `signing: off` no link is signed."""
    agents = (FleetAgent(1, 1, "px4"), FleetAgent(2, 2, "px4"))
    with_keys = Fleet(agents, str(trust), SigningPolicy.REQUIRED)
    assert LinkKeys.of(with_keys).key_file(2) == trust / "agent-2/mavlink.key"
    for fleet in (with_keys, Fleet(agents)):
        given = LinkKeys.of(fleet, trust / "agent-1")
        assert given.key_file(1) == trust / "agent-1/mavlink.key"
        with given.signing(1) as signing:
            assert signing is not None
        with pytest.raises(TrustError, match="allowed: the identity of agent 2"):
            given.key_file(2)
    assert LinkKeys.of(Fleet(agents, str(trust))).key_file(1) is None
    assert LinkKeys.of(Fleet(agents)).key_file(1) is None
