"""A run as JUnit XML."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree as Xml

from swarm_ctl.core.model.messages import Outcome
from swarm_ctl.report.judge.findings import FindingKind
from swarm_ctl.report.judge.summarise import summarise
from swarm_ctl.report.judge.summary import FindingSummary, StepVerdict, Summary
from swarm_ctl.report.page.junit import junit
from tests.unit.report.run_folders import EXIT_CODES, write_run


def suite_of(summary: Summary) -> Xml.Element:
    (suite,) = Xml.fromstring(junit(summary).encode())  # noqa: S314 - our own
    return suite


def failures(suite: Xml.Element) -> dict[str, str]:
    """The message of each case that failed."""
    return {
        case.attrib["name"]: failure.attrib["message"]
        for case in suite
        for failure in case.findall("failure")
    }


def test_a_good_run_is_a_case_a_step_and_two_more(tmp_path: Path) -> None:
    """None fails; the times are the steps' own."""
    suite = suite_of(summarise(write_run(tmp_path), EXIT_CODES))
    names = ["0 prepare", "1 takeoff", "2 form hexagon", "3 hold", "4 land", "distance", "verdict"]
    assert [case.attrib["name"] for case in suite] == names
    assert suite.attrib["failures"] == "0"
    assert suite.attrib["tests"] == "7"
    assert [float(case.attrib["time"]) for case in suite][3] == 10.0


def test_what_failed_fails_in_its_place(tmp_path: Path) -> None:
    """A step that ran out of time with its agents, a pair under r_in, the verdict with its
    reason."""
    good = summarise(write_run(tmp_path), EXIT_CODES)
    bad = good.steps[2].model_copy(
        update={"result": StepVerdict.TIMEOUT, "exceptions": {3: StepVerdict.TIMEOUT}}
    )
    near = FindingSummary(
        kind=FindingKind.TOO_CLOSE, time_s=30.0, agents=(1, 2), text="agents 1-2 <near>"
    )
    steps = (*good.steps[:2], bad, *good.steps[3:])
    changes = {"steps": steps, "findings": (near,), "outcome": Outcome.FAILED, "reason": "late"}
    suite = suite_of(good.model_copy(update=changes))
    assert suite.attrib["failures"] == "3"
    assert failures(suite) == {
        "2 form hexagon": "timeout: agent 3",
        "distance": "agents 1-2 <near>",
        "verdict": "failed: late",
    }
