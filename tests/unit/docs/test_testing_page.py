"""The page about the `swarm` fixture lists what the fixture has, no more and no less."""

from __future__ import annotations

import inspect
import re
from dataclasses import fields
from pathlib import Path
from typing import Any

import pytest

from swarm_ctl.api.flight import FlightResult, SwarmFlight
from swarm_ctl.testing.plugin import Fly
from tests.unit.docs.pages import PAGES, blocks, saved_files

PAGE = (PAGES["testing"]).read_text()


def call(name: str, function: Any) -> str:
    """As a test writes it, with the defaults."""
    given = list(inspect.signature(function).parameters.values())[1:]
    plain = (p.name if p.default is p.empty else f"{p.name}={p.default!r}" for p in given)
    return f"{name}({', '.join(plain)})"


def public(kind: type) -> dict[str, Any]:
    return {name: value for name, value in vars(kind).items() if not name.startswith("_")}


def test_the_page_has_every_call_with_its_arguments() -> None:
    calls = {call("swarm", Fly.__call__), "flight.plan", "flight.scenario"}
    for name, value in public(SwarmFlight).items():
        called = inspect.isfunction(value)
        calls.add(call(f"flight.{name}", value) if called else f"flight.{name}")
    assert set(re.findall(r"^\| `((?:swarm|flight)[^`]*)`", PAGE, re.MULTILINE)) == calls


def test_the_page_has_every_field_of_a_result() -> None:
    names = {field.name for field in fields(FlightResult)} | {"texts"}
    assert set(re.findall(r"^\| `run\.(\w+)`", PAGE, re.MULTILINE)) == names


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
    for kind in (SwarmFlight, FlightResult):
        for name, value in public(kind).items():
            if callable(value) or isinstance(value, property):
                assert inspect.getdoc(value), name
