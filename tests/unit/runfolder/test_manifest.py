"""`run.json`: what was written is read again, and nothing else is."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from pydantic import ValidationError

from swarm_ctl.errors import InputError
from swarm_ctl.runfolder.manifest import read_manifest, write_manifest
from tests.unit.report.run_folders import PLAN, SYSIDS, manifest


def test_the_manifest_comes_back_as_it_was(tmp_path: Path) -> None:
    write_manifest(tmp_path, manifest())
    assert read_manifest(tmp_path) == manifest()
    assert [path.name for path in tmp_path.iterdir()] == ["run.json"]
    assert manifest().agent_of_sysid == dict(zip(SYSIDS, range(1, 7), strict=True))


def test_the_manifests_hash_is_the_plans(tmp_path: Path) -> None:
    assert int(manifest().plan_hash, 16) == PLAN.hash()
    with pytest.raises(ValidationError, match="plan_hash"):
        manifest(plan_hash="0" * 16)
    write_manifest(tmp_path, manifest())
    path = tmp_path / "run.json"
    path.write_text(path.read_text().replace('"tolerance_m": 0.5', '"tolerance_m": 0.6'))
    with pytest.raises(InputError, match=r"run\.json.*plan_hash"):
        read_manifest(tmp_path)


@pytest.mark.parametrize(
    "change", [{"speedup": 0.0}, {"started_at": "yesterday"}, {"surplus": 1}, {"schema_version": 1}]
)
def test_a_mistaken_manifest_is_refused(change: dict[str, Any]) -> None:
    with pytest.raises(ValidationError, match=next(iter(change))):
        manifest(**change)


def test_a_run_of_another_version_is_told_by_that_alone(tmp_path: Path) -> None:
    """Other fields may be right there: the plan of version 1 had no shapes."""
    write_manifest(tmp_path, manifest())
    path = tmp_path / "run.json"
    told = json.loads(path.read_text())
    del told["plan"]["shapes"]
    path.write_text(json.dumps(told | {"schema_version": 1}))
    with pytest.raises(InputError) as caught:
        read_manifest(tmp_path)
    assert str(caught.value) == (
        f"{path}: schema_version: 1 is of another version of swarm-ctl; allowed: 3, or the"
        " swarm-ctl that wrote it"
    )


def test_a_missing_manifest_says_so(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"run\.json: No such file"):
        read_manifest(tmp_path)


def test_a_torn_manifest_is_refused(tmp_path: Path) -> None:
    write_manifest(tmp_path, manifest())
    path = tmp_path / "run.json"
    whole = path.read_bytes()
    for length in range(0, len(whole) - 2, 97):
        path.write_bytes(whole[:length])
        with pytest.raises(InputError, match=r"run\.json"):
            read_manifest(tmp_path)
