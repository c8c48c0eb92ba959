"""A run as JUnit XML, which every CI shows: a test case a step, one for the distance, one for the
verdict. Times are mission seconds."""

from __future__ import annotations

from xml.etree import ElementTree as Xml

from swarm_ctl.core.model.messages import Outcome
from swarm_ctl.core.model.text import agents_named, escaped
from swarm_ctl.report.judge.findings import FindingKind
from swarm_ctl.report.judge.summary import StepSummary, StepVerdict, Summary


def junit(summary: Summary) -> str:
    """The document."""
    suite = Xml.Element("testsuite", name=escaped(summary.mission or "mission"))
    for step in summary.steps:
        _step(suite, step)
    _distance(suite, summary)
    verdict = _case(suite, "verdict", summary.mission_time_s or 0.0)
    if summary.outcome is not Outcome.COMPLETED:
        _fail(verdict, f"{summary.outcome}: {summary.reason}")
    kinds = {"tests": "testcase", "failures": ".//failure", "skipped": ".//skipped"}
    for count, kind in kinds.items():
        suite.set(count, str(len(suite.findall(kind))))
    suite.set("time", f"{summary.mission_time_s or 0.0:.3f}")
    suites = Xml.Element("testsuites")
    suites.append(suite)
    Xml.indent(suites)
    text: str = Xml.tostring(suites, encoding="unicode")
    return f'<?xml version="1.0" encoding="utf-8"?>\n{text}\n'


def _step(suite: Xml.Element, step: StepSummary) -> None:
    lasted = (step.end_s or 0.0) - step.start_s if step.start_s is not None else 0.0
    group = f" of {step.group}" if step.group else ""
    case = _case(suite, f"{step.step} {step.name}{group}", max(0.0, lasted))
    if step.result is StepVerdict.SKIPPED:
        Xml.SubElement(case, "skipped", message="by the operator's next")
    elif step.result is not StepVerdict.DONE:
        agents = agents_named(sorted(step.exceptions)) if step.exceptions else "all agents"
        _fail(case, f"{step.result}: {agents}")


def _distance(suite: Xml.Element, summary: Summary) -> None:
    case = _case(suite, "distance", 0.0)
    near = [found.text for found in summary.findings if found.kind is FindingKind.TOO_CLOSE]
    if near:
        _fail(case, "; ".join(near))
    elif summary.min_distance_m is None:
        Xml.SubElement(case, "skipped", message="never two vehicles in the air, or not known")


def _case(suite: Xml.Element, name: str, seconds: float) -> Xml.Element:
    about = {"classname": suite.get("name", ""), "name": escaped(name), "time": f"{seconds:.3f}"}
    return Xml.SubElement(suite, "testcase", about)


def _fail(case: Xml.Element, why: str) -> None:
    text = escaped(why)  # XML has no control characters
    Xml.SubElement(case, "failure", message=text).text = text
