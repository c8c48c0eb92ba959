"""Autopilots are found by option, environment variable and PATH; else the error says where to get
them."""

from __future__ import annotations

from pathlib import Path

import pytest

from swarm_ctl.core.model.fleet import VehicleKind
from swarm_ctl.engine.vehicles.binaries import VARIABLES, find
from swarm_ctl.engine.vehicles.containers import ENGINE_VARIABLE, Image
from swarm_ctl.errors import StartError

ARDUCOPTER, PX4 = VehicleKind.ARDUCOPTER, VehicleKind.PX4


@pytest.fixture(autouse=True)
def bare(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    for variable in (*VARIABLES.values(), ENGINE_VARIABLE):
        monkeypatch.delenv(variable, raising=False)
    monkeypatch.setenv("PATH", str(tmp_path / "path"))


def _program(path: Path) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.touch(0o755)
    return path


def _px4(folder: Path) -> Path:
    _program(folder / "bin" / "px4")
    (folder / "etc").mkdir()
    return folder


def test_the_option_wins_over_the_variable_and_that_over_the_path(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    names = ("path/arducopter", "variable", "option")
    on_path, variable, option = (_program(tmp_path / name) for name in names)
    assert find(ARDUCOPTER) == on_path
    monkeypatch.setenv("SWARM_CTL_ARDUCOPTER", str(variable))
    assert find(ARDUCOPTER) == variable
    assert find(ARDUCOPTER, str(option)) == option


@pytest.mark.parametrize("named", [".", "bin/px4"])
def test_px4_is_a_folder_or_the_binary_in_it(tmp_path: Path, named: str) -> None:
    folder = _px4(tmp_path / "px4")
    assert find(PX4, str(folder / named)) == folder


def test_px4_may_be_a_source_tree_that_was_built(tmp_path: Path) -> None:
    folder = _px4(tmp_path / "build" / "px4_sitl_default")
    assert find(PX4, str(tmp_path)) == folder


@pytest.mark.parametrize("kind", [ARDUCOPTER, PX4])
@pytest.mark.parametrize("given", [None, "missing"])
def test_a_missing_autopilot_is_an_error_of_exit_code_3_that_says_where_to_get_one(
    kind: VehicleKind, given: str | None
) -> None:
    with pytest.raises(StartError, match="https://github") as caught:
        find(kind, given)
    assert f"--{kind}" in str(caught.value)
    assert caught.value.exit_code == 3


def _engine(path: Path) -> Path:
    """It has the image `copter` alone."""
    wanted = '[ "$*" = "image inspect copter" ]'
    _program(path).write_text(f'#!/bin/sh\n{wanted} || {{ echo "no $3" >&2; exit 9; }}\n')
    return path


def test_a_container_is_run_by_podman_else_docker_else_what_the_variable_names(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    docker = _engine(tmp_path / "path" / "docker")
    assert find(ARDUCOPTER, "container:copter") == Image(str(docker), "copter")
    podman = _engine(tmp_path / "path" / "podman")
    monkeypatch.setenv("SWARM_CTL_ARDUCOPTER", "container:copter")
    assert find(ARDUCOPTER) == Image(str(podman), "copter")
    monkeypatch.setenv("SWARM_CTL_CONTAINER_ENGINE", "docker")
    assert find(ARDUCOPTER) == Image(str(docker), "copter")


@pytest.mark.parametrize(
    ("kind", "variable", "why"),
    [
        (ARDUCOPTER, "", "podman can't run the image 'other': no other; allowed: an image of `/"),
        (ARDUCOPTER, "nerdctl", "no program nerdctl .*; allowed: one of them on the PATH"),
        (PX4, "", "only arducopter is started in a container; allowed: a path, or a fleet"),
    ],
)
def test_a_container_that_cannot_be_started_is_refused_with_what_is_allowed(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, kind: VehicleKind, variable: str, why: str
) -> None:
    _engine(tmp_path / "path" / "podman")
    monkeypatch.setenv("SWARM_CTL_CONTAINER_ENGINE", variable)
    with pytest.raises(StartError, match=why) as caught:
        find(kind, "container:other")
    assert str(caught.value).startswith(f"--{kind} container:other: ")
    assert caught.value.exit_code == 3


def test_a_container_without_an_engine_is_refused() -> None:
    with pytest.raises(StartError, match="no podman, no docker; allowed: one of them on the PATH"):
        find(ARDUCOPTER, "container:copter")
