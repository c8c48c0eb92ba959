"""The live map: what it tells of the views, to whom, and the page in headless Chromium."""

from __future__ import annotations

import base64
import hashlib
import http.client
import json
import re
import socket
from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from swarm_ctl.core.model.plan import Fence
from swarm_ctl.core.model.zones import Zone
from swarm_ctl.engine.launch.ports import free_ports
from swarm_ctl.errors import InputError, StartError
from swarm_ctl.extensions.browser import BrowserMap, live_flight
from swarm_ctl.extensions.browser.live_flight import LiveFlight, Version
from swarm_ctl.station.picture.view import SwarmView
from tests.on_demand import on_demand
from tests.unit.chromium import chromium
from tests.unit.station.pictures import PICTURES
from tests.unit.station.swarm import hexagon_plan

WELL = PICTURES["well"]()
EVIL = "</script><script>document.title='run'</script>"


def moved(view: SwarmView, by_s: float) -> SwarmView:
    """The same, so much later, and as many metres to the north."""
    agents = []
    for agent in view.agents:
        assert agent.state is not None
        north, east, down = agent.state.position_ned_m
        state = replace(agent.state, position_ned_m=(north + by_s, east, down))
        agents.append(replace(agent, state=state))
    return replace(view, time_s=view.time_s + by_s, agents=tuple(agents))


def places(told: dict[str, Any]) -> Any:
    """(T, n, 3) [m]"""
    whole = np.frombuffer(base64.b64decode(told["places"]), "<i2").reshape(-1, 3).astype(float)
    whole[whole == -32768] = np.nan
    count = len(base64.b64decode(told["times_s"])) // 4
    return (whole * told["grain_m"] + told["middle_m"]).reshape(count, -1, 3)


@pytest.mark.parametrize("name", PICTURES)
def test_every_picture_can_be_told(name: str) -> None:
    """Without NaN, which is no JSON; a vehicle that was never placed has no place."""
    view = PICTURES[name]()
    flight = LiveFlight(view.plan)
    assert flight.since(Version()) == {}
    json.dumps(flight.beginning(), allow_nan=False)
    flight.take(view)
    told = flight.since(Version())
    json.dumps(told, allow_nan=False)
    by_id = {agent.id: agent for agent in view.agents}
    for agent, place in zip(view.plan.agents, places(told)[0], strict=True):
        state = by_id[agent.id].state
        if state is None:
            assert np.isnan(place).all()
        else:
            assert place == pytest.approx(state.position_ned_m, abs=0.01)


def test_what_follows_joins_what_was_told() -> None:
    """A page that came early and one that comes late have the same flight; steps and marks are
    told again where they changed alone."""
    flight = LiveFlight(WELL.plan)
    flight.take(WELL)
    early, version = [flight.since(Version())], flight.version
    for k in range(1, 9):
        flight.take(moved(WELL, 0.25 * k))
        if k % 3 == 0:
            early.append(flight.since(version))
            version = flight.version
    early.append(flight.since(version))
    late = flight.since(Version())
    assert [told["whole"] for told in early] == [True, False, False, False]
    assert "steps" not in early[1]
    assert np.concatenate([places(told) for told in early]) == pytest.approx(
        places(late), abs=0.011
    )
    assert len(places(late)) == 9


def test_a_clock_that_is_set_back_begins_anew() -> None:
    flight = LiveFlight(WELL.plan)
    flight.take(moved(WELL, 5.0))
    version = flight.version
    flight.take(WELL)
    told = flight.since(version)
    assert told["whole"]
    assert len(places(told)) == 1


def test_a_long_flight_is_thinned(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its beginning and its end stay."""
    monkeypatch.setattr(live_flight, "_MOST", 60)
    flight = LiveFlight(WELL.plan)
    for k in range(100):
        flight.take(moved(WELL, 0.25 * k))
    found = places(flight.since(Version()))
    assert 5 <= len(found) <= 11
    expected = [agent.state.position_ned_m[0] for agent in WELL.agents if agent.state]
    assert found[0, :, 0] == pytest.approx(expected, abs=0.01)
    assert found[-1, :, 0] == pytest.approx(np.array(expected) + 0.25 * 99, abs=0.01)


@pytest.fixture
def live() -> Iterator[BrowserMap]:
    """A map of a plan with a fence and a zone, and a name that is no markup."""
    corners = ((20.0, 40.0), (80.0, 40.0), (80.0, 100.0), (20.0, 100.0))
    zone = Zone("mast", ((75.0, 60.0),), 3.0, 1.0, None, 20.0)
    plan = replace(hexagon_plan(), name=EVIL, fence=Fence(corners, 30.0), zones=(zone,))
    said: list[str] = []
    with closing(served(plan, said)) as made:
        assert said == [f"the live map, for whoever may look: {made.link}"]
        show(made, 0.0)
        yield made


def show(live: BrowserMap, by_s: float) -> None:
    live.take(moved(replace(WELL, plan=live._flight.plan), by_s))


def served(plan: Any, said: list[str]) -> BrowserMap:
    """Its station has no ear for orders."""
    (port,) = free_ports(1, socket.SOCK_STREAM)
    return BrowserMap(str(port), SimpleNamespace(plan=plan, tell=said.append))


def test_the_page_is_small_and_runs_its_own_scripts_alone(live: BrowserMap) -> None:
    with asked(live) as answer:
        page = answer.read().decode()
    assert len(page) < 60_000
    scripts = re.findall(r"<script>(.*?)</script>", page, re.DOTALL)
    allowed = re.findall(r"'sha256-([^']*)'", page)
    digests = [base64.b64encode(hashlib.sha256(s.encode()).digest()).decode() for s in scripts]
    assert len(scripts) == 2
    assert digests == allowed
    assert page.count("<script") == 3
    assert "default-src 'none'" in page
    assert not re.search(r"(src|href)=", page)


@contextmanager
def asked(live: BrowserMap, path: str = "", method: str = "GET", **headers: str) -> Iterator[Any]:
    """The answer to a request; `path` is under the link, unless it begins with a slash."""
    host, _, secret = live.link.removeprefix("http://").partition("/")
    with closing(http.client.HTTPConnection(host)) as connection:
        connection.request(
            method, path if path.startswith("/") else f"/{secret}{path}", headers=headers
        )
        with connection.getresponse() as answer:
            yield answer


@pytest.mark.parametrize(
    ("path", "more", "status"),
    [
        ("/", {}, 404),
        ("/news", {}, 404),
        ("/AAAAAAAAAAAAAAAAAAAAAA/", {}, 404),
        ("", {"method": "POST"}, 405),
        ("", {"Host": "swarm.example"}, 403),
        ("", {"Origin": "https://elsewhere.example"}, 403),
        ("news", {"Host": "swarm.example:8700"}, 403),
    ],
)
def test_only_its_link_shows_it(
    live: BrowserMap, path: str, more: dict[str, str], status: int
) -> None:
    """A page of another site, and a name that was made to mean this machine, get nothing, not even
    with the link."""
    with asked(live, path, **more) as answer:
        assert answer.status == status
        assert len(answer.read()) < 100


def test_a_stream_tells_views_and_its_end(live: BrowserMap) -> None:
    with asked(live, "news") as stream:
        assert stream.headers["Content-Type"] == "text/event-stream"
        first = next_event(stream)
        assert first["whole"]
        show(live, 0.25)
        later = next_event(stream)
        assert not later["whole"]
        assert later["now"]["time_s"] > first["now"]["time_s"]
        assert later["sent_s"] >= first["sent_s"]
        live.close()
        assert stream.read().endswith(b"event: end\ndata: \n\n")


def next_event(stream: Any) -> Any:
    for line in stream:
        if line.startswith(b"data: "):
            return json.loads(line[6:])
    raise AssertionError("the stream has ended")


@pytest.mark.parametrize("argument", ["0.0.0.0:8700", "192.168.1.5:8700", "drone.local:8700"])
def test_it_does_not_leave_this_computer(argument: str) -> None:
    with pytest.raises(InputError, match=r"no TLS.*allowed: a port of 127.0.0.1;.*ssh -L 8700"):
        BrowserMap.check(argument)


def test_a_taken_port_is_refused_before_anything_flies() -> None:
    with socket.socket() as held:
        held.bind(("127.0.0.1", 0))
        held.listen()
        with pytest.raises(StartError, match=r"web: .*Address already in use; name another port"):
            BrowserMap.check(str(held.getsockname()[1]))


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with chromium() as opened:
        yield opened


@pytest.mark.parametrize(
    ("scheme", "width"),
    [("light", 1280), ("dark", 390), on_demand("dark", 1280), on_demand("light", 390)],
)
def test_the_page_follows_in_chromium(
    browser: Any, live: BrowserMap, scheme: str, width: int
) -> None:
    """It follows the newest view, or stays at a moment that its visitor chose; it says that it is
    old where it hears nothing for three seconds, and that the station has ended."""
    context = browser.new_context(
        color_scheme=scheme, viewport={"width": width, "height": 800}, has_touch=width < 400
    )
    errors: list[str] = []
    context.on("console", lambda said: errors.append(said.text))
    context.on("weberror", lambda said: errors.append(str(said.error)))
    page = context.new_page()
    page.goto(live.link)
    page.wait_for_selector("#when:not(:empty)")
    assert page.inner_text("h1") == EVIL
    assert page.locator("#player").is_hidden()  # one view is no flight yet
    show(live, 0.25)
    page.wait_for_selector("#player:not([hidden]) tbody td")
    show(live, 0.5)
    page.wait_for_selector("body:not(.old)")
    shown_at(page, 0.5)
    state, before = page.inner_text("#state"), seen(page)
    show(live, 5.0)
    shown_at(page, 5.0)
    assert all(old != new for old, new in zip(before, seen(page), strict=True))
    page.get_by_label("Time", exact=True).evaluate(
        "e => { e.value = e.min; e.dispatchEvent(new Event('input')); }"
    )
    show(live, 6.0)
    page.locator("#when", has_text="0:36.0").wait_for()
    shown_at(page, 0.0)
    page.get_by_role("button", name="Newest").click()
    shown_at(page, 6.0)
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    page.wait_for_selector("body.old", timeout=10_000)
    assert page.inner_text("#state").startswith("Nothing was heard from the station for")
    assert page.title().startswith("OLD: ")
    show(live, 7.0)
    page.wait_for_selector("body:not(.old)")
    assert page.inner_text("#state") == state
    live.close()
    page.wait_for_selector("body.old")
    assert page.inner_text("#state").startswith("The station has ended. This is its last picture")
    assert errors == []
    context.close()


def test_a_station_that_died_is_no_flight_that_goes_on(browser: Any, live: BrowserMap) -> None:
    """Nothing answers any more; the page asks again, and says how old it is meanwhile."""
    page = browser.new_page()
    page.goto(live.link)
    show(live, 0.25)
    page.wait_for_selector("#player:not([hidden]) tbody td")
    live._server.close()
    page.wait_for_selector("body.old", timeout=10_000)
    assert page.inner_text("#state").startswith("Nothing was heard from the station for")
    page.close()


def shown_at(page: Any, by_s: float) -> None:
    """Wait until the player shows this moment."""
    page.locator("[data-part=now] td", has_text=f"{WELL.time_s + by_s:.1f} s").wait_for()


def seen(page: Any) -> list[str]:
    """Pixels of both views, and the values."""
    views = [
        f"document.querySelector('[data-part={view}]').toDataURL()" for view in ("plan", "scene")
    ]
    return [*(page.evaluate(view) for view in views), page.inner_text("tbody[data-part=now]")]
