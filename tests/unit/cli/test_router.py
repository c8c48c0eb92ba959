"""What a router is told: by a file, or by the swarm's name alone."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from swarm_ctl.cli.flight.router import _told
from swarm_ctl.errors import InputError

HEXAGON = Path(__file__).parents[3] / "missions" / "hexagon.yaml"
AT, OTHER = "tcp/10.0.0.12:7447", "tcp/10.0.0.11:7447"


@pytest.mark.parametrize("name", ["hexagon", "hexagon@3fa9c1d2e4f6"])
def test_a_name_is_enough(name: str) -> None:
    """It needs no plan: only the swarm, its own place, and the other routers'."""
    assert _told(Path(name), None, AT, [OTHER]) == ("hexagon", None, AT, (OTHER,))


@pytest.mark.parametrize(
    ("file", "listen", "connect", "why"),
    [
        (Path("hexagon"), None, [], "hexagon is no file; allowed: a swarm's name with --listen"),
        (HEXAGON, AT, [OTHER], "has the routers; allowed: with a swarm's name alone"),
        (HEXAGON, AT, [], "is a mesh of peers; allowed: 17 and more"),
        (Path("plan.json"), AT, [], "plan.json: can't be read"),
    ],
    ids=["place", "both", "small", "missing"],
)
def test_what_it_can_not_be_told(
    file: Path, listen: str | None, connect: list[str], why: str
) -> None:
    with pytest.raises(InputError, match=re.escape(why)):
        _told(file, None, listen, connect)
