"""Which of the plans that stations offer an agent takes, and what it says of the others."""

from __future__ import annotations

import gzip
import json
import re
import time
import tracemalloc
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from swarm_ctl.core.model.fleet import Fleet, FleetAgent, SigningPolicy
from swarm_ctl.core.model.plan import Plan, Response
from swarm_ctl.engine.fetched_plan import await_offer
from swarm_ctl.errors import InputError
from swarm_ctl.mesh.keys import plan_key
from swarm_ctl.mission.compile.loader import load
from swarm_ctl.mission.compile.offers import (
    PACKED_BYTES,
    SETTLE_S,
    Offers,
    PlanName,
    pack,
    plan_name,
    unpack,
)
from swarm_ctl.mission.compile.plan_file import named_by_hash, plan_to_json

ROOT = Path(__file__).parents[3]
LOADED = load(ROOT / "missions" / "square.yaml")
PLAN, AGENTS = LOADED.plan, LOADED.fleet.agents
OTHER = replace(PLAN, kappa=PLAN.kappa / 2)


def offer(plan: Plan = PLAN, agents: tuple[FleetAgent, ...] = AGENTS) -> bytes:
    return pack(plan, agents, SigningPolicy.OFF)


def named(plan: Plan = PLAN) -> str:
    return named_by_hash(plan, Fleet(AGENTS))


def wanted(plan: Plan = PLAN, digits: int = 12) -> PlanName:
    name, _, whole = named(plan).partition("@")
    return PlanName(name, whole[:digits])


def test_a_plan_survives_the_way() -> None:
    """Of every ready mission, with its fleet; it is far under what zenoh puts together."""
    for path in sorted((ROOT / "missions").glob("*.yaml")):
        loaded = load(path)
        packed = pack(loaded.plan, loaded.fleet.agents, SigningPolicy.REQUIRED)
        found = unpack(packed, "it")
        assert len(packed) < PACKED_BYTES / 10
        assert (found.plan, found.fleet, found.trust) == (loaded.plan, loaded.fleet.agents, None)
        assert found.signing is SigningPolicy.REQUIRED


@pytest.mark.parametrize(
    ("word", "name"),
    [
        ("hexagon", PlanName("hexagon")),
        ("hexagon@3fa9c1d2e4f6", PlanName("hexagon", "3fa9c1d2e4f6")),
        ("a-b_2@0123456789abcdef", PlanName("a-b_2", "0123456789abcdef")),
        ("plan.json", None),
        ("missions/hexagon", None),
        ("./me@home", None),
    ],
)
def test_names(word: str, name: PlanName | None) -> None:
    assert plan_name(word) == name


@pytest.mark.parametrize(
    "word", ["hexagon@", "hexagon@3fa9c1d2e4f", "hexagon@3FA9C1D2E4F6", "x@" + 17 * "0"]
)
def test_what_is_no_hash(word: str) -> None:
    with pytest.raises(InputError, match=r"allowed: NAME@HASH with 12 to 16"):
        plan_name(word)


def test_the_hash_decides() -> None:
    """Another plan of the same name is refused by name, and the wanted one is taken at once,
    whichever station is heard first."""
    offers = Offers(wanted())
    offers.hear("bob", offer(OTHER), 0.0)
    assert offers.chosen(100.0) is None
    [told] = offers.refusals()
    assert told == f"station bob has {named(OTHER)}, not {wanted()}"
    offers.hear("anna", offer(), 100.0)
    chosen = offers.chosen(100.0)
    assert chosen is not None
    assert chosen.plan == PLAN


def test_without_a_hash_stations_must_agree() -> None:
    """One plan is taken once no station has offered another one for a while; two different ones
    are refused, both stations named with what they have."""
    offers = Offers(PlanName(PLAN.name))
    offers.hear("anna", offer(), 1.0)
    assert offers.chosen(1.0 + SETTLE_S - 0.1) is None
    assert offers.chosen(1.0 + SETTLE_S) is not None
    offers.hear("bob", offer(OTHER), 1.0)
    told = f"station anna has {named()}; station bob has {named(OTHER)}"
    with pytest.raises(InputError, match=re.escape(told)):
        offers.chosen(1.0)


def edited(change: Callable[[str], str]) -> bytes:
    """An offer whose text was changed after its hash was computed."""
    return gzip.compress(change(plan_to_json(PLAN, Fleet(AGENTS))).encode())


@pytest.mark.parametrize(
    ("data", "why"),
    [
        (b"", "is too large for the mesh; allowed: a copy of its plan file"),
        (b"\x1f\x8b\x08hostile", "is not packed as a plan"),
        (offer()[:-30], "is torn"),
        (gzip.compress(bytes(100_000_000)), "is torn, or longer than 4 MB"),
        (gzip.compress(b"{"), "not JSON"),
        (gzip.compress(json.dumps({"schema_version": 1}).encode()), "schema_version"),
        (edited(lambda text: text.replace('"unit_m": ', '"unit_m": 1')), "it was changed after"),
        (edited(lambda text: text.replace('"fleet"', '"fleets"')), "fleets"),
        (offer(replace(PLAN, name="other")), f"has other@.*, not {wanted()}"),
    ],
    ids=["none", "garbage", "torn", "bomb", "json", "version", "edited", "field", "name"],
)
def test_hostile_offers(data: bytes, why: str) -> None:
    """Each is refused with its station's name and what is wrong; the next station's is taken."""
    offers = Offers(wanted())
    offers.hear("mallory", data, 0.0)
    assert offers.chosen(9.0) is None
    [told] = offers.refusals()
    assert "station mallory" in told
    assert re.search(why, told)
    offers.hear("anna", offer(), 9.0)
    assert offers.chosen(9.0) is not None


def test_stations_without_end() -> None:
    """A flood under ever new names is not read for ever."""
    offers = Offers(wanted())
    for number in range(1000):
        offers.hear(f"m{number}", b"hostile", 0.0)
    assert len(offers.refusals()) == 32
    offers.hear("anna", offer(), 0.0)
    assert offers.chosen(0.0) is not None, "and it keeps no station away"


@pytest.mark.parametrize(
    "change",
    [
        {"endpoint": "udpout:10.9.9.9:14550"},
        {"sysid": 77},
        {"agent_sysid": 201},
        {"mesh": "tcp/10.9.9.9:7447"},
        {"router": "tcp/10.9.9.9:7447"},
        {"host": "mallory"},
        {"autopilot": "px4"},
        {"response": Response(dead_time_s=0.1)},
    ],
)
def test_the_hash_is_of_all_that_an_agent_acts_on(change: dict[str, Any]) -> None:
    """The right plan with another fleet is another offer: no agent speaks to its endpoint."""
    offers, first = Offers(wanted()), replace(AGENTS[0], **change)
    offers.hear("mallory", offer(agents=(first, *AGENTS[1:])), 0.0)
    assert offers.chosen(9.0) is None
    [told] = offers.refusals()
    assert re.fullmatch(rf"station mallory has {PLAN.name}@[0-9a-f]{{16}}, not {wanted()}", told)
    signed = Offers(wanted())
    signed.hear("mallory", pack(PLAN, AGENTS, SigningPolicy.REQUIRED), 0.0)
    assert signed.chosen(9.0) is None, "signing is acted on, too"


def test_an_offer_names_no_folder_of_keys() -> None:
    """An agent's keys are where its own command line says."""
    with pytest.raises(InputError, match="names a folder of keys"):
        unpack(edited(lambda text: text.replace('"trust": null', '"trust": "evil"')), "it")


@pytest.mark.parametrize("where", ["steps", "fleet", "slots", "same field"])
def test_an_offer_of_many_mistakes_costs_little(where: str) -> None:
    """A hundred thousand wrong entries in some hundred packed bytes: few are told, in some
    seconds and megabytes."""
    whole, many = json.loads(plan_to_json(PLAN, Fleet(AGENTS))), 100_000
    group = whole["plan"]["groups"][0]
    if where == "fleet":
        whole["fleet"] = [{}] * many
    elif where == "slots":
        group["steps"] = [{"kind": "form", "slots": [0] * many}]
    elif where == "same field":
        group["steps"] = ["HERE"]
    else:
        group[where] = [0] * many
    text = json.dumps(whole, separators=(",", ":"))
    data = gzip.compress(text.replace('"HERE"', "{" + '"a":0,' * many + '"a":0}').encode())
    tracemalloc.start()
    before_s = time.process_time()
    with pytest.raises(InputError) as caught:
        unpack(data, "it")
    _, most = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert time.process_time() - before_s < 10.0
    assert most < 100e6
    assert len(str(caught.value)) < 10_000


class Mesh:
    """Stations that answer, each from a question on; the clock goes with every pause."""

    def __init__(self, **answers: tuple[int, bytes]) -> None:
        self.answers, self.asked, self.now_s = answers, 0, 0.0

    def ask(self, key_expression: str, take: Callable[[str, bytes], None]) -> None:
        assert key_expression == plan_key(PLAN.name, "*")
        self.asked += 1
        for station, (since, data) in self.answers.items():
            if self.asked >= since:
                take(plan_key(PLAN.name, station), data)

    def wait(self, patience_s: float = 60.0) -> PlanName | None:
        found = await_offer(Offers(wanted()), self, patience_s, lambda: self.now_s, self.pause)
        return found and PlanName(*found.name.split("@"))

    def pause(self, seconds: float) -> None:
        self.now_s += seconds


def test_an_agent_asks_again() -> None:
    """Once a second, until a station that comes later answers; another plan does not end it."""
    mesh = Mesh(bob=(1, offer(OTHER)), anna=(5, offer()))
    assert mesh.wait() == wanted(digits=16)
    assert mesh.asked == 5
    assert mesh.now_s == pytest.approx(4.0, abs=0.1)


def test_an_agent_gives_up() -> None:
    """A station that dies while it answers is one that does not answer."""
    mesh = Mesh(bob=(1, offer()[:-20]))
    assert mesh.wait(10.0) is None
    assert mesh.asked == 10
