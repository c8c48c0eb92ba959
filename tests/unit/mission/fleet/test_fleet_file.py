"""A measured response in a fleet file: there afterwards, and nothing else changed."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarm_ctl.core.model.autopilots import AUTOPILOT_KINDS
from swarm_ctl.core.model.fleet import RadioShare, SigningPolicy
from swarm_ctl.core.model.plan import Response
from swarm_ctl.errors import InputError, MissionError
from swarm_ctl.mission.compile.loader import load
from swarm_ctl.mission.compile.plan_file import plan_from_json, plan_to_json
from swarm_ctl.mission.fleet.fleet_file import file_of, read_fleet, with_response
from swarm_ctl.mission.input import yaml_file
from tests.unit.mission.example import TEXT as MISSION

BARE = MISSION[: MISSION.index("fleet:")]
FOUND = Response(0.41, 0.52, 2.7, 0.1)
TEXT = "{dead_time_s: 0.41, lag_s: 0.52, acceleration_mps2: 2.7, doubt_s: 0.1}"

ENTRIES = {
    "- {id: 3, sysid: 13}  # north\n": f"- {{id: 3, sysid: 13, response: {TEXT}}}  # north\n",
    "- {id: 3,\n     sysid: 13, # here\n    }\n": (
        f"- {{id: 3,\n     sysid: 13, response: {TEXT}, # here\n    }}\n"
    ),
    "- {response: {lag_s: 1}, id: 3}\n": f"- {{response: {TEXT}, id: 3}}\n",
    "- {id: 3, response: }\n": f"- {{id: 3, response: {TEXT} }}\n",
    "- id: 3 # north\n    sysid: 13\n": f"- id: 3 # north\n    response: {TEXT}\n    sysid: 13\n",
    "- sysid: 13\n    id: 3": f"- sysid: 13\n    response: {TEXT}\n    id: 3",
    "- id: 3": f"- id: 3\n    response: {TEXT}",
    "- id: 3\n    response:\n": f"- id: 3\n    response: {TEXT}\n",
    "- id: 3\n    response:\n      lag_s: 1 # old\n      dead_time_s: 2\n\n  # end\n": (
        "- id: 3\n    response:\n      lag_s: 0.52 # old\n      acceleration_mps2: 2.7\n"
        "      doubt_s: 0.1\n      dead_time_s: 0.41\n\n  # end\n"
    ),
}


@pytest.mark.parametrize(
    ("url", "plain"),
    [
        ("udpin://:14540", "udpin:0.0.0.0:14540"),
        ("udp://:14540", "udpin:0.0.0.0:14540"),
        ("udp:10.0.0.5:14540", "udpin:10.0.0.5:14540"),
        ("udpout://drone3.local:14550", "udpout:drone3.local:14550"),
        ("tcp://10.0.0.5:5760", "tcp:10.0.0.5:5760"),
        ("tcpout://10.0.0.5:5760", "tcp:10.0.0.5:5760"),
        ("serial:///dev/ttyACM0:115200", "serial:/dev/ttyACM0:115200"),
        ("udpout://:14550", None),
        ("tcp:///10.0.0.5:5760", None),
        ("http://10.0.0.5:5760", None),
    ],
)
def test_an_endpoint_may_be_a_url(tmp_path: Path, url: str, plain: str | None) -> None:
    """As MAVSDK has it; the fleet has one spelling, by which links are compared and refused."""
    file = tmp_path / "fleet.yaml"
    file.write_text(f"agents: [{{id: 1, endpoint: '{url}'}}]")
    if plain is None:
        with pytest.raises(MissionError, match="endpoint"):
            read_fleet(file)
    else:
        assert [agent.endpoint for agent in read_fleet(file).agents] == [plain]


@pytest.mark.parametrize("before", ENTRIES)
@pytest.mark.parametrize("newline", ["\n", "\r\n"])
def test_only_the_response_changes(before: str, newline: str) -> None:
    """However the entry is written; comments, order and line ends stay."""
    head = "# mine\nversion: 1\nagents:\n  - {id: 30}\n  "
    written = with_response((head + before).replace("\n", newline), 3, FOUND)
    assert written == (head + ENTRIES[before]).replace("\n", newline)


@given(dead=st.integers(0, 200), lag=st.integers(2, 500), most=st.integers(1, 200))
def test_what_is_written_is_what_is_read(dead: int, lag: int, most: int) -> None:
    found = Response(dead / 100, lag / 100, most / 10)
    data = yaml_file.parse(with_response("agents: [{id: 3}, {id: 4}]", 4, found), "").data
    assert Response(**data["agents"][1]["response"]) == found
    assert data["agents"][0] == {"id": 3}


def test_an_agent_that_is_not_there() -> None:
    with pytest.raises(InputError, match="no entry for agent 5"):
        with_response("agents: [{id: 3}]", 5, FOUND)


def test_a_fleet_is_read_without_a_mission(tmp_path: Path) -> None:
    """Sorted, with what is typical for each autopilot."""
    path = tmp_path / "fleet.yaml"
    path.write_text(
        "agents:\n  - {id: 2, autopilot: px4, sysid: 9}\n  - {id: 1, response: {lag_s: 0.7}}\n"
    )
    first, second = read_fleet(path).agents
    assert (first.id, first.sysid, first.response.lag_s, first.endpoint) == (1, 1, 0.7, None)
    assert (second.id, second.sysid, second.response) == (2, 9, AUTOPILOT_KINDS["px4"].response)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        (
            "agents:\n  - {id: 1, respons: {}}\n",
            "fleet.yaml:2: agents#1.respons: unknown field; did you mean response?",
        ),
        (
            "agents:\n  - {id: 1}\n  - {id: 1}\n",
            "fleet.yaml:3: agents#2.id: 1 is taken by agents#1",
        ),
        ("agents: []\n", "fleet.yaml:1: agents"),
        ("agents:\n  - {id: 1, host: -oProxyCommand=x}\n", 'fleet.yaml:2: agents#1.host: "-o'),
        ('agents:\n  - {id: 1, host: "a b"}\n', 'fleet.yaml:2: agents#1.host: "a b"'),
        (
            "agents:\n  - {id: 1, host: a}\n  - {id: 2}\n",
            "fleet.yaml:3: agents#2: agent 2 has no host, and other agents have one",
        ),
        (
            "router: tcp/a:1\nagents:\n  - {id: 1, host: a}\n  - {id: 2, host: a, router: tcp/b:2}",
            "fleet.yaml:4: agents#2.router: a has the router tcp/a:1 already",
        ),
        (
            "agents:\n"
            + "".join(f"  - {{id: {i}, host: a, endpoint: 'udpin:h:1'}}\n" for i in (1, 2)),
            "udpin:h:1 of a is taken by agents#1",
        ),
        ("agents:\n  - {id: 1, endpoint: 'udpout:h:99999'}\n", "port 99999 is out of range"),
        ("signing: required\nagents: [{id: 1}]\n", "no keys to sign with; allowed: trust: FOLDER"),
        ("agents: [{id: 1, mesh: tls/10.0.0.1:7}]\n", "tls/ without keys; allowed: trust: FOLDER"),
        ("agents: [{id: 1, mesh: quic/10.0.0.1:7}]\n", "in the fleet, or udp/"),
        ("trust: ''\nagents: [{id: 1}]\n", "fleet.yaml:1: trust: "),
        ("signing: on\nagents: [{id: 1}]\n", "required, off"),
    ],
)
def test_mistakes_have_their_line(tmp_path: Path, text: str, told: str) -> None:
    path = tmp_path / "fleet.yaml"
    path.write_text(text)
    with pytest.raises(MissionError) as refused:
        read_fleet(path)
    assert told in str(refused.value)


@pytest.mark.parametrize(
    ("fields", "signing"),
    [
        ("", SigningPolicy.OFF),
        ("trust: keys/field\n", SigningPolicy.REQUIRED),
        ("trust: keys/field\nsigning: off\n", SigningPolicy.OFF),
    ],
)
def test_the_keys_of_a_fleet_stand_beside_it(
    tmp_path: Path, fields: str, signing: SigningPolicy
) -> None:
    """In a fleet file, and in a mission that names it from another folder."""
    path = tmp_path / "far" / "fleet.yaml"
    path.parent.mkdir()
    agents = "".join(f"  - {{id: {i}}}\n" for i in (1, 2, 3))
    path.write_text(f"{fields}agents:\n{agents}")
    mission = tmp_path / "mission.yaml"
    mission.write_text(f"{BARE}fleet: far/fleet.yaml\n")
    trust = str(path.parent / "keys/field") if fields else None
    for fleet in (read_fleet(path), load(mission).fleet, load(mission, vehicles="px4").fleet):
        assert (fleet.trust, fleet.signing) == (trust, signing)
    plan = load(mission).plan
    file = plan_from_json(plan_to_json(plan, load(mission).fleet))
    assert (file.trust, file.signing) == (trust, signing)


def test_where_the_fleet_of_a_mission_stands(tmp_path: Path) -> None:
    path = tmp_path / "mission.yaml"
    for fleet, where in (
        ("fleet: far/away.yaml", tmp_path / "far/away.yaml"),
        ("fleet: {agents: [{id: 1}]}", path),
    ):
        path.write_text(f"{BARE}{fleet}\n")
        assert file_of(path) == where
    path.write_text(BARE)
    assert file_of(path) is None


def radio_fleet(tmp_path: Path, endpoint: str, more: str = "", count: int = 3) -> Path:
    path = tmp_path / "radio.yaml"
    entries = "".join(f"  - {{id: {i}, endpoint: '{endpoint}'}}\n" for i in range(1, count + 1))
    path.write_text(f"{more}agents:\n{entries}")
    return path


def test_agents_that_share_a_serial_port_share_a_radio(tmp_path: Path) -> None:
    fleet = read_fleet(radio_fleet(tmp_path, "serial:/dev/ttyUSB0:57600"))
    share = RadioShare("serial:/dev/ttyUSB0:57600", 5760, 3)
    assert [agent.radio for agent in fleet.agents] == [share] * 3
    assert [a.endpoint for a in fleet.agents] == [f"udpout:127.0.0.1:1700{i}" for i in (1, 2, 3)]
    assert list(fleet.radios().values()) == [fleet.agents]


def test_another_endpoint_is_shared_only_where_the_fleet_says_what_it_carries(
    tmp_path: Path,
) -> None:
    with pytest.raises(MissionError, match="swarm-ctl link"):
        read_fleet(radio_fleet(tmp_path, "udpin:127.0.0.1:14550"))
    path = radio_fleet(tmp_path, "udpin:127.0.0.1:14550", "radio_bytes_per_s: 4000\n")
    assert {a.radio and a.radio.bytes_per_s for a in read_fleet(path).agents} == {4000}


def test_vehicles_behind_one_radio_have_sysids_of_their_own(tmp_path: Path) -> None:
    path = radio_fleet(tmp_path, "serial:/dev/ttyUSB0")
    path.write_text(path.read_text().replace("id: 2,", "id: 2, sysid: 1,"))
    with pytest.raises(MissionError, match="sysid 1 is there twice behind the radio"):
        read_fleet(path)


@pytest.mark.parametrize(
    ("text", "mesh", "routers"),
    [
        (
            "agents: [{id: 1, host: a}, {id: 2, host: b}, {id: 3, host: a}]\n",
            ["tcp/a:7448", "tcp/b:7448", "tcp/a:7449"],
            [None] * 3,
        ),
        (
            "agents: [{id: 1, host: a, mesh: tcp/a:9}, {id: 2, host: b}]\n",
            ["tcp/a:9", "tcp/b:7448"],
            [None] * 2,
        ),
        (
            "agents: [{id: 1, host: a, router: tcp/c:1}, {id: 2, host: b}]\n",
            [None] * 2,
            ["tcp/c:1", "tcp/b:7447"],
        ),
        (
            "agents: [" + ", ".join(f"{{id: {i}, host: h{i % 2}}}" for i in range(1, 18)) + "]\n",
            [None] * 17,
            [f"tcp/h{i % 2}:7447" for i in range(1, 18)],
        ),
    ],
    ids=["small", "one named", "routers named", "large"],
)
def test_places_on_the_mesh_follow_from_the_host(
    tmp_path: Path, text: str, mesh: list[str | None], routers: list[str | None]
) -> None:
    path = tmp_path / "fleet.yaml"
    path.write_text(text)
    agents = read_fleet(path).agents
    assert [agent.mesh for agent in agents] == mesh
    assert [agent.router for agent in agents] == routers
