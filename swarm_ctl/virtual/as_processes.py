"""A scenario as processes in lockstep: what each of them does to itself, and when."""

from __future__ import annotations

from collections.abc import Iterator

from swarm_ctl.core.model.plan import Plan, Policy
from swarm_ctl.engine.script import (
    AgentScript,
    Deed,
    Due,
    RunScript,
    ScriptedOrder,
    StationScript,
    Untruth,
)
from swarm_ctl.errors import InputError
from swarm_ctl.mesh.impaired import Impairment
from swarm_ctl.virtual.scenario import (
    STATION,
    Happening,
    Says,
    Scenario,
    ScenarioPart,
    scenario_text,
)


def run_script(scenario: Scenario, plan: Plan) -> RunScript:
    """Of all processes. InputError where something in it can't happen to processes the same as on
    the virtual clock."""
    for k, happening in enumerate(scenario.happens):
        _refuse(k, happening, plan)
    ids = [agent.id for agent in plan.agents]
    return RunScript(
        {agent: _agent_script(scenario, agent, ids) for agent in ids},
        _station_script(scenario),
        scenario_text(scenario),
    )


def _refuse(number: int, happening: Happening, plan: Plan) -> None:
    where = f"happens[{number}], {happening.kind} at {happening.at_s:g} s"
    if happening.restart:
        raise InputError(
            f"{where}: a process that is started again joins at a tick that the machine decides;"
            " allowed here: all but restart, and this on the virtual clock"
        )
    if happening.station and happening.for_s is not None:
        raise InputError(
            f"{where}: for_s: a station that comes back joins at a tick that the machine decides;"
            " allowed here: a station that is gone to the end, and this on the virtual clock"
        )
    if happening.station and plan.policies.station_lost is Policy.HOLD:
        raise InputError(
            f"{where}: agents hold until a station is heard again (policies.station_lost), and none"
            " comes back to processes; allowed here: another policy, and this on the virtual clock"
        )
    if happening.at_s == 0.0 and (happening.order or happening.kill or happening.station):
        raise InputError(
            f"{where}: processes are there from the first tick on; allowed here: after 0 s"
        )


def _station_script(scenario: Scenario) -> StationScript:
    happens = sorted(scenario.happens, key=lambda each: each.at_s)
    orders = tuple(
        ScriptedOrder(each.at_s, each.order, each.may_be_refused) for each in happens if each.order
    )
    gone = [each.at_s for each in happens if each.station]
    return StationScript(orders, scenario.ends_s, min(gone, default=None))


def _agent_script(scenario: Scenario, agent: int, ids: list[int]) -> AgentScript:
    due = sorted(
        (each for happening in scenario.happens for each in _due(happening, agent)),
        key=lambda each: each.at_s,
    )
    return AgentScript(
        tuple(due),
        impairment_of(scenario),
        (*ids, STATION),
        dice_of(scenario, agent),
        own_clocks(scenario).get(agent),
    )


def _due(happening: Happening, agent: int) -> Iterator[Due]:
    at_s = happening.at_s
    end_s = None if happening.for_s is None else at_s + happening.for_s
    if agent in (happening.kill or ()):
        yield Due(at_s, Deed.KILL)
    elif agent in (happening.stop or ()):
        yield Due(at_s, Deed.STOP)
        if end_s is not None:
            yield Due(end_s, Deed.GO_ON)
    elif happening.part is not None:
        unheard = tuple(str(other) for hearer, other in cut(happening.part) if hearer == agent)
        if unheard:
            yield Due(at_s, Deed.PART, names=unheard)
            if end_s is not None:
                yield Due(end_s, Deed.JOIN, names=unheard)
    elif happening.clock is not None and agent in happening.clock.agents:
        yield Due(at_s, Deed.CLOCK, ahead_s=happening.clock.ahead_s)
    elif happening.says is not None and agent in happening.says.agents:
        yield Due(at_s, Deed.SAY, untruth=untruth_of(happening.says))
        if end_s is not None:
            yield Due(end_s, Deed.SAY)


def untruth_of(says: Says) -> Untruth:
    """What is told instead."""
    return Untruth(says.moved_m, tuple((str(name), value) for name, value in says.set.items()))


def impairment_of(scenario: Scenario) -> Impairment | None:
    """What happens to each message that an agent hears; None: nothing ever does."""
    quality = scenario.mesh
    parts = any(each.part for each in scenario.happens)
    if not (parts or quality.model_dump(exclude_defaults=True)):
        return None
    return Impairment(quality.loss, quality.delay_s, quality.jitter_s, quality.duplicate)


def dice_of(scenario: Scenario, agent: int) -> int:
    """The seed of what happens to the messages that this agent hears."""
    return scenario.seed * 1009 + agent


def own_clocks(scenario: Scenario) -> dict[int, tuple[float, float]]:
    """(seconds ahead, seconds gained in a second), by agent, of those whose clock is not the
    swarm's, or will not be."""
    jumped = {i for each in scenario.happens if each.clock for i in each.clock.agents}
    named = {i: (c.ahead_s, c.drift) for c in scenario.clocks for i in c.agents}
    return dict.fromkeys(sorted(jumped), (0.0, 0.0)) | named


def cut(part: ScenarioPart) -> Iterator[tuple[int | str, int | str]]:
    """(hearer, speaker) of all that do not hear."""
    for one in part.one:
        for other in part.other:
            yield one, other
            if not part.one_way:
                yield other, one
