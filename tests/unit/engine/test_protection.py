"""Who a process is on the mesh, and what keeps it from being another."""

from __future__ import annotations

from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest

from swarm_ctl.core.model.fleet import FleetAgent
from swarm_ctl.engine.protection import (
    agent_identity_folder,
    operator_identity,
    own_identity,
    refuse_useless,
    station_identity,
)
from swarm_ctl.errors import TrustError

Make = Callable[..., Path]


@pytest.fixture(scope="module")
def make(tmp_path_factory: pytest.TempPathFactory) -> Make:
    """Makes a trust folder of agents 1 and 2."""
    from swarm_ctl.trust.provision import Terms, new

    def made(*operators: str, age_days: int = 0, host: str = "127.0.0.1") -> Path:
        folder = tmp_path_factory.mktemp("trust") / "field"
        terms = Terms(datetime.now(UTC) - timedelta(days=age_days))
        new(folder, "field", {1: "127.0.0.1", 2: host}, operators, ["tv"], terms)
        return folder

    return made


def agents(mesh: str | None = None) -> tuple[FleetAgent, ...]:
    return FleetAgent(1, 1, "px4"), FleetAgent(2, 2, "px4", mesh=mesh)


def test_a_station_is_the_only_operator(make: Make) -> None:
    """Or the one that is named; a viewer has to be named, and an agent is refused."""
    alone, several = make("anna"), make("anna", "bob")
    identity = station_identity(str(alone))
    assert identity is not None
    assert str(identity.member) == "operator anna"
    assert station_identity(None) is None
    with pytest.raises(TrustError, match="operator-anna, operator-bob"):
        station_identity(str(several))
    named = station_identity(str(several), several / "viewer-tv")
    assert named is not None
    assert str(named.member) == "viewer tv"
    with pytest.raises(TrustError, match="is agent 1, which flies"):
        station_identity(str(alone), alone / "agent-1")


def test_a_viewer_gives_no_commands(make: Make) -> None:
    folder = make("anna")
    assert operator_identity(str(folder)) is not None
    with pytest.raises(TrustError, match="viewer tv may only watch; allowed: an operator"):
        operator_identity(str(folder), folder / "viewer-tv")


def test_an_agent_is_itself_alone(make: Make) -> None:
    folder = make("anna")
    found = agent_identity_folder(str(folder), 2)
    assert found == folder / "agent-2"
    assert own_identity(found, 2) is not None
    assert own_identity(None, 2) is None
    with pytest.raises(TrustError, match="is agent 2; allowed: the identity of agent 1"):
        own_identity(found, 1)


def test_a_trust_that_is_not_there_names_what_makes_it(tmp_path: Path) -> None:
    for wanted in (lambda t: agent_identity_folder(t, 1), station_identity):
        with pytest.raises(TrustError, match="swarm-ctl trust new --fleet"):
            wanted(str(tmp_path / "none"))


@pytest.mark.parametrize(
    ("age_days", "host", "mesh", "told"),
    [
        (0, "127.0.0.1", None, ""),
        (0, "10.0.0.2", "tcp/10.0.0.2:7447", ""),
        (31, "127.0.0.1", None, "the certificate of operator anna ended on "),
        (29.5, "127.0.0.1", None, "the certificate of operator anna ends in 12 h, on "),
        (0, "10.0.0.2", "tcp/10.0.0.3:7447", "agent 2 is for 10.0.0.2, and it listens at 10.0.0.3"),
        (0, "10.0.0.2", None, "agent 2 is for 10.0.0.2, and it listens at 127.0.0.1"),
    ],
)
def test_certificates_that_open_no_link_are_named_before_the_start(
    make: Make, age_days: float, host: str, mesh: str | None, told: str
) -> None:
    identity = station_identity(str(make("anna", age_days=age_days, host=host)))
    assert identity is not None
    if not told:
        refuse_useless(identity, agents(mesh), {})
        return
    with pytest.raises(TrustError, match=told):
        refuse_useless(identity, agents(mesh), {})


def test_an_agent_that_the_roster_does_not_name_is_told(make: Make) -> None:
    identity = station_identity(str(make("anna")))
    assert identity is not None
    with pytest.raises(TrustError, match="the roster of field has no agent 9"):
        refuse_useless(identity, (*agents(), FleetAgent(9, 9, "px4")), {})
