"""An own law, one form everywhere: a file or a package, in studies, in forecasts, in flight."""

from __future__ import annotations

import importlib
import io
import re
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from swarm_ctl import law_loader
from swarm_ctl.commands.parse import tuned
from swarm_ctl.core.model.plan import LawParameters
from swarm_ctl.core.swarm.gain_update import planned
from swarm_ctl.errors import InputError, MissionError
from swarm_ctl.law_loader import LawError, law_of, own_law, pinned
from swarm_ctl.mission.compile.forecast import Rehearsal
from swarm_ctl.mission.compile.loader import load, loads
from swarm_ctl.study.batch import batch_flight
from swarm_ctl.study.batch.batch import Batch, draw
from swarm_ctl.study.batch.batch_flight import BatchResult, fly
from swarm_ctl.study.executor import prepare
from swarm_ctl.study.parameter_space import Study
from tests.scenarios.swarm import VirtualSwarm
from tests.scenarios.test_steps import FORM, TEXT, THIRD, shape_error_m
from tests.scenarios.test_tuning import Desk

HEXAGON = Path(__file__).parents[2] / "missions" / "hexagon.yaml"
PLAIN = '''"""Consensus alone."""
from swarm_ctl.law import Annotated, Between, NamedTuple, LawTerms

MEMORY = 1


class Parameters(NamedTuple):
    rate: Annotated[float, Between(0.1, 4, "[1/s]")] = 2.0


def terms(me, others, p, memory):
    memory[0] += 1.0
    total, count = 0j, 0
    for other in others:
        if other.neighbour:
            total += other.at - other.slot - (me.at - me.slot)
            count += 1
    return LawTerms(p.rate * total / max(count, 1), 0j)
'''
LOOSE = PLAIN.replace("total, count = 0j, 0\n", 'total, count, met = 0j, 0, {"who": 0}\n').replace(
    "count += 1", 'count += 1\n            met["who"] = [count, "words"]'
)
"""The same in Python that numba does not compile."""
CALLS = """
from swarm_ctl.law import LawTerms

CALLS = []

def terms(me, others, p, memory):
    CALLS.append((me, list(others), p, len(memory)))
    return LawTerms(0j, 0j)
"""
BROKEN = """
from swarm_ctl.law import LawTerms

def terms(me, others, p, memory):
    return LawTerms(complex(float("nan"), 0.0), 0j)
"""


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Laws as files of a user."""
    found = tmp_path / "laws"
    found.mkdir()
    monkeypatch.setenv(law_loader.FOLDER_VARIABLE, str(found))
    for name, text in (("plain", PLAIN), ("loose", LOOSE), ("calls", CALLS), ("broken", BROKEN)):
        (found / f"{name}.py").write_text(text)
    return found


def batch_of(name: str, **given: float) -> Batch:
    """Two missions of six with late and lost states, for two seconds."""
    late = {"delay_s": ("0:0.1",), "loss": ("0:0.1",), "h": ("0.2",), "limit_s": 2.0}
    law = {"own": name, "parameters": given}
    return draw(Study.model_validate({**late, "law": law, "missions": 2}).cells()[0], 0, 2)


def studied(name: str, **given: float) -> BatchResult:
    return fly(batch_of(name, **given))


def test_a_forecast_a_study_and_agents_tell_a_law_the_same_rows(folder: Path) -> None:
    """Of one place of the swarm: the receiver, its neighbours with their slots, its own numbers;
    never an array, never other leading axes."""
    calls = sys.modules[str(own_law("calls").law.source.__module__)].CALLS
    mission = loads((TEXT + "  - land\n").replace("law: {", "law: {own: calls, "))
    plan = mission.plan
    starts = np.array([agent.start for agent in plan.agents])
    links = [agent.neighbours for agent in plan.agents]
    calls.clear()
    step = next(step for step in plan.groups[0].steps if getattr(step, "slots", None))
    ids = [agent.id for agent in plan.agents]
    Rehearsal(plan, ids, step, starts, links, 10.0).tick()
    forecast = calls[: len(plan.agents)]
    assert [me.id for me, *_ in forecast] == [agent.id for agent in plan.agents]
    for (me, others, p, memory), agent in zip(forecast, plan.agents, strict=True):
        assert {o.id for o in others} == {a.id for a in plan.agents} - {agent.id}
        assert {o.id for o in others if o.neighbour} == set(agent.neighbours)
        assert (p, memory) == ((), 0)
        assert me.speed == pytest.approx(plan.limits.speed_mps / plan.unit_m)
    calls.clear()
    swarm = VirtualSwarm(mission)
    swarm.wait(lambda s: s.in_step(2))
    swarm.tick()
    flown = {me.id: (me, others) for me, others, _, _ in calls}
    for me, others, _, _ in forecast:
        mine, theirs = flown[me.id]
        assert type(mine) is type(me)
        assert mine._replace(at=0j, slot=0j, flies=0j) == me._replace(at=0j, slot=0j, flies=0j)
        assert [o.id for o in theirs] == [o.id for o in others]
        assert [o.lower for o in theirs] == [o.lower for o in others]
    calls.clear()
    studied("calls")
    me, others, p, memory = calls[0]
    assert (type(me), len(others), p, memory) == (type(forecast[0][0]), 5, (), 0)
    assert all(type(other) is type(forecast[0][1][0]) for other in others)


def test_a_study_says_which_law_is_slow_and_why() -> None:
    """Of one that is compiled it says nothing."""
    pytest.importorskip("numba")
    told = io.StringIO()
    prepare(Console(file=told, width=500), LawParameters(**pinned("plain")))
    assert "plain" not in told.getvalue()
    prepare(Console(file=told, width=500), LawParameters(**pinned("loose")))
    said = told.getvalue()
    assert "law 'loose' is not compiled, so its missions take tens of times as long: " in said
    assert re.search(r"as long: No implementation of function .*setitem.* \(loose.py:\d+\)\n", said)


def test_agents_fly_it() -> None:
    """A square on the virtual clock, by a mission that names the law and a number of it; both are
    in the plan's hash."""
    text = TEXT + "  - land\n"
    named = text.replace("law: {", "law: {own: plain, ")
    mission = loads(named)
    assert mission.plan.law.own == own_law("plain").pinned
    other = loads(named.replace("own: plain, ", "own: plain, parameters: {rate: 1.5}, "))
    assert len({loads(text).plan.hash(), mission.plan.hash(), other.plan.hash()}) == 3
    swarm = VirtualSwarm(mission)
    swarm.wait(lambda s: s.in_step(THIRD))
    assert shape_error_m(swarm, FORM) < 0.6
    assert swarm.closest_m > swarm.plan.law.r_in * swarm.plan.unit_m


def test_its_numbers_are_tuned_in_flight_within_its_bounds() -> None:
    """The station refuses a value beyond them, and so do agents; all agents fly the new one."""
    desk = Desk(VirtualSwarm(loads((TEXT + "  - land\n").replace("law: {", "law: {own: plain, "))))
    desk.swarm.wait(lambda s: s.in_step(2))
    own = planned(desk.swarm.plan)
    with pytest.raises(InputError, match=r"rate 9; allowed in flight: 0.1 to 4"):
        tuned(["rate=9"], own, desk.swarm.plan)
    with pytest.raises(InputError, match=r"no value of the law; allowed: h, kappa, rate"):
        tuned(["delta_a=0.2"], own, desk.swarm.plan)
    desk.tune(name="far", own=(("rate", 9.0),))
    desk.run(4.0)
    desk.tune(name="other", own=(("speed", 1.0),))
    desk.run(4.0)
    assert len(desk.failures) == 2
    assert "rate 9; allowed in flight: 0.1 to 4" in desk.failures[0]
    assert "numbers of another law; allowed: rate" in desk.failures[1]
    desk.tune(own=tuned(["rate=1.25"], own, desk.swarm.plan).own)
    desk.run(4.0)
    assert len(desk.failures) == 2
    for member in desk.swarm.members.values():
        assert member.agent._controller.gains.own == (("rate", 1.25),)
        assert member.agent._controller._numbers == (1.25,)


@pytest.mark.parametrize(
    ("fields_", "said"),
    [
        ("own: plane", r"law\.own: law 'plane' is not .*allowed: paper, .*leader.*plain"),
        ("own: plain, parameters: {speed: 1}", r"law\.parameters: .*unknown.* speed; .*: rate"),
        ("own: plain, parameters: {rate: 9}", r"law\.parameters: .*rate 9.*allowed: 0\.1 to 4"),
        ("parameters: {rate: 1}", r"law\.parameters: .*unknown parameter rate; allowed: none"),
    ],
)
def test_what_no_law_takes_is_refused_with_its_place(fields_: str, said: str) -> None:
    with pytest.raises(MissionError, match=said):
        loads((TEXT + "  - land\n").replace("law: {", f"law: {{{fields_}, "))


def test_other_code_under_the_same_name_is_refused(folder: Path) -> None:
    """An agent whose computer has another source than the plan's does not start."""
    planned = LawParameters(**pinned("plain"))
    assert law_of(planned)
    (folder / "plain.py").write_text(PLAIN.replace("2.0", "2.1"))
    with pytest.raises(InputError, match="the same source on each computer"):
        law_of(planned)
    with pytest.raises(InputError, match="the same source"):
        VirtualSwarm(replace(load(HEXAGON), plan=replace(load(HEXAGON).plan, law=planned)))


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("def law(me): pass\n", "has no function terms; allowed: def terms"),
        ("def terms(me, others): pass\n", r"terms\(me, others\) does not take four values"),
        (PLAIN.replace("MEMORY = 1", "MEMORY = 0.5"), "MEMORY is 0.5; allowed: a whole number"),
        (PLAIN.replace(" = 2.0", ""), "parameter rate has no default in 0.1 to 4"),
        (PLAIN.replace(" = 2.0", " = 9"), "parameter rate has no default in 0.1 to 4"),
        (PLAIN.replace("rate:", "kappa:"), "parameter kappa has a name that `tune` needs"),
        (PLAIN.replace("(NamedTuple)", ""), "Parameters is no NamedTuple"),
        ("import nowhere\n", r"No module named 'nowhere' \(odd.py:1\)"),
    ],
)
def test_a_module_that_is_no_law_is_refused(folder: Path, text: str, said: str) -> None:
    (folder / "odd.py").write_text(text)
    with pytest.raises(InputError, match=f"law 'odd' .*{said}"):
        own_law("odd")


def test_a_package_offers_one_too(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """By an entry point. A name that is there twice is nobody's."""
    (tmp_path / "packaged_law.py").write_text(PLAIN)
    about = tmp_path / "packaged_law-1.0.dist-info"
    about.mkdir()
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: packaged-law\nVersion: 1.0\n")
    (about / "entry_points.txt").write_text(
        "[swarm_ctl.laws]\npackaged = packaged_law\nplain = packaged_law\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    importlib.invalidate_caches()
    assert own_law("packaged").where == "packaged_law"
    with pytest.raises(InputError, match=r"is there more than once: packaged_law and .*plain.py"):
        own_law("plain")
    sys.modules.pop("packaged_law", None)


@pytest.mark.parametrize("compiles", [True, False])
def test_a_law_that_gives_no_numbers_ends_its_flight(
    compiles: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """NaN never becomes a setpoint."""
    if not compiles:
        monkeypatch.setattr(batch_flight, "interpreted", lambda _: True)
    with pytest.raises(LawError, match="law 'broken' gave"):
        studied("broken")


def test_what_its_author_did_not_foresee_is_told_with_its_line(folder: Path) -> None:
    (folder / "odd.py").write_text(PLAIN.replace("max(count, 1)", "count"))
    law = own_law("odd").law
    me = (1, 0j, 0j, 0j, 1.0, 0.05, 1.0, 4.5, 1.5, 0.5)
    with pytest.raises(LawError, match=r"law 'odd': ZeroDivisionError: .*\(odd.py:\d+\)"):
        law.form(batch_flight.flight.Me(*me), [], law.numbers(), [0.0], [])
    (folder / "odd.py").write_text(PLAIN.replace("0j)\n", "1e300)\n"))
    with pytest.raises(LawError, match="at most 1e\\+06 units/s"):
        own_law("odd").law.form(batch_flight.flight.Me(*me), [], law.numbers(), [0.0], [])
