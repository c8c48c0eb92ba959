"""What of a swarm without keys other computers can reach: refused, with what makes the keys."""

from __future__ import annotations

from dataclasses import replace

import pytest

from swarm_ctl.core.model.fleet import Fleet, FleetAgent, SigningPolicy
from swarm_ctl.errors import InputError
from swarm_ctl.mission.fleet.exposure import exposures, leaves_loopback, refuse_exposed


@pytest.mark.parametrize(
    ("endpoint", "leaves"),
    [
        ("tcp/127.0.0.1:7447", False),
        ("tcp/127.8.0.1:7447", False),
        ("tcp/localhost:7447", False),
        ("tcp/[::1]:7447", False),
        ("tcp/192.168.1.11:7447", True),
        ("tcp/0.0.0.0:7447", True),
        ("tcp/[::]:7447", True),
        ("tcp/[::ffff:10.0.0.1]:7447", True),
        ("udp/drone-3.local:7447", True),
        ("udpin:127.0.0.1:14550", False),
        ("udpin:0.0.0.0:14550", True),
        ("tcpin:10.0.0.5:5760", True),
        ("10.0.0.5:14550", True),
        ("127.0.0.1:14550", False),
        ("", True),
        ("tcp/localhost.evil.example:7447", True),
    ],
)
def test_what_other_computers_reach(endpoint: str, leaves: bool) -> None:
    assert leaves_loopback(endpoint) == leaves


def fleet(trust: str | None = None, **changes: str) -> Fleet:
    first = FleetAgent(1, 1, "px4", "udpout:10.0.0.5:14550", "tcp/127.0.0.1:7447")
    second = FleetAgent(2, 2, "px4", **changes)
    return Fleet((first, second), trust, SigningPolicy.REQUIRED if trust else SigningPolicy.OFF)


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"mesh": "tcp/10.0.0.2:7447"}, "agent 2 is on the mesh at tcp/10.0.0.2:7447"),
        ({"endpoint": "udpin:0.0.0.0:14"}, "agent 2 listens for its vehicle at udpin:0.0.0.0:14"),
        ({"endpoint": "udp:0.0.0.0:14"}, "agent 2 listens for its vehicle at udp:0.0.0.0:14"),
        ({"endpoint": "udp://:14"}, "agent 2 listens for its vehicle at udp://:14"),
        ({"endpoint": "tcpin:10.0.0.2:57"}, "agent 2 listens for its vehicle at tcpin:10.0.0.2:57"),
    ],
)
def test_a_swarm_without_keys_is_refused_with_the_command_that_makes_them(
    changes: dict[str, str], told: str
) -> None:
    """What, where, and what would be allowed; with keys nothing is refused."""
    with pytest.raises(InputError) as refused:
        refuse_exposed(exposures(fleet(**changes)), "outdoors.yaml")
    assert str(refused.value).startswith(f"{told}, and the fleet has no keys")
    assert "swarm-ctl trust new --fleet outdoors.yaml" in str(refused.value)
    assert "--open-mesh" in str(refused.value)
    assert refused.value.exit_code == 2
    refuse_exposed(exposures(fleet("keys", **changes)), "outdoors.yaml")


def test_keys_of_the_mesh_do_not_protect_a_link_that_is_not_signed() -> None:
    """With `signing: off` a listening link is refused as without keys; the mesh is not."""
    wide = fleet("keys", endpoint="udpin:0.0.0.0:14", mesh="tcp/10.0.0.2:7447")
    unsigned = replace(wide, signing=SigningPolicy.OFF)
    with pytest.raises(InputError) as refused:
        refuse_exposed(exposures(unsigned, ["tcp/10.0.0.9:1"]), "outdoors.yaml", unsigned.trust)
    assert str(refused.value) == (
        "agent 2 listens for its vehicle at udpin:0.0.0.0:14, and the fleet has signing: off: any"
        " computer there could command the vehicle; allowed: signing: required, loopback"
        " addresses, or --open-mesh"
    )


def test_a_vehicle_that_an_agent_calls_is_no_open_door() -> None:
    assert exposures(fleet(endpoint="tcp:10.0.0.2:5760", mesh="tcp/127.0.0.1:7448")) == []
