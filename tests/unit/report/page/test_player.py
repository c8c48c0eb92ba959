"""The player of a report: its data against the flight, and itself in headless Chromium."""

from __future__ import annotations

import base64
import hashlib
import json
import math
import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from swarm_ctl.core.model.frames import geodetic_from_ned
from swarm_ctl.core.model.messages import TargetWord
from swarm_ctl.core.model.plan import Zone
from swarm_ctl.core.model.steps.follow import FollowStep
from swarm_ctl.report.page.html_page import make_comparison, make_report
from swarm_ctl.report.page.player import OFF_M, player
from swarm_ctl.report.page.run_history import RunHistory, read_history
from swarm_ctl.runfolder.run_folder import ZoneSpell
from swarm_ctl.station.picture.alarms import Level
from swarm_ctl.station.picture.journal import EntryKind, JournalLine
from tests.unit.chromium import chromium
from tests.unit.report.run_folders import FORM, HOLD, draw_nothing, position, write_run

EVIL = "</script><script>document.title='run'</script>"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("made") / "run"
    made.mkdir()
    return write_run(made)


@pytest.fixture(scope="module")
def history(folder: Path) -> RunHistory:
    return read_history(folder)


def data_of(page: str) -> dict[str, Any]:
    """The flights that a page carries."""
    found = re.search(r'id="flight">(.*?)</script>', page)
    assert found
    told: dict[str, Any] = json.loads(found[1])
    return told


def unpacked(text: str, kind: str) -> Any:
    return np.frombuffer(base64.b64decode(text), kind)


def test_the_page_keeps_the_flight_within_the_error_it_states(history: RunHistory) -> None:
    """Straight lines between the places of the page are as near the flight as the page says;
    of a smooth one it keeps fewer."""
    smooth = history.flight.position_ned_m * (1.0, 1.0, 0.0)
    smooth[..., 0] += 5.0 * np.sin(history.flight.time_s / 3.0)[:, None]
    history = replace(history, flight=replace(history.flight, position_ned_m=smooth))
    (run,) = data_of(player([(history, [])]))["runs"]
    times = unpacked(run["times_s"], "<f4")
    places = unpacked(run["places"], "<i2").reshape(len(times), 6, 3) * run["grain_m"]
    places = places + run["middle_m"]
    flown = history.flight.position_ned_m
    assert len(times) < len(flown)
    for agent in range(6):
        drawn = [np.interp(history.flight.time_s, times, places[:, agent, c]) for c in range(2)]
        off = np.linalg.norm(np.stack(drawn, axis=-1) - flown[:, agent, :2], axis=-1)
        assert off.max() <= run["off_m"] + 1e-3
    assert 0.0 < run["off_m"] <= OFF_M + run["grain_m"]


def test_the_values_are_those_of_the_flight(history: RunHistory) -> None:
    """Nearest distance and its pair, at a moment when both are known otherwise."""
    (run,) = data_of(player([(history, [])]))["runs"]
    k = int(np.argmin(np.abs(history.flight.time_s - 26.0)))
    where = np.array([position(agent, 26.0)[:2] for agent in range(1, 7)])
    apart = np.linalg.norm(where[:, None] - where[None], axis=-1) + np.diag([np.inf] * 6)
    assert unpacked(run["curves"]["near_m"], "<f4")[k] == pytest.approx(apart.min())
    i, j = unpacked(run["curves"]["pairs"], "<u2").reshape(-1, 2)[k]
    assert apart[i, j] == pytest.approx(apart.min())


def test_a_home_is_where_one_stood_before_it_took_off(history: RunHistory) -> None:
    (run,) = data_of(player([(history, [])]))["runs"]
    flight = history.flight
    first = np.argmax(np.isfinite(flight.position_ned_m).all(axis=-1), axis=0)
    known = [None if flight.airborne[first[k], k] else k for k in range(6)]
    assert any(k is not None for k in known)
    for home, k in zip(run["homes"], known, strict=True):
        stood = None if k is None else flight.position_ned_m[first[k], k, :2]
        assert home == (None if stood is None else pytest.approx(stood, abs=0.01))


def test_zones_are_shown_while_they_hold(history: RunHistory) -> None:
    a, b = (Zone(name, ((50.0, 5.0 * k),), 1.0, 1.25) for k, name in enumerate("ab"))
    spells = (ZoneSpell(a, -math.inf, 20.3), ZoneSpell(b, 9.62, math.inf))
    told = replace(history, run=replace(history.run, zones=spells))
    (run,) = data_of(player([(told, [])]))["runs"]
    shown = [(zone["name"], zone["since"], zone["until"]) for zone in run["zones"]]
    assert shown == [("a", None, 20.3), ("b", 9.6, None)]


def followed(history: RunHistory, off_m: tuple[float, float]) -> RunHistory:
    """The same flight, its hold being a `follow` of a boat that is so far from the centre, by words
    at 5 Hz of which three seconds are lost."""
    step = FollowStep("boat", (0.0, 0.0), False, 5.0, 30.0, timeout_s=60.0)
    (group,) = history.plan.groups
    steps = (*group.steps[: K - 1], step, *group.steps[K:])
    plan = replace(history.plan, groups=(replace(group, steps=steps),))
    words = []
    for time_s, places in zip(
        history.flight.time_s[::2], history.flight.points_m[::2], strict=True
    ):
        north, east = np.nanmean(places, axis=0) + off_m
        at = geodetic_from_ned((north, east, 0.0), history.plan.origin)
        if not GAP[0] < time_s < GAP[1]:
            word = TargetWord("boat", at.lat_deg, at.lon_deg, 0.1, altitude_m=at.alt_m, agent=1)
            words.append((float(time_s), word))
    manifest = history.manifest.model_copy(update={"plan": plan})
    run = replace(history.run, manifest=manifest)
    heard = replace(history.heard, targets={"boat": words})
    return replace(history, run=run, manifest=manifest, heard=heard)


K, GAP = 3, (34.0, 37.0)


def test_a_target_is_where_its_words_say(history: RunHistory) -> None:
    """Five metres from the formation's centre: so far off are its vehicles' places, and where
    nothing was told, nothing is known."""
    flown = followed(history, (3.0, -4.0))
    (target,) = data_of(player([(flown, [])]))["runs"][0]["targets"]
    assert target["name"] == "boat"
    centre = np.nanmean(history.flight.points_m[::2], axis=1)[0]
    assert target["at"][0][:2] == pytest.approx(centre + np.array((3.0, -4.0)), abs=0.02)
    times, off_m = history.flight.time_s, flown.off_targets()
    group = flown.run.groups[0]
    during = (times >= group.start_s(K)) & (times <= group.landing_s())
    known = during & ((times < GAP[0]) | (times > GAP[1] + 0.2))
    errors_m = np.linalg.norm(history.deviations(), axis=-1)
    assert np.nanmax(np.abs(off_m[known] - 5.0)) <= np.nanmax(errors_m[known]) + 0.05
    assert np.isnan(off_m[during & (times > GAP[0] + 0.2) & (times < GAP[1] - 0.2)]).all()
    assert np.isnan(off_m[times < group.start_s(K)]).all()


def test_only_the_players_own_script_may_run(pages: tuple[Path, Path], history: RunHistory) -> None:
    """The policy has the hash of the one script; text of a run cannot end the data."""
    entry = JournalLine(25.0, EntryKind.ALARM, Level.ERROR, (1,), EVIL)
    part = player([(history, [entry])])
    assert part.count("<script") == 2
    assert EVIL in data_of(part)["runs"][0]["marks"][0]["text"]
    script = re.findall(r"<script>(.*?)</script>", part, re.DOTALL)[0]
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    page = pages[0].read_text()
    assert f"script-src 'sha256-{digest}'\"" in page
    assert "default-src 'none'" in page


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with chromium() as opened:
        yield opened


@pytest.fixture(scope="module")
def pages(folder: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """Of one run, and of two."""
    both = tmp_path_factory.mktemp("both") / "compare.html"
    with pytest.MonkeyPatch.context() as patched:
        draw_nothing(patched)  # beside the player, figures are not looked at
        return make_report(folder), make_comparison([folder, folder], both)


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_it_plays_in_chromium(browser: Any, pages: tuple[Path, Path], scheme: str) -> None:
    """Offline and without an error: the slider moves both views and the values, space plays, a
    step is jumped to; two runs lie over one another (in light alone)."""
    one, both = pages
    context = browser.new_context(color_scheme=scheme, offline=True)
    errors: list[str] = []
    context.on("console", lambda said: errors.append(said.text))
    context.on("weberror", lambda said: errors.append(str(said.error)))
    for page_file, runs in ((one, 1), (both, 2))[: 2 if scheme == "light" else 1]:
        page = context.new_page()
        page.goto(page_file.as_uri())
        page.wait_for_selector("#player:not([hidden]) tbody td")
        page.keyboard.press("]")
        before = _seen(page)
        page.get_by_label("Time", exact=True).evaluate(
            "e => { e.value = (+e.min + +e.max) / 2; e.dispatchEvent(new Event('input')); }"
        )
        page.wait_for_timeout(100)
        assert all(old != new for old, new in zip(before, _seen(page), strict=True))
        assert page.locator("tbody[data-part=now] tr").count() == runs
        page.get_by_label("Speed").select_option("20")
        page.locator("h1").click()
        start_s = _time(page)
        page.keyboard.press("Space")
        page.wait_for_timeout(500)  # the policy keeps playwright from waiting by a script
        assert _time(page) > start_s + 1
        page.keyboard.press("Space")
        page.locator("[data-part=steps] button", has_text="hold").first.click()
        assert _time(page) == pytest.approx(HOLD if runs == 1 else HOLD - FORM)
    assert errors == []
    context.close()


def _seen(page: Any) -> list[str]:
    """Pixels of both views, and the values."""
    views = [
        f"document.querySelector('[data-part={view}]').toDataURL()" for view in ("plan", "scene")
    ]
    return [*(page.evaluate(view) for view in views), page.inner_text("tbody[data-part=now]")]


def _time(page: Any) -> float:
    return float(page.input_value("[data-part=time]"))
