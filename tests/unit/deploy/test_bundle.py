"""What goes to a host, and what does not."""

from __future__ import annotations

import io
import json
import shutil
import subprocess
import tarfile
from dataclasses import replace
from pathlib import Path

import pytest

from swarm_ctl.archives import packed
from swarm_ctl.core.model.fleet import Fleet, RadioShare
from swarm_ctl.deploy.bundle import Bundle, bundles_of, own_routers, unpacked
from swarm_ctl.deploy.logs import pack_logs, unpack_logs
from swarm_ctl.deploy.services import units_of
from swarm_ctl.errors import InputError
from swarm_ctl.trust.bundle import unpacked as unpacked_keys
from tests.unit.deploy.swarms import fleet, keys, plan, whole_hash


def test_keys_go_to_their_owners_host_alone(tmp_path: Path) -> None:
    """No host has the CA's key, another agent's, or an operator's."""
    trust = keys(tmp_path / "outdoors")
    made = bundles_of(plan(), fleet(trust))
    secrets = {p: p.read_bytes() for p in trust.rglob("*.key")}
    assert len(secrets) == 8  # the CA's, the operator's, and two of each agent
    for bundle in made.values():
        whole = bundle.packed()
        there = {path.parent.name for path, secret in secrets.items() if secret in whole}
        assert there == {f"agent-{i}" for i in bundle.manifest.agents}
        for i in bundle.manifest.agents:
            path = tmp_path / "one.bundle"
            path.write_bytes(bundle.files[f"agent-{i}.bundle"])
            assert unpacked_keys(path)[0].name == str(i)
        assert str(trust).encode() not in whole
        with tarfile.open(fileobj=io.BytesIO(whole)) as archive:
            assert {entry.mode for entry in archive} == {0o600}


def test_the_digest_is_that_of_the_contents() -> None:
    first, again = (bundles_of(plan(), fleet())["drone1"] for _ in range(2))
    assert first.digest == again.digest == unpacked(first.packed()).digest
    assert first.packed() == again.packed()
    other = bundles_of(plan(), fleet(endpoint="serial:/dev/ttyACM0"))["drone1"]
    assert other.digest != first.digest


@pytest.mark.parametrize("missing", ["host", "endpoint", "mesh"])
def test_an_agent_without_a_place_is_refused(missing: str) -> None:
    first, *others = fleet().agents
    with pytest.raises(InputError, match=f"agent 1 has no `{missing}`"):
        bundles_of(plan(), Fleet((replace(first, **{missing: None}), *others)))


def test_a_router_runs_where_it_serves_one_host_or_has_its_name() -> None:
    def routed(*at: str) -> dict[str, str]:
        agents = (replace(a, router=r) for a, r in zip(fleet().agents, at, strict=True))
        return own_routers(Fleet(tuple(agents)))

    one, two = "tcp/10.0.0.1:7447", "tcp/10.0.0.2:7447"
    assert routed(one, one, two) == {"drone1": one, "drone2": two}
    assert routed(one, one, one) == {}, "of another computer, such as the ground's"
    named = "tcp/drone2:7447"
    assert routed(named, named, named) == {"drone2": named}


def changed(bundle: Bundle, **files: bytes | None) -> bytes:
    names = {
        "plan": "plan.json",
        "manifest": "manifest.json",
        "evil": "../../evil",
        "unit": "swarm-ctl-agent@.service",
        "keys": "agent-9.bundle",
    }
    data = {**bundle.files, **{names[name]: content for name, content in files.items()}}
    return Bundle(bundle.manifest, {n: d for n, d in data.items() if d is not None}).packed()


def test_a_bundle_that_does_not_fit_itself_is_refused() -> None:
    """Another name, another plan, a torn file, a manifest that would say more in a unit."""
    bundle = bundles_of(plan(), fleet())["drone1"]
    evil = bundle.files["manifest.json"].replace(b'"example"', b'"a b; c"')
    other = bundle.files["manifest.json"].replace(whole_hash().encode(), b"0" * 16)
    for data in (
        changed(bundle, evil=b"x"),
        changed(bundle, unit=b"[Service]\nExecStartPre=/bin/sh\n"),
        changed(bundle, keys=b"x"),
        changed(bundle, plan=None),
        changed(bundle, plan=bundle.files["plan.json"][:-9]),
        changed(bundle, manifest=other),
        changed(bundle, manifest=evil.replace(b"trio", b"tr io")),
        bundle.packed()[:700],
        b"",
    ):
        with pytest.raises(InputError):
            unpacked(data)


@pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="needs systemd-analyze")
def test_systemd_understands_the_units(tmp_path: Path) -> None:
    """`systemd-analyze verify` finds nothing, of a host with a router and keys."""
    agents = tuple(
        replace(a, router=f"tls/10.0.0.{1 + (a.id == 3)}:7447", mesh=None) for a in fleet().agents
    )
    bundle = bundles_of(plan(), Fleet(agents))["drone1"]
    program = tmp_path / ".local/share/swarm-ctl/host/bin/swarm-ctl"
    program.parent.mkdir(parents=True)
    program.write_text("#!/bin/sh\n")
    program.chmod(0o755)
    units = units_of(bundle.manifest)
    assert len(units) == 2
    for name, text in units.items():
        (tmp_path / name.replace("@", "@1")).write_text(text.replace("%h", str(tmp_path)))
    done = subprocess.run(
        [
            "/usr/bin/env",
            "systemd-analyze",
            "verify",
            "--man=no",
            *(str(p) for p in tmp_path.glob("*.service")),
        ],
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.returncode, done.stderr) == (0, "")


def test_logs_come_back_and_nothing_else(tmp_path: Path) -> None:
    flight = tmp_path / "20260101-120000"
    flight.mkdir()
    for name in ("agent-1.log", "agent-1.tlog", "router.log"):
        (flight / name).write_text(name)
    (flight / "agent-2.log").symlink_to("/etc/passwd")
    out = io.BytesIO()
    pack_logs([flight], out)
    out.seek(0)
    found = unpack_logs(out, tmp_path / "drone1")
    assert [path.name for path in found] == ["agent-1.log", "agent-1.tlog", "router.log"]
    assert [path.read_text() for path in found] == [path.name for path in found]
    evil = io.BytesIO(packed([("../evil.log", b"")]))
    with pytest.raises(InputError, match=r"sent '\.\./evil.log'"):
        unpack_logs(evil, tmp_path / "drone1")


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("swarm", "a\nExecStartPre=/bin/sh"),
        ("swarm", "a b"),
        ("router", "tcp/10.0.0.1:7447 --zenoh-config /tmp/evil"),
        ("router", "tcp/10.0.0.1:7447#iface=%h"),
        ("router", "tcp/10.0.0.$HOME:7447"),
        ("router", "tcp/\u0661:7447"),
        ("router_keys", "router-1/../../agent-1"),
        ("trust", "../outdoors"),
        ("trust", "outdoors\n"),
        ("agents", ["1 --open-mesh"]),
        ("agents", [-1]),
        ("agents", ["1"]),
        ("agents", [1, 3]),
        ("agents", [1, 1]),
        ("endpoints", ["serial:/dev/ttyACM9", "serial:/dev/ttyACM9"]),
        ("host", "-oProxyCommand=x"),
        ("open_mesh", "true"),
        ("environment", {"LD_PRELOAD": "evil.so"}),
        ("swarm_ctl", "0.2.0\n[Service]"),
    ],
)
def test_no_word_of_a_manifest_means_more_in_a_unit(field: str, value: object) -> None:
    """Each would be a line, an option, a specifier, a variable, or a path elsewhere."""
    bundle = bundles_of(plan(), fleet())["drone1"]
    manifest = json.loads(bundle.files["manifest.json"]) | {field: value}
    with pytest.raises(InputError, match="bundle"):
        unpacked(changed(bundle, manifest=json.dumps(manifest).encode()))


def test_a_bundles_plan_names_no_folder_of_keys() -> None:
    """The host's own are where the manifest says."""
    bundle = bundles_of(plan(), fleet())["drone1"]
    file = json.loads(bundle.files["plan.json"]) | {"trust": "evil"}
    with pytest.raises(InputError, match="its plan names a folder of keys"):
        unpacked(changed(bundle, plan=json.dumps(file).encode()))


def test_a_shared_radio_is_not_deployed() -> None:
    """Its link would be missing, and two agents would open one port."""
    first, *others = fleet().agents
    shared = replace(first, radio=RadioShare("serial:/dev/ttyUSB0:57600", 5760, 2))
    with pytest.raises(InputError, match="agent 1 shares a radio"):
        bundles_of(plan(), Fleet((shared, *others)))
