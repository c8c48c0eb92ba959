"""`swarm_ctl.fly`, as programs use it: the page's table, the examples, refusals, and the end."""

from __future__ import annotations

import asyncio
import contextlib
import inspect
import json
import keyword
import math
import re
import runpy
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

import swarm_ctl
from swarm_ctl.api.flight import FlightError
from swarm_ctl.api.swarm import AsyncSwarm, OrderError, Swarm
from swarm_ctl.api.virtual_flight import VirtualFlight
from swarm_ctl.cli.shared.options import runs_in
from swarm_ctl.commands.parse import BY_NAME
from swarm_ctl.core.model.steps.move import MoveStep
from swarm_ctl.engine.flying_runs import flying_run
from swarm_ctl.engine.station.ground_station import swarm_now
from swarm_ctl.errors import InputError, StartError
from tests.system.pair import BARE
from tests.unit.docs.pages import PAGES

ROOT = Path(__file__).parents[2]
EXAMPLES = sorted((ROOT / "examples").glob("*.py"))


def _public(kind: type) -> set[str]:
    return {name for name in vars(kind) if not name.startswith("_")}


def test_both_swarms_have_the_same_calls_and_the_page_has_each() -> None:
    assert _public(Swarm) - {"now"} == _public(AsyncSwarm) - {"leave"}
    for name in _public(AsyncSwarm) - {"leave", "plan"}:
        one, other = (inspect.signature(getattr(kind, name)) for kind in (Swarm, AsyncSwarm))
        assert one.parameters == other.parameters, name
    page = PAGES["python-calls"].read_text()
    told = set(re.findall(r"`swarm\.(\w+)", page))
    assert told == _public(Swarm) | {"flight"}


@pytest.mark.parametrize("example", EXAMPLES, ids=lambda path: path.stem)
def test_an_example_runs(
    example: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "argv", [example.name, "virtual"])
    runpy.run_path(str(example), run_name="__main__")
    assert re.search(r"\d\.\d\d m", capsys.readouterr().out)


@pytest.mark.filterwarnings("ignore:.*")  # of the notebook's own tools
def test_the_notebook_runs_and_keeps_no_outputs() -> None:
    """With its plots, in a kernel of its own."""
    nbclient = pytest.importorskip("nbclient", reason="pip install 'swarm-ctl[notebook]'")
    import nbformat

    notebook = nbformat.read(ROOT / "examples" / "sigma.ipynb", 4)
    code = [cell for cell in notebook.cells if cell.cell_type == "code"]
    assert [cell.outputs for cell in code] == [[]] * len(code)
    nbclient.NotebookClient(notebook, timeout=120).execute()
    _, flown, plotted = code
    assert "'completed'" in flown.outputs[0].data["text/plain"]
    assert any("image/png" in output.get("data", {}) for output in plotted.outputs)


def test_the_public_names_are_there_at_the_top() -> None:
    names = {name: getattr(swarm_ctl, name) for name in ("fly", "Swarm", "AsyncSwarm")}
    names |= {"FlightError": swarm_ctl.FlightError, "OrderError": swarm_ctl.OrderError}
    assert names["OrderError"] is OrderError
    assert set(swarm_ctl.__all__) == {*names, "FlightResult"}  # type: ignore[attr-defined]
    assert names.keys() <= set(dir(swarm_ctl))
    with pytest.raises(AttributeError, match="no attribute 'jump'"):
        swarm_ctl.jump  # type: ignore[attr-defined]  # noqa: B018


def test_a_refused_order_raises_and_the_flight_goes_on() -> None:
    with swarm_ctl.fly(BARE, vehicles="virtual") as swarm:
        with pytest.raises(
            OrderError, match=r"move: agents 1-2: refused: there is no formation"
        ) as refused:
            swarm.move(9000, 0)
        assert set(refused.value.sent.reasons) == {1, 2}
        with pytest.raises(InputError, match="no command 'jump'"):
            swarm.send("jump")
        with pytest.raises(ValueError, match="no agent 7"):
            swarm.hold(7)
        for every_s in (0.0, -1.0, math.nan):  # mission time would stand still
            with pytest.raises(InputError, match="allowed: over 0 s"):
                next(swarm.views(every_s))
        with pytest.raises(FlightError, match=r"was not reached within 0\.5 s"):
            swarm.step("land", within_s=0.5)
        swarm.step("takeoff")
        assert [agent.id for agent in swarm.view().agents if agent.airborne] == []
        result = swarm.finish()
    assert set(result.outcomes.values()) == {"completed"}


def test_a_task_that_waits_keeps_no_other_from_commanding() -> None:
    async def flown() -> tuple[list[int], set[str]]:
        steps: list[int] = []
        async with swarm_ctl.fly(BARE, vehicles="virtual") as swarm:

            async def watch() -> None:
                steps.extend([view.step async for view in swarm.views(every_s=1.0)])

            watching = asyncio.create_task(watch())
            await swarm.step("form pair")
            assert (await swarm.hold(1, 2)).accepted
            assert (await swarm.land()).accepted
            result = await swarm.finish()
            await watching
        return steps, set(result.outcomes.values())

    steps, outcomes = asyncio.run(flown())
    assert steps == sorted(steps)
    assert {0, 2} <= set(steps)
    assert outcomes == {"aborted"}


def test_orders_have_the_shell_s_names_and_an_earlier_name_says_the_new_one() -> None:
    """`return` alone is a word that no Python name may be."""
    orders = set(BY_NAME) - {"kill", "expel", "readmit"}  # by `send`
    assert {f"{name}_" if keyword.iskeyword(name) else name for name in orders} <= _public(Swarm)
    for swarm in (Swarm, AsyncSwarm):
        bare = object.__new__(swarm)
        with pytest.raises(AttributeError, match=r"'send_home'; it is called return_\(\*agents\)$"):
            bare.send_home  # type: ignore[attr-defined]  # noqa: B018
        with pytest.raises(AttributeError, match=r"'land_only'; it is called land\(\*agents\)$"):
            bare.land_only  # type: ignore[attr-defined]  # noqa: B018
        with pytest.raises(AttributeError, match=r"Swarm' object has no attribute 'jump'$"):
            bare.jump  # type: ignore[attr-defined]  # noqa: B018


def test_one_lands_and_the_others_return() -> None:
    with swarm_ctl.fly(BARE, vehicles="virtual") as swarm:
        swarm.step("form pair")
        there, on = (swarm.move(8.0, 3.0, by=by).command.step for by in (False, True))
        assert isinstance(there, MoveStep)
        assert isinstance(on, MoveStep)
        assert there.waypoints_m[-1] == (8.0, 3.0) != on.waypoints_m[-1]
        assert swarm.land(1).acks[1].accepted
        assert swarm.return_(2).acks[2].accepted
        assert swarm.finish().all_down


@pytest.mark.parametrize(
    "given",
    [{"speedup": 0}, {"speedup": "fast"}, {"seed": -1}, {"seed": 0.5}, {"vehicles": "boat"}],
)
def test_what_is_out_of_bounds_is_refused_before_anything_starts(given: dict[str, Any]) -> None:
    """By its name, with what is allowed."""
    ((name, value),) = given.items()
    with pytest.raises(InputError, match=rf"{name}={re.escape(repr(value))}.*; allowed: "):
        swarm_ctl.fly(BARE, **given)


def test_the_end_of_the_block_lands() -> None:
    with contextlib.suppress(ZeroDivisionError), swarm_ctl.fly(BARE, vehicles="virtual") as swarm:
        swarm.step("form pair")
        assert len(swarm.view().agents) == 2
        raise ZeroDivisionError  # a program's mistake, in the air
    assert swarm.finish().all_down


@pytest.mark.lockstep
def test_a_program_that_fails_in_flight_leaves_no_process(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Real processes: orders find the run folder while they fly, one level deep in `runs` as that
    of `run`. Then the run lands, writes its summary, and ends. Nothing else is left in `runs`."""
    monkeypatch.chdir(tmp_path)
    with contextlib.suppress(ZeroDivisionError), swarm_ctl.fly(BARE, speedup="max") as swarm:
        swarm.step("form pair")
        assert flying_run() == Path("runs") / swarm.flight.folder.name  # type: ignore[attr-defined]
        assert repr(swarm.hold(2)) == "<hold: accepted by agent 2>"
        raise ZeroDivisionError
    with pytest.raises(StartError, match="nothing flies"):
        flying_run()
    assert [folder.name for folder in runs_in(Path("runs"))] == [swarm.flight.folder.name]  # type: ignore[attr-defined]
    assert len([*Path("runs").iterdir()]) == 1
    (file,) = tmp_path.rglob("summary.json")
    summary = json.loads(file.read_text())
    assert (summary["outcome"], summary["reason"]) == (
        "aborted",
        "ended by its program: all landed",
    )
    found = subprocess.run(["/bin/ps", "-eo", "args"], capture_output=True, text=True, check=True)
    assert str(tmp_path) not in found.stdout


def test_an_async_end_waits_for_its_time_once() -> None:
    """A flight that never ends is given up after `within_s`, not after twice that."""

    class Endless:
        now, over, rest_s = 0.0, False, 0.0

        def turn(self) -> None:
            self.now += 1.0

        def finish(self, within_s: float) -> None:
            self.rest_s = within_s

    flight = Endless()
    swarm = AsyncSwarm(Swarm(flight))  # type: ignore[arg-type]
    asyncio.run(swarm.finish(10.0))
    swarm.leave()
    assert flight.now + flight.rest_s == 10.0


def test_a_virtual_shape_is_dealt_by_where_agents_would_come_to_rest() -> None:
    """As a ground station deals it, not by where vehicles truly are."""
    with swarm_ctl.fly(BARE, vehicles="virtual") as swarm:
        swarm.step("form pair")
        swarm.wait(1.0)
        flight = swarm.flight
        assert isinstance(flight, VirtualFlight)
        known = {agent.id: agent.stop_point_m for agent in swarm_now(flight.view()).agents}
        told = {agent.id: agent.state for agent in swarm.view().agents}
        true = flight.swarm.positions()
        for agent, state in told.items():
            assert state is not None
            assert known[agent] == state.stop_point_m
        assert any(math.dist(known[i] or (0, 0), true[i]) > 0.2 for i in true)
