"""What the dashboard is made of: canvas, lines, links in words, histories, JSON lines."""

from __future__ import annotations

import json
import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rich.cells import cell_len
from textual.color import Color

from swarm_ctl.commands.build import build
from swarm_ctl.commands.parse import Order
from swarm_ctl.core.model.causes import Cause, FailsafeAction
from swarm_ctl.core.model.messages import Ack, Command, Echo, LinkReport, Phase, SafetyReport
from swarm_ctl.core.model.zones import Zone
from swarm_ctl.core.swarm.gain_update import LEAD_S
from swarm_ctl.engine.station.ground_station import swarm_now
from swarm_ctl.station.dashboard.bars import answers_line, title_line
from swarm_ctl.station.dashboard.drawing.canvas import Canvas
from swarm_ctl.station.dashboard.drawing.picture import Chosen, NewZone, Picture
from swarm_ctl.station.dashboard.drawing.styled_line import StyledLine, bar, blocks, fit, gauge
from swarm_ctl.station.dashboard.drawing.widgets import Heading
from swarm_ctl.station.dashboard.panes.groups import group_lines
from swarm_ctl.station.dashboard.panes.sigma_pane import filter_lines
from swarm_ctl.station.dashboard.panes.swarm_map import SIDES, MapScale, fitted, map_lines, position
from swarm_ctl.station.foxglove.desk import figures
from swarm_ctl.station.output.json_lines import json_line
from swarm_ctl.station.picture.alarms import Alarm, Level
from swarm_ctl.station.picture.colours import COLOURS, ON_DARK, ON_LIGHT, inks
from swarm_ctl.station.picture.history import LinkSeries
from swarm_ctl.station.picture.link_quality import bad_links, judge, mesh_judgements
from swarm_ctl.station.picture.model import Model
from swarm_ctl.station.picture.summaries import answers
from swarm_ctl.station.picture.view import CommandView, LinkView, SwarmView
from tests.unit.plans import REST, SCOUTS, SWEEPERS, groups_mission
from tests.unit.station.pictures import PICTURES, PLAN
from tests.unit.station.swarm import flying_model, grouped_model, hexagon_plan, state_of, status_of


def _text(canvas: Canvas) -> list[str]:
    return [line.text for line in canvas.lines()]


@given(
    st.lists(st.tuples(st.floats(-1e6, 1e6), st.floats(-1e6, 1e6)), min_size=2, max_size=6),
    st.floats(0, 1e4),
)
def test_whatever_is_drawn_stays_on_the_canvas(
    points: list[tuple[float, float]], radius: float
) -> None:
    canvas = Canvas(9, 4)
    xs, ys = np.array(points).T
    canvas.dots(xs, ys, "green")
    canvas.circle(points[0], min(radius, 50.0), "blue")
    canvas.words(int(points[0][0]) % 12 - 2, int(points[0][1]) % 6 - 1, "12!", "red")
    assert [len(line) for line in _text(canvas)] == [9] * 4


@pytest.mark.parametrize("seen_from", SIDES)
@pytest.mark.parametrize("size", [(80, 12), (60, 40), (8, 3)])
@given(
    st.lists(
        st.tuples(st.floats(-2000, 2000), st.floats(-2000, 2000), st.floats(-500, 20)),
        min_size=6,
        max_size=6,
    ),
    st.none() | st.builds(NewZone, st.tuples(st.floats(-3000, 3000), st.just(0.0)), st.just(50.0)),
)
def test_the_map_shows_all_agents(
    seen_from: str,
    size: tuple[int, int],
    places: list[tuple[float, float, float]],
    new: NewZone | None,
) -> None:
    """From above and from each side; from above the zone that is being placed, too."""
    model = Model(PLAN)
    for agent, place in zip(PLAN.agents, places, strict=True):
        goal_m = 3.0 - place[2]
        state = state_of(PLAN, agent.id, 30.0, position_ned_m=place, goal_height_m=goal_m)
        model.fold(state, 30.0)
    view = model.view(30.0)
    scale = fitted(Picture(view, chosen=Chosen(new_zone=new, seen_from=seen_from)), *size)
    aside = seen_from in ("south", "east")
    assert scale.seen_from == ("above" if new and aside else seen_from)
    points = [(new.centre_m, 0.0)] if new else []
    for shown, place in zip(view.agents, places, strict=True):
        points += [(position(shown), place[2])]
        points += [(shown.target_m, place[2] - 3.0)] if shown.target_m else []
    for point, down_m in points:
        x, y = scale.dot(point, down_m)
        assert -0.5 <= x <= 2 * size[0] + 0.5
        assert -0.5 <= y <= 4 * size[1] + 0.5


@given(
    st.floats(1e-3, 1e3),
    st.tuples(st.floats(-1e4, 1e4), st.floats(-1e4, 1e4)),
    st.integers(0, 79),
    st.integers(0, 39),
)
def test_a_point_of_the_map_is_in_its_cell(
    dots_per_m: float, middle: tuple[float, float], column: int, row: int
) -> None:
    """To half a stride; a stride is a round length of half a row to a row."""
    scale = MapScale(dots_per_m, middle, 80, 40)
    assert 0.4 - 1e-9 <= scale.stride_m * dots_per_m / 4 <= 1 + 1e-9
    x, y = scale.dot(scale.point(column, row))
    assert abs(x - (2 * column + 1)) <= scale.stride_m / 2 * dots_per_m + 1e-6
    assert abs(y - (4 * row + 2)) <= scale.stride_m / 2 * dots_per_m + 1e-6


@given(st.lists(st.floats(0, 1e9), max_size=60), st.integers(1, 30))
def test_lines_have_the_width_they_were_given(values: list[float], width: int) -> None:
    assert cell_len(blocks(values, width, 0.5)) == width
    assert cell_len("".join(gauge(values[0] if values else 0.5, width))) == width
    assert cell_len(bar(values[0] if values else 0.5, width)) == width
    assert sum(segment.cell_length for segment in StyledLine("漢字" * 9).fit(width)) == width


@given(st.floats(allow_nan=False, allow_infinity=False), st.integers(2, 8), st.integers(0, 3))
def test_a_number_never_leaves_its_column(value: float, width: int, decimals: int) -> None:
    text = fit(value, width, decimals)
    assert len(text) <= width
    if abs(value) < 10 ** (width - 2):
        assert float(text) == pytest.approx(value, abs=0.5)


@given(st.text(max_size=30))
def test_a_cell_is_as_wide_as_its_column_whatever_it_holds(text: str) -> None:
    printable = "".join(c for c in text if c.isprintable())
    assert cell_len(Heading("x", 8).cell(printable).words) == 9


def _link(age: float | None, series: LinkSeries = LinkSeries()) -> tuple[Level, str]:  # noqa: B008 - immutable
    judgement = judge(LinkView(1, 2, LinkReport(age, 0.03, 0.06, 100, 0)), series)
    return judgement.level, judgement.words


def test_a_bad_link_is_named_in_words() -> None:
    lossy = LinkSeries((), ((20.0, 100, 0), (30.0, 190, 10)))
    awful = LinkSeries((), ((20.0, 100, 0), (30.0, 150, 50)))
    assert _link(0.05) == (Level.WELL, "")
    assert _link(None) == (Level.WAITING, "not heard")
    assert _link(0.7) == (Level.WARNING, "last state 0.7 s old")
    assert _link(0.7, awful) == (Level.ERROR, "last state 0.7 s old, 50% lost in 10 s")
    assert _link(1.5) == (Level.ERROR, "last state 1.5 s old")
    assert _link(0.05, lossy) == (Level.WARNING, "10% lost in 10 s")


@pytest.mark.parametrize("width", [40, 60, 80])
def test_no_figure_of_the_safety_filter_is_cut_at_the_edge(width: int) -> None:
    """A count that loses its last digits is another count: what does not fit stands below."""
    view = PICTURES["well"]()
    busy = SafetyReport(ticks=2000, touched=1000, yielded=2057, releases=2057)
    agents = tuple(
        replace(agent, status=agent.status and replace(agent.status, safety=busy))
        for agent in view.agents
    )
    told = sum(agent.status is not None for agent in agents)
    lines = filter_lines(replace(view, agents=agents), width)
    assert max(line.width for line in lines) <= width
    words = " ".join(line.text for line in lines)
    assert f"gave way in {told * 2057}" in words
    assert f"dead-locks left {told * 2057}" in words


def test_an_agent_that_all_hear_badly_is_one_sentence() -> None:
    model = flying_model(PLAN)
    for agent in PLAN.agents:
        links = {
            p.id: LinkReport(0.7 if p.id == 3 else 0.04, 0.03, 0.06, 400, 1)
            for p in PLAN.agents
            if p.id != agent.id
        }
        model.fold(status_of(PLAN, agent.id, 30.0, links=links), 30.0)
    view = model.view(30.0)
    sentences = bad_links(view, mesh_judgements(view))
    assert sentences == [(Level.WARNING, "all agents hear agent 3 badly: last state 0.7 s old")]


def test_a_beacon_that_comes_back_tells_the_round_trip() -> None:
    """Sent at 30.0, lay 0.3 s at the agent, back at 30.35."""
    model = Model(PLAN, station="here")
    model.fold(status_of(PLAN, 1, 30.3, echo=Echo("here", 30.0, 0.3)), 30.35)
    model.fold(status_of(PLAN, 2, 30.3, echo=Echo("elsewhere", 30.0, 0.3)), 30.35)
    model.fold(
        status_of(PLAN, 3, 30.3, echo=Echo("here", 31.0, 0.3)), 30.35
    )  # a clock that can't be
    trips = [model.view(30.4).agent(i).round_trip_s for i in (1, 2, 3)]
    assert trips == [pytest.approx(0.05), None, None]


def test_a_beacon_that_comes_back_tells_the_agent_s_clock() -> None:
    """Agent 2's is 50 s behind; agent 1's may be the station's own. A change of the law
    tells it to the agents (`Tuning.ahead_s`)."""
    model = Model(PLAN, station="here")
    for agent in PLAN.agents:
        told = 40.1 - (50.0 if agent.id == 2 else 0.0)
        model.fold(status_of(PLAN, agent.id, told, echo=Echo("here", 40.0, 0.05)), 40.12)
        model.fold(state_of(PLAN, agent.id, told + 0.1), 40.22)
    view = model.view(40.3)
    assert view.agent(1).link.clock_ahead_s == 0.0
    assert view.agent(2).link.clock_ahead_s == pytest.approx(-50.0, abs=0.04)
    assert view.agent(2).link.age_s == pytest.approx(0.1, abs=0.04)
    command = build(Order("tune", ("plan",)), swarm_now(view))
    assert command.tuning is not None
    assert command.tuning.at_s == pytest.approx(40.3 + LEAD_S)
    assert command.tuning.ahead_s == ((2, pytest.approx(-50.0, abs=0.04)),)


@pytest.mark.parametrize("name", PICTURES)
def test_json_lines_are_one_line_and_whole(name: str) -> None:
    view = PICTURES[name]()
    line = json_line(view)
    told = json.loads(line)
    assert "\n" not in line
    assert [agent["id"] for agent in told["agents"]] == [agent.id for agent in view.agents]
    assert told["version"] == 1


def test_json_lines_tell_what_a_script_acts_on() -> None:
    told = json.loads(json_line(PICTURES["lost"]()))
    assert (told["level"], told["verdict"]) == ("error", "agent 3: not heard for 4.2 s")
    assert told["agents"][2]["lost"] is True
    (command,) = told["commands"]
    assert (command["kind"], command["accepted"], list(command["refused"])) == (
        "land",
        [1, 2, 4, 5],
        ["6"],
    )


def test_json_lines_and_figures_tell_each_group() -> None:
    view = PICTURES["groups"]()
    told = json.loads(json_line(view))
    scouts, sweepers, rest = told["groups"]
    assert (scouts["name"], scouts["step"], scouts["step_name"]) == ("scouts", 5, "barrier ridge")
    assert (scouts["agents"], scouts["waits_for"]) == ([*SCOUTS], [*SWEEPERS])
    assert scouts["waits_s"] == pytest.approx(13.9)
    assert (sweepers["step_name"], sweepers["waits_s"]) == ("move", None)
    assert rest["waits_for"] == [*SCOUTS, *SWEEPERS]
    groups = {agent["id"]: agent["group"] for agent in told["agents"]}
    of = {"scouts": SCOUTS, "sweepers": SWEEPERS, "rest": REST}
    assert groups == {agent: name for name, ids in of.items() for agent in ids}
    seen = figures(view, alarms=0)
    assert [(g.name, g.step, g.agents) for g in seen.groups] == [
        ("scouts", 5, SCOUTS),
        ("sweepers", 4, SWEEPERS),
        ("rest", 3, REST),
    ]
    assert [agent.group for agent in seen.agents] == [*groups.values()]


def test_an_ordered_group_shows_its_order_and_a_silent_one_who_is_silent() -> None:
    model = grouped_model(dict.fromkeys(range(1, 13), (4, False)))
    plan, order = groups_mission().plan, Command("h1", "hold", SCOUTS, 60.0)
    model.fold(order, 60.0)
    for agent in range(1, 12):
        tag = order.tag if agent in SCOUTS else 0
        model.fold(state_of(plan, agent, 70.0, 2, step=4, override=tag), 70.0)
    view = model.view(70.1)
    scouts, sweepers, rest = (line.text for line in group_lines(Picture(view), 105))
    assert "4/11 waits: hold" in scouts
    assert "waits" not in sweepers
    assert rest.rstrip().endswith("12 silent")
    assert "scouts 4 waits: hold · sweepers 4 move" in title_line(Picture(view), 160).text


def _inked(picture: Picture) -> dict[str, str]:
    """The style of each id and name on the map."""
    found = dict[str, str]()
    for line in map_lines(picture, 100, 40):
        for segment in line.segments:
            words = re.findall(r"[a-z]+|[0-9]+", segment.text)
            found |= dict.fromkeys(words, str(segment.style).lower())
    return found


@pytest.mark.parametrize("palette", [ON_DARK, ON_LIGHT])
def test_each_agent_has_the_colour_of_the_report(palette: tuple[str, ...]) -> None:
    """On the map, its trail, and in the table; an agent with an alarm or a mark has another
    ground."""
    view = PICTURES["well"]()
    alarm = Alarm("silent", Level.ERROR, (1,), "agent 1: silent", "silent")
    picture = Picture(view, (alarm,), chosen=Chosen(marked=frozenset({2})), palette=palette)
    assert inks(view.plan) == [0, 1, 2, 3, 4, 5]
    assert [*picture.inks.values()] == [*palette[:6]]
    found = _inked(picture)
    assert "on red" in found["1"]
    assert "reverse magenta" in found["2"]
    for agent in range(3, 7):
        assert f"bold {palette[agent - 1]}".lower() in found[str(agent)]
    styles = " ".join(str(s.style).lower() for x in map_lines(picture, 100, 40) for s in x.segments)
    assert all(f"dim {colour.lower()}" in styles for colour in palette[2:5])  # 2 and 6 avoid


def _luminance(colour: str) -> float:
    """As WCAG has it."""
    shares = (int(colour[k : k + 2], 16) / 255 for k in (1, 3, 5))
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in shares]
    return float(np.dot((0.2126, 0.7152, 0.0722), linear))


def test_all_colours_can_be_read_and_are_the_reports() -> None:
    """A contrast of 3 with the ground of each theme; on a light screen darker ones of the hue."""
    for palette, ground in ((ON_DARK, "#121212"), (ON_LIGHT, "#e0e0e0")):
        for colour in palette:
            dark, bright = sorted((_luminance(ground), _luminance(colour)))
            assert (bright + 0.05) / (dark + 0.05) >= 3.0, colour
        assert len({*palette}) == len(COLOURS)
    for one, other in zip(COLOURS, ON_LIGHT, strict=True):
        hues = [Color.parse(each).hsl.h for each in (one, other)]
        assert abs(hues[0] - hues[1]) < 0.05, (one, other)


def test_the_answers_name_the_group_that_an_order_was_for() -> None:
    view, order = PICTURES["groups"](), Command("h1", "hold", SCOUTS, 59.0)
    acks = {agent: Ack(agent, "h1", True, "") for agent in SCOUTS}
    command = CommandView(order, 59.0, acks)
    line = answers_line(Picture(replace(view, commands=(command,)))).text
    assert line.split() == ["hold", "@scouts", "✓", "agents", "1-4"]
    missed = replace(command, acks={i: acks[i] for i in SCOUTS[:-1]}, over=True)
    line = answers_line(Picture(replace(view, commands=(missed,)))).text
    assert line.endswith("3✓  no answer heard from agent 4")
    told = answers(command, view)
    assert told.startswith("hold @scouts: acknowledged by agents 1-4")
    assert "agents 5-12 fly on, and where the groups meet they wait for them 120 s" in told


def _hundred(marked: int = 0) -> Picture:
    """A hundred agents in rows, each hearing two peers."""
    plan = hexagon_plan(100)
    model = Model(plan)
    for agent in range(1, 101):
        place = (10.0 * (agent // 10), 10.0 * (agent % 10), -10.0)
        state = state_of(plan, agent, 30.0, seq=600, step=1, position_ned_m=place)
        model.fold(state, 30.0)
        near = [j for j in (agent - 1, agent + 1) if 1 <= j <= 100]
        links = {j: LinkReport(0.04, 0.03, 0.001 * j, 400, 1) for j in near}
        model.fold(status_of(plan, agent, 30.0, step=1, links=links), 30.0)
    chosen = Chosen(marked=frozenset({marked} if marked else ()))
    return Picture(model.view(30.0), (), (), 0, chosen)


def test_a_full_map_has_dots_and_the_ids_that_are_asked_for() -> None:
    """Ids that lie over each other tell nothing."""
    small = "\n".join(line.text for line in map_lines(_hundred(marked=44), 30, 7)[:-1])
    assert re.findall(r"\d+", small) == ["44"]
    assert small.count("•") >= 20
    wide = "\n".join(line.text for line in map_lines(_hundred(), 160, 60))
    assert {str(k) for k in range(1, 101)} <= set(re.findall(r"\d+", wide))


def test_the_title_says_what_agents_fly_that_have_broken_the_mission_off() -> None:
    model = flying_model(PLAN, 30.0)
    for agent in range(1, 7):
        told = {"phase": Phase.RETURN, "action": FailsafeAction.RETURN, "cause": Cause.ORDER}
        model.fold(state_of(PLAN, agent, 30.1, 1201, phase=Phase.RETURN), 30.1)
        model.fold(status_of(PLAN, agent, 30.1, **told), 30.1)
    title = title_line(Picture(model.view(30.1)), 100).text
    assert "all fly home, step 2/4 broken off" in title
    assert "form" not in title
    for agent in (1, 2):
        told = {"phase": Phase.LAND, "action": FailsafeAction.RETURN, "cause": Cause.ORDER}
        model.fold(state_of(PLAN, agent, 30.2, 1202, phase=Phase.LAND), 30.2)
        model.fold(status_of(PLAN, agent, 30.2, **told), 30.2)
    title = title_line(Picture(model.view(30.2)), 100).text
    assert "4 fly home, 2 land, step 2/4 broken off" in title


def _from(seen_from: str, view: SwarmView, size: tuple[int, int] = (70, 24)) -> list[str]:
    picture = Picture(view, chosen=Chosen(seen_from=seen_from))
    return [line.text for line in map_lines(picture, *size)]


def _cell(lines: list[str], word: str) -> tuple[int, int]:
    """(row, column) of a word that stands there once, above the scale bar."""
    ((row, found),) = [
        (row, match)
        for row, line in enumerate(lines[:-1])
        for match in re.finditer(rf"(?<!\d){word}(?!\d)", line)
    ]
    return row, found.start()


def test_from_a_side_agents_behind_each_other_have_ids_side_by_side() -> None:
    """A grid of 3 x 4 in two layers: each id stands there once, at its own height."""
    plan = hexagon_plan(12)
    model = Model(plan)
    for k, agent in enumerate(plan.agents):
        place = (10.0 * (k // 3), 10.0 * (k % 3), -10.0 - 5.0 * (k % 2))
        model.fold(state_of(plan, agent.id, 30.0, step=1, position_ned_m=place), 30.0)
    lines = _from("south", model.view(30.0))
    rows = {height: _cell(lines, f"{height} m")[0] for height in (10, 15)}
    for k, agent in enumerate(plan.agents):
        assert _cell(lines, f"{agent.id}(?! m)")[0] == rows[10 + 5 * (k % 2)]


def test_from_a_side_a_zone_stands_from_floor_to_ceiling() -> None:
    tower = Zone("tower", ((60.0, 60.0),), 5.0, 1.0, ceiling_m=8.0)
    bridge = Zone("bridge", ((60.0, 60.0),), 5.0, 1.0, floor_m=14.0)
    model = flying_model(replace(PLAN, zones=(tower, bridge)))
    high = state_of(PLAN, 1, 30.1, seq=2000, position_ned_m=(70.0, 80.0, -20.0))
    model.fold(high, 30.1)
    south = _from("south", model.view(30.1))
    assert _cell(south, "tower")[0] > _cell(south, "10 m")[0] > _cell(south, "bridge")[0]
