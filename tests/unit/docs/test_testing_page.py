"""The examples on the page about the `swarm` fixture fly; each of its calls says what it does."""

from __future__ import annotations

import inspect
from pathlib import Path
from typing import Any

import pytest

from swarm_ctl.api.flight import FlightResult, SwarmFlight
from swarm_ctl.api.swarm import Swarm
from swarm_ctl.testing.plugin import Fly
from tests.unit.docs.api_reference import fields
from tests.unit.docs.pages import PAGES, blocks, saved_files


def public(kind: type) -> dict[str, Any]:
    return {name: value for name, value in vars(kind).items() if not name.startswith("_")}


def test_the_example_of_the_page_passes(
    swarm: Fly, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With the mission of the tutorial."""
    monkeypatch.chdir(tmp_path)
    Path("patrol.yaml").write_text(saved_files(PAGES["tutorial"])["patrol.yaml"])
    written: dict[str, Any] = {}
    exec(blocks(PAGES["testing"])[0].text, written)  # noqa: S102 (the page is ours)
    (test,) = (value for name, value in written.items() if name.startswith("test_"))
    test(swarm)


def test_the_scenario_of_the_page_flies(
    swarm: Fly, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With the mission of the tutorial."""
    monkeypatch.chdir(tmp_path)
    Path("patrol.yaml").write_text(saved_files(PAGES["tutorial"])["patrol.yaml"])
    Path("rough.yaml").write_text(saved_files(PAGES["testing"])["rough.yaml"])
    (text,) = (b.text for b in blocks(PAGES["testing"]) if "rough.yaml" in b.text)
    written: dict[str, Any] = {}
    exec(text, written)  # noqa: S102 (the page is ours)
    written["test_a_rough_flight_ends_on_the_ground"](swarm)


def test_every_call_and_field_has_a_docstring() -> None:
    assert [name for name, said in fields(FlightResult) if not said] == []
    for kind in (SwarmFlight, FlightResult, Swarm):
        for name, value in public(kind).items():
            if callable(value) or isinstance(value, property):
                assert inspect.getdoc(value), name
