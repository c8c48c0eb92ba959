"""What the dashboard is made of: canvas, lines, links in words, histories, JSON lines."""

from __future__ import annotations

import json
import math
import re
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rich.cells import cell_len
from textual.color import Color

from swarm_ctl.commands.build import build
from swarm_ctl.commands.parse import Order
from swarm_ctl.core.model.causes import Cause, FailsafeAction
from swarm_ctl.core.model.frames import geodetic_from_ned
from swarm_ctl.core.model.messages import (
    Ack,
    Command,
    Echo,
    LinkReport,
    Phase,
    SigmaReport,
    TargetWord,
)
from swarm_ctl.core.model.plan import Fence
from swarm_ctl.core.model.steps.move import MoveStep
from swarm_ctl.core.model.targets import TargetPlan
from swarm_ctl.core.model.zones import Zone
from swarm_ctl.core.swarm.gain_update import LEAD_S
from swarm_ctl.engine.station.ground_station import swarm_now
from swarm_ctl.station.dashboard.bars import answers_line, title_line
from swarm_ctl.station.dashboard.drawing.canvas import Canvas
from swarm_ctl.station.dashboard.drawing.picture import Chosen, NewZone, Picture
from swarm_ctl.station.dashboard.drawing.styled_line import StyledLine, bar, blocks, fit, gauge
from swarm_ctl.station.dashboard.drawing.widgets import Heading
from swarm_ctl.station.dashboard.panes.groups import group_lines
from swarm_ctl.station.dashboard.panes.link_matrix import METRICS, listener_lines
from swarm_ctl.station.dashboard.panes.sigma_pane import budget_used
from swarm_ctl.station.dashboard.panes.swarm_map import SIDES, MapScale, fitted, map_lines, position
from swarm_ctl.station.dashboard.panes.swarm_pane import trend_lines
from swarm_ctl.station.foxglove.desk import figures
from swarm_ctl.station.output.json_lines import json_line
from swarm_ctl.station.picture.alarms import Alarm, Level
from swarm_ctl.station.picture.colours import COLOURS, ON_DARK, ON_LIGHT, inks
from swarm_ctl.station.picture.history import LOSS_WINDOW_S, LinkSeries
from swarm_ctl.station.picture.journal import Journal
from swarm_ctl.station.picture.link_quality import bad_links, judge, mesh_judgements
from swarm_ctl.station.picture.model import Model
from swarm_ctl.station.picture.summaries import answers, flown_order
from swarm_ctl.station.picture.view import CommandView, LinkView, SwarmView, TargetView
from tests.unit.plans import REST, SCOUTS, SWEEPERS, groups_mission, steps_of, with_group
from tests.unit.station.pictures import PICTURES, PLAN
from tests.unit.station.swarm import (
    flying_model,
    grouped_model,
    hexagon_plan,
    report_of,
    state_of,
    status_of,
)


def _text(canvas: Canvas) -> list[str]:
    return [line.text for line in canvas.lines()]


def test_dots_are_braille_at_their_place() -> None:
    canvas = Canvas(2, 1)
    canvas.dots(np.array([0.0, 3.0]), np.array([0.0, 3.0]), "green")
    assert _text(canvas) == ["\u2801\u2880"]


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


def test_there_is_no_minus_nought() -> None:
    assert (fit(-0.04, 4, 1), fit(-0.06, 4, 1), fit(-0.0, 4, 2)) == ("0.0", "-0.1", "0.00")


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
    assert _link(None) == (Level.WAITING, "never heard")
    assert _link(0.7) == (Level.WARNING, "last state 0.7 s old")
    assert _link(0.7, awful) == (Level.ERROR, "last state 0.7 s old, 50% lost in 10 s")
    assert _link(1.5) == (Level.ERROR, "last state 1.5 s old")
    assert _link(0.05, lossy) == (Level.WARNING, "10% lost in 10 s")


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


def test_loss_is_that_of_the_last_ten_seconds() -> None:
    model = flying_model(PLAN)
    for k in range(60):
        now = 30.0 + 0.5 * k
        lost = 0 if now < 40.0 else 100
        links = {1: LinkReport(0.04, 0.03, 0.06, 10 * k, lost)}
        model.fold(status_of(PLAN, 2, now, links=links), now)
    series = model.view(59.5).histories.links[2, 1]
    assert series.counts[0][0] >= 59.5 - LOSS_WINDOW_S
    assert series.recent_loss == 0.0
    assert len(series.ages_s) == 40


def test_trails_are_bounded_and_follow_the_agent() -> None:
    model = Model(PLAN)
    for k in range(4000):
        model.fold(
            state_of(PLAN, 1, 0.05 * k, seq=k, position_ned_m=(float(k), 0.0, -10.0)), 0.05 * k
        )
    trail = model.view(200.0).histories.trails[1]
    assert len(trail) == 80
    assert trail[-1][0] == pytest.approx(3990.0, abs=10.0)


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


@pytest.mark.parametrize(
    ("report", "short", "long"),
    [
        (LinkReport(0.04, 0.03, 0.06, 400, 1), "–", "–"),
        (LinkReport(0.04, 0.03, 0.06, 400, 1, 0.0002, 0.001), "+0", "+0±0"),
        (LinkReport(0.04, 0.03, 0.06, 400, 1, -0.3, 0.041), "-300", "-300±20"),
        (LinkReport(0.04, 0.03, 0.06, 400, 1, 0.99949, 20.0), "+999", "+999±999+"),
        (LinkReport(0.04, 0.03, 0.06, 400, 1, -99.4, 0.01), "-99s", "-99s±5"),
        (LinkReport(0.04, 0.03, 0.06, 400, 1, 3600.0, 0.01), "+60m", "+60m±5"),
        (LinkReport(0.04, 0.03, 0.06, 400, 1, -36000.0, 0.01), "-10h", "-10h±5"),
        (LinkReport(0.04, 0.03, 0.06, 400, 1, 8e6, 0.01), "+93d", "+93d±5"),
    ],
)
def test_how_far_a_clock_is_ahead_fits_its_cell(report: LinkReport, short: str, long: str) -> None:
    metric = METRICS["clock"]
    link = LinkView(1, 2, report)
    assert (metric.short(link, LinkSeries()), metric.long(link, LinkSeries())) == (short, long)


def test_budget_is_the_step_over_property_1s_room() -> None:
    report = report_of(6, 1.4, d=2.5)
    law = SigmaReport(2, 30.0, (0.1, 0.0), (0.2, 0.4), (report,))
    assert budget_used(report, law, 4.5) == pytest.approx(math.hypot(0.3, 0.4) / (4.5 / 2.5 - 0.7))
    assert budget_used(report_of(6, 1.4, d=None), law, 4.5) is None
    assert budget_used(report, None, 4.5) is None


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


@pytest.mark.parametrize("width", [60, 80, 105])
def test_a_line_for_each_group_with_its_step_and_for_whom_it_waits(width: int) -> None:
    lines = group_lines(Picture(PICTURES["groups"]()), width)
    scouts, sweepers, rest = (" ".join(line.text.split()) for line in lines)
    assert scouts.startswith("scouts 5/11 barrier ridge 1-4 error ")
    assert scouts.endswith("… 14 s for sweepers")
    assert sweepers.startswith("sweepers 4/11 move 5-10 error")
    assert "…" not in sweepers
    assert rest.endswith("… 22 s for scouts, sweepers")


def test_a_mission_that_never_splits_has_no_lines_of_groups() -> None:
    assert group_lines(Picture(PICTURES["well"]()), 80) == []


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


def test_the_title_says_which_group_is_in_which_step() -> None:
    """On a narrow screen with fewer words."""
    picture = Picture(PICTURES["groups"]())
    assert (
        "scouts 5 barrier ridge · sweepers 4 move · rest 3 join 1" in title_line(picture, 160).text
    )
    assert "scouts 5, sweepers 4, rest 3" in title_line(picture, 80).text


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


def test_each_group_has_a_colour_of_its_own() -> None:
    """Agents that are well, their trails and their names have it on the map; an alarm's colour and
    a mark's go before it."""
    view = PICTURES["groups"]()
    colours = {group.name: Picture(view).group_ink(group.name) for group in view.groups}
    assert [*colours.values()] == [*ON_DARK[:3]]
    assert Picture(view).group_ink("all") == ""
    alarm = Alarm("silent", Level.ERROR, (1,), "agent 1: silent", "silent")
    found = _inked(Picture(view, (alarm,), chosen=Chosen(marked=frozenset({2}))))
    assert "red" in found["1"]
    assert "magenta" in found["2"]
    for word, name in (("3", "scouts"), ("5", "sweepers"), ("11", "rest")):
        assert colours[name].lower() in found[word]
        assert colours[name].lower() in found[name]


def test_the_names_of_groups_in_one_place_stand_below_each_other() -> None:
    """None over another, all on the map."""
    told = {i: PICTURES["groups"]().agent(i).newest for i in range(1, 13)}
    model = grouped_model({i: (each.step, each.done) for i, each in told.items() if each})
    lines = [line.text for line in map_lines(Picture(model.view(60.0)), 40, 20)]
    for name in ("scouts", "sweepers", "rest"):
        assert sum(len(re.findall(rf"\b{name}\b", line)) for line in lines) == 1


def test_the_answers_name_the_group_that_an_order_was_for() -> None:
    view, order = PICTURES["groups"](), Command("h1", "hold", SCOUTS, 59.0)
    acks = {agent: Ack(agent, "h1", True, "") for agent in SCOUTS}
    command = CommandView(order, 59.0, acks)
    line = answers_line(Picture(replace(view, commands=(command,)))).text
    assert line.split() == ["hold", "@scouts", "✓", "agents", "1-4"]
    told = answers(command, view)
    assert told.startswith("hold @scouts: acknowledged by agents 1-4")
    assert "agents 5-12 fly on, and where the groups meet they wait for them 120 s" in told


def test_slots_are_laid_under_the_live_agents() -> None:
    """Where each agent is at its own slot but for a common shift, every slot is where its agent
    is."""
    model = Model(PLAN)
    form = steps_of(PLAN)[1]
    for agent, slot in zip(PLAN.agents, form.slots, strict=True):  # type: ignore[union-attr]
        place = (100.0 + 5 * slot[0], -50.0 + 5 * slot[1], -10.0)
        model.fold(state_of(PLAN, agent.id, 30.0, position_ned_m=place), 30.0)
    for agent_view in model.view(30.0).agents:
        assert agent_view.target_m == pytest.approx(position(agent_view))
        assert agent_view.error_m == pytest.approx(0.0, abs=1e-9)


def test_ended_agents_make_no_bad_links() -> None:
    view = PICTURES["ended"]()
    assert bad_links(view, mesh_judgements(view)) == []
    assert all(agent.phase is Phase.ENDED for agent in view.agents)
    assert len(hexagon_plan(32).agents) == 32


def test_an_order_that_is_flown_stands_in_place_of_the_step() -> None:
    """The mission's step waits meanwhile, and is not what the agents fly."""
    model = flying_model(PLAN)
    view = model.view(30.0)
    assert {flown_order(agent, view) for agent in view.agents} == {""}
    command = build(Order("move", ("20", "-5")), swarm_now(view))
    model.fold(command, 30.0)
    for agent in PLAN.agents:
        model.fold(state_of(PLAN, agent.id, 30.0, seq=2000, override=command.tag), 30.01)
    view = model.view(30.1)
    assert {flown_order(agent, view) for agent in view.agents} == {"move to 20, -5 m"}
    assert "waits: move to 20, -5 m" in title_line(Picture(view), 120).text


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


def test_a_large_swarm_has_a_line_for_each_listener() -> None:
    """With its peers, and the worst of its links."""
    picture = _hundred()
    lines = [line.text for line in listener_lines(picture, mesh_judgements(picture.view))]
    assert lines[2 + 43].split() == ["44", "2", "45", "from", "45", "43", "45"]
    assert len(lines) == 102
    assert all(cell_len(line) <= 80 for line in lines)


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


def test_an_accepted_command_has_no_colour_of_an_error_and_a_refused_one_has() -> None:
    model = flying_model(PLAN)
    model.fold(Command("c", "hold", (), 30.0), 30.0)
    for agent in range(1, 7):
        model.fold(Ack(agent, "c", True, ""), 30.0)

    def colours() -> set[str]:
        line = answers_line(Picture(model.view(30.1)))
        found = (part.style.color for part in line.segments if part.style is not None)
        return {colour.name for colour in found if colour is not None}

    assert colours() == {"green"}
    model.fold(Ack(6, "c", False, "no"), 30.1)
    assert "red" in colours()


def test_homes_path_and_fence_are_on_the_map() -> None:
    """Where agents stood before they took off; the legs of the step that is flown and of those to
    come; turned to the whole mission, all of it is seen."""
    at_m, corners = (0.0, 120.0), ((-200.0, 0.0), (200.0, 0.0), (200.0, 150.0), (-200.0, 150.0))
    takeoff, form, _, land = steps_of(PLAN)
    ways_m = (((70.0, 120.0), at_m), ((180.0, 70.0),))
    legs = (MoveStep(way_m, 2.0, 1.0, 1.0, 60.0) for way_m in ways_m)
    plan = with_group(PLAN, steps=(takeoff, form, *legs, land))
    plan = replace(plan, fence=Fence(corners, 30.0))
    model = Model(plan)
    for k, agent in enumerate(plan.agents):
        ground = {"phase": Phase.PREPARE, "step": 0, "airborne": False}
        north, east = agent.start[0] * plan.unit_m, agent.start[1] * plan.unit_m
        home_m = (north - 20.0, east, 0.0)
        if k:  # of one that is heard in the air alone none knows where it stood
            model.fold(state_of(plan, agent.id, 5.0, 1, position_ned_m=home_m, **ground), 5.0)
        model.fold(state_of(plan, agent.id, 30.0, 2), 30.0)
    assert [*model.view(30.0).histories.homes] == [2, 3, 4, 5, 6]

    def drawn(step: int) -> str:
        for agent in plan.agents:
            model.fold(state_of(plan, agent.id, 30.0 + step, 2 + step, step=step), 30.0 + step)
        picture = Picture(model.view(30.0 + step), chosen=Chosen(seen_from="whole"))
        for corner in corners:
            x, y = fitted(picture, 90, 40).dot(corner)
            assert 0.0 <= x <= 180.0
            assert 0.0 <= y <= 160.0
        return "\n".join(line.text for line in map_lines(picture, 90, 40))

    assert (drawn(3).count("⌂"), drawn(3).count("×"), drawn(4).count("×")) == (5, 3, 1)


def test_trends_fall_with_their_values_and_have_their_bound() -> None:
    """A point a second, over the last four minutes; where nothing was known there is no line."""
    journal, view = Journal(), PICTURES["well"]()
    for k in range(3000):
        left = 1.0 - k / 2999
        agents = tuple(replace(agent, nearest_m=20.0 * left + 1.0) for agent in view.agents)
        error_m = None if 2400 < k < 2900 else 8.0 * left
        told = replace(view, time_s=30.0 + 0.1 * k, agents=agents, error_m=error_m)
        journal.update(told)
    times = [point.time_s for point in journal.trends]
    assert times[-1] - times[0] == pytest.approx(240.0)
    assert len(times) == 241
    lines = trend_lines(Picture(view, trends=journal.trends), 80, 14)
    assert {len(line.text) for k, line in enumerate(lines) if k % 7} == {80}
    (near, *curve), (error, *other) = lines[:7], lines[7:]
    assert near.text == " nearest pair in the air, last 240 s  1.06 m  r_in 2.5 m"
    assert error.text.startswith(" formation error, last 240 s")
    assert "".join(line.text[-1] for line in curve).strip() != ""
    rows = [next(k for k, line in enumerate(curve) if line.text[x].strip()) for x in (9, 40, 79)]
    assert rows == sorted({*rows})
    assert "red" in str(curve[-1].segments[0].style) + str(curve[-1].segments[-2].style)
    assert not "".join(line.text[61:76] for line in other).strip()  # 270 to 320 s of 90 to 330 s


def test_a_target_is_on_the_map_with_the_age_of_old_news() -> None:
    plan = replace(hexagon_plan(), targets=(TargetPlan("boat"),))
    at = geodetic_from_ned((60.0, 70.0, 0.0), plan.origin)
    model = flying_model(plan, 10.0)
    word = TargetWord("boat", at.lat_deg, at.lon_deg, 0.5, station="boat.1")
    model.fold(replace(word, name="stranger"), 10.0)
    assert model.view(10.0).targets == ()
    model.fold(word, 10.0)
    (seen,) = model.view(10.2).targets
    assert (seen.name, seen.teller) == ("boat", "boat.1")
    assert seen.at_m == pytest.approx((60.0, 70.0), abs=0.01)
    assert seen.age_s == pytest.approx(0.7)
    assert seen.up_m is None
    for now_s, words in ((10.2, "◎ boat "), (16.0, "◎ boat 6 s ago"), (16.0, "boat 6.5 s")):
        drawn = "\n".join(line.text for line in map_lines(Picture(model.view(now_s)), 60, 20))
        assert words in drawn


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


def test_from_a_side_heights_go_up_and_stand_at_their_labels() -> None:
    """From the south east is to the right, from the east north; a target is at its own height, and
    its line tells the height and how far the formation is off."""
    model = Model(PLAN)
    for agent in PLAN.agents:
        place = (10.0 * agent.id, -7.0 * agent.id, -5.0 * agent.id)
        model.fold(state_of(PLAN, agent.id, 30.0, step=1, position_ned_m=place), 30.0)
    plan = replace(PLAN, targets=(TargetPlan("boat"), TargetPlan("van")))
    boat = TargetView("boat", (40.0, -28.0), 0.4, "boat.1", up_m=5.0, off_m=1.24)
    view = replace(model.view(30.0), plan=plan, targets=(boat,))
    for side, sign in (("south", -1), ("east", 1)):
        lines = _from(side, view)
        assert SIDES[side] in lines[-1]
        assert lines[0].startswith(" boat 0.4 s · off 1.2 m · up 5.0 m")
        assert lines[1].startswith(" van: not heard")
        lines = lines[2:]
        cells = [_cell(lines, f"{agent.id}(?! m)") for agent in PLAN.agents]
        for (row, column), (higher, further) in pairwise(cells):
            assert higher < row
            assert sign * (further - column) > 0
        rows = [_cell(lines, f"{height} m")[0] for height in (0, 10, 20, 30)]
        assert [cells[1][0], cells[3][0], cells[5][0]] == rows[1:]
        assert _cell(lines, "◎ boat")[0] == cells[0][0]


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
