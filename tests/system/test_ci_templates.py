"""The templates for the users' CI do what they say: their own scripts, run as a CI runs them."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

import pytest
import yaml
from packaging.requirements import Requirement

ROOT = Path(__file__).parents[2]
ACTION = yaml.safe_load((ROOT / ".github/actions/fly/action.yml").read_text())
JOB = yaml.safe_load((ROOT / ".gitlab/fly.yml").read_text())[".swarm-fly"]
FLY = next(step for step in ACTION["runs"]["steps"] if step["name"] == "Fly")


def _run(script: str, where: Path, **env: str) -> subprocess.CompletedProcess[str]:
    path = f"{Path(sys.executable).parent}:{os.environ['PATH']}"
    return subprocess.run(
        ["/bin/bash", "-e", "-o", "pipefail", "-c", script],
        cwd=where,
        env={**os.environ, "PATH": path, **env},
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )


@pytest.mark.lockstep
def test_the_action_flies_and_keeps_summary_and_junit(tmp_path: Path) -> None:
    summary = tmp_path / "step-summary.md"
    mission = str(ROOT / "tests" / "system" / "low.yaml")
    arguments = {"MISSION": mission, "ARGUMENTS": "--seed 7 --no-report", "FOLDER": "my own/run"}
    output = tmp_path / "output"
    paths = {"GITHUB_STEP_SUMMARY": str(summary), "GITHUB_OUTPUT": str(output)}
    ended = _run(FLY["run"], tmp_path, **paths, **arguments)
    assert ended.returncode == 0, ended.stdout
    cases = ElementTree.parse(tmp_path / "my own/run" / "junit.xml").findall(".//testcase")  # noqa: S314 - ours
    assert cases
    assert "COMPLETED" in summary.read_text()
    assert output.read_text() == "artifact=my own-run\n"
    assert list((tmp_path / "my own/run" / "runs").glob("*/summary.json"))


def test_a_mission_with_a_mistake_fails_the_action(tmp_path: Path) -> None:
    (tmp_path / "mine.yaml").write_text("version: 1\n")
    arguments = {"MISSION": "mine.yaml", "ARGUMENTS": "", "FOLDER": "flown"}
    summary = tmp_path / "summary"
    paths = {"GITHUB_STEP_SUMMARY": str(summary), "GITHUB_OUTPUT": str(tmp_path / "output")}
    ended = _run(FLY["run"], tmp_path, **paths, **arguments)
    assert ended.returncode == 2
    assert "mine.yaml:1: name: is missing" in summary.read_text()


def test_the_gitlab_job_gives_the_same_command() -> None:
    """Up to where its own words are: install, folder, flight."""
    flight = " ".join(FLY["run"].replace("\\\n", " ").split())
    command = JOB["script"][-1]
    assert command in flight
    assert JOB["artifacts"]["reports"]["junit"] == "$FOLDER/junit.xml"
    assert set(JOB["variables"]) == {"PACKAGE", "MISSION", "ARGUMENTS", "FOLDER"}


def test_the_gitlab_job_of_the_page_says_where_the_package_is() -> None:
    """In the user's own project `.[ground]` is the user's, or nothing. Git fetches it."""
    page = (ROOT / "docs" / "do" / "testing.md").read_text()
    (block,) = (b for b in page.split("```") if b.startswith("yaml\n# GitLab\n"))
    package = yaml.safe_load(block.removeprefix("yaml"))["patrol"]["variables"]["PACKAGE"]
    assert Requirement(package).extras == {"ground"}
    assert "git+" in package
    assert "slim" not in JOB["image"]


def test_the_project_runs_its_own_ci() -> None:
    jobs = yaml.safe_load((ROOT / ".github/workflows/tests.yml").read_text())["jobs"]
    assert {"run": ".ci/run"} in jobs["tests"]["steps"]
    assert jobs["mission"]["steps"][-1]["uses"] == "./.github/actions/fly"
