"""`swarm_ctl.__version__` and the change log tell the same versions."""

from __future__ import annotations

import re
import tomllib
from importlib import metadata
from pathlib import Path

import pytest

import swarm_ctl

ROOT = Path(__file__).parents[3]


def test_the_version_is_the_installed_package_s() -> None:
    assert swarm_ctl.__version__ == metadata.version("swarm-ctl")


def test_a_source_tree_that_is_not_installed_has_a_version(monkeypatch: pytest.MonkeyPatch) -> None:
    def missing(name: str) -> str:
        raise metadata.PackageNotFoundError(name)

    monkeypatch.setattr(metadata, "version", missing)
    assert swarm_ctl.__version__ == "0+unknown"


def test_other_names_are_not_there() -> None:
    with pytest.raises(AttributeError, match="no attribute 'other'"):
        swarm_ctl.other  # type: ignore[attr-defined]  # noqa: B018


def test_the_change_log_begins_with_this_version() -> None:
    """Semantic versions, the newest first, each with sections of Keep a Changelog."""
    text = (ROOT / "CHANGELOG.md").read_text()
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    versions = re.findall(r"^## \[(.+?)\]", text, re.MULTILINE)
    assert versions[:2] == ["Unreleased", project["version"]]
    assert all(re.fullmatch(r"\d+\.\d+\.\d+", version) for version in versions[1:])
    sections = set(re.findall(r"^### (.+)$", text, re.MULTILINE))
    assert sections <= {"Added", "Changed", "Deprecated", "Removed", "Fixed", "Security"}
