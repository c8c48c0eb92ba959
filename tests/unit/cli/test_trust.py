"""`swarm-ctl trust` as a user calls it."""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

from swarm_ctl.cli.app import app
from swarm_ctl.errors import SwarmError
from swarm_ctl.trust.explain import Answer

FLEET = """\
trust: trust/outdoors
agents:
  - {id: 1, endpoint: "udpout:127.0.0.1:14550"}
  - {id: 3, endpoint: "udpout:127.0.0.1:14551", mesh: tls/192.168.1.13:7447}
"""
Call = Callable[..., Result]


@pytest.fixture
def call(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Call:
    """Runs `swarm-ctl trust ...` in a folder with a fleet file; nothing listens anywhere."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(os, "sync", lambda: None)  # no test here ends by a power failure
    monkeypatch.setenv("COLUMNS", "200")
    monkeypatch.setenv("LOGNAME", "Anna B.")
    monkeypatch.setattr("swarm_ctl.trust.check.ask", lambda *_: Answer(reached=False))
    Path("outdoors.yaml").write_text(FLEET)

    def run(*words: str) -> Result:
        return CliRunner().invoke(app, ["trust", *words])

    return run


def refusal(result: Result) -> str:
    """The text of an error, which `main` prints and exits by."""
    assert isinstance(result.exception, SwarmError)
    assert result.exception.exit_code == 2
    return str(result.exception)


def test_from_nothing_to_a_host(call: Call, monkeypatch: pytest.MonkeyPatch) -> None:
    """One command makes the keys, one file goes to a host, a check of both is fine. No file's name
    is cut on 80 columns."""
    made = call("new", "--fleet", "outdoors.yaml", "--viewer", "tv")
    assert made.exit_code == 0, made.exception
    assert "operator-anna-b.outdoors.e1" in made.output
    assert "scp trust/outdoors/agent-1.bundle HOST:" in made.output
    assert "agent-3.bundle" in made.output
    assert call("check", "--fleet", "outdoors.yaml").exit_code == 0
    host = call("install", "trust/outdoors/agent-3.bundle", "--folder", "host/outdoors")
    assert "agent-3.outdoors.e1, until" in host.output
    assert "now delete trust/outdoors/agent-3.bundle" in host.output
    assert call("check", "host/outdoors").exit_code == 0
    monkeypatch.setenv("COLUMNS", "80")
    assert "…" not in call("rotate", "--fleet", "outdoors.yaml").output
    assert "is there already" in refusal(call("new", "--fleet", "outdoors.yaml"))


def test_no_secret_is_printed(call: Call) -> None:
    """By no command, `--json` included."""
    texts = [
        call(*words).output
        for words in (
            ("new", "--fleet", "outdoors.yaml"),
            ("add", "operator", "bob"),
            ("rotate",),
            ("install", "trust/outdoors/agent-3.bundle", "--folder", "host/outdoors"),
            ("check", "--json"),
        )
    ]
    secrets = {path.read_bytes() for path in Path().rglob("*.key")}
    assert len(secrets) > 4
    for text in texts:
        assert "PRIVATE KEY" not in text
        assert not any(secret.hex() in text for secret in secrets)


def test_check_says_what_needs_attention(call: Call) -> None:
    """Exit code 1, in text and in JSON."""
    call("new", "--fleet", "outdoors.yaml")
    Path("trust/outdoors/agent-3/mesh.key").chmod(0o644)
    found = call("check")
    assert found.exit_code == 1
    assert "ATTENTION: agent 3: trust/outdoors/agent-3/mesh.key: others may read" in found.output
    found = call("check", "--json")
    assert found.exit_code == 1
    (agent,) = (m for m in json.loads(found.output)["members"] if m["member"] == "agent 3")
    assert "allowed: 0600" in agent["attention"][0]


def test_add_revoke_rotate(call: Call) -> None:
    """Each shows the roster as it is now."""
    call("new", "--fleet", "outdoors.yaml")
    assert "viewer-tv.outdoors.e1" in call("add", "viewer", "tv").output
    gone = call("revoke", "agent", "3").output
    assert "agent-3" not in gone
    assert "agent-1.outdoors.e2" in gone
    again = call("add", "agent", "3", "--fleet", "outdoors.yaml").output
    assert "agent-3.outdoors.e2" in again
    assert "192.168.1.13" in again
    Path("outdoors.yaml").write_text(FLEET.replace("192.168.1.13", "10.0.0.3"))
    assert call("check", "--fleet", "outdoors.yaml").exit_code == 1
    assert "10.0.0.3" in call("rotate", "--fleet", "outdoors.yaml").output
    assert call("check", "--fleet", "outdoors.yaml").exit_code == 0


def test_a_key_stays_on_its_host(call: Call) -> None:
    """Both halves, as the help shows them."""
    call("new", "--fleet", "outdoors.yaml")
    call("revoke", "agent", "3")
    asked = call("request", "agent", "3", "--folder", "host/outdoors")
    assert "swarm-ctl trust add agent 3 --csr agent-3.csr" in asked.output
    call("add", "agent", "3", "--fleet", "outdoors.yaml", "--csr", "agent-3.csr")
    assert not Path("trust/outdoors/agent-3/mesh.key").exists()
    assert call("check").exit_code == 0
    bundle = "trust/outdoors/agent-3.bundle"
    assert call("install", bundle, "--folder", "host/outdoors").exit_code == 0
    assert call("check", "host/outdoors").exit_code == 0
    other = call("add", "agent", "1", "--fleet", "outdoors.yaml", "--csr", "agent-3.csr")
    assert "asks for agent 3; allowed: agent 1" in refusal(other)


def test_which_folder(call: Call) -> None:
    """None, and several."""
    assert "no folder in trust/" in refusal(call("check"))
    call("new", "--fleet", "outdoors.yaml")
    call("new", "--fleet", "outdoors.yaml", "--folder", "trust/indoors")
    assert "several: trust/indoors, trust/outdoors" in refusal(call("rotate"))


def test_an_agent_that_the_fleet_has_not(call: Call) -> None:
    """Its address is not known."""
    call("new", "--fleet", "outdoors.yaml")
    assert "with --fleet FILE" in refusal(call("add", "agent", "7"))
    assert "has no agent 7" in refusal(call("add", "agent", "7", "--fleet", "outdoors.yaml"))
