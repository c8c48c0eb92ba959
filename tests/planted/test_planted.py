"""Each fault can be planted into this tree; `python -m tests.planted` flies them, in hours."""

from __future__ import annotations

import ast
import re

import pytest

from tests.planted import __main__ as planted
from tests.planted.faults import FAULTS, Fault


@pytest.mark.parametrize("fault", FAULTS, ids=[fault.name for fault in FAULTS])
def test_a_fault_changes_its_file(fault: Fault) -> None:
    """Its text stands there once, and what it becomes is Python."""
    source = (planted.ROOT / fault.path).read_text(encoding="utf-8")
    assert source.count(fault.was) == 1, f"{fault.path} was changed: change {fault.name} as well"
    ast.parse(source.replace(fault.was, fault.becomes))
    assert fault.was != fault.becomes
    re.compile(fault.meets)


def test_faults_have_names_of_their_own() -> None:
    assert len({fault.name for fault in FAULTS}) == len(FAULTS) == 29
    parts = {fault.name.split("-")[0] for fault in FAULTS}
    assert parts >= {"barrier", "landing", "filter", "failsafe", "verdict", "link", "keeper"}


def test_what_is_no_fault_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert planted.main(["filter-twice"]) == 2
    assert "filter-twice; allowed: barrier-begun, " in capsys.readouterr().err
    assert planted.main(["--flights", "0"]) == 2
