"""The laws beside the paper's do what was published of them; `law check` finds what a law must not
do; compiled and called, a law flies the same."""

from __future__ import annotations

import io
import itertools
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from swarm_ctl import law_loader
from swarm_ctl.core.kernel.receiver import NO_ONE, SOMEONE, Known, Me
from swarm_ctl.errors import InputError
from swarm_ctl.law_loader import found_laws, own_law
from swarm_ctl.study.batch import batch_flight, compiled, flight
from swarm_ctl.study.batch.batch import draw
from swarm_ctl.study.batch.batch_flight import BatchResult, fly
from swarm_ctl.study.batch.compiled import law_compiled
from swarm_ctl.study.law_check import checked
from swarm_ctl.study.league import draw_league, fly_league, laws_of, ranked, studies_of, table
from swarm_ctl.study.parameter_space import Study
from tests.unit.study.flown import held_alike

LAWS = ("potential_field", "leader", "vasarhelyi", "orca", "noise", "hostile")


def terms(name: str, me: Me, *others: Known, **values: float) -> tuple[complex, complex]:
    found = own_law(name)
    numbers = found.law.numbers(*(each.value for each in found.given(values)))
    along, away, _ = found.law.form(me, others, numbers, [0.0] * found.law.memory, [])
    return along, away


def studied(name: str, **given_: Any) -> BatchResult:
    study = Study.model_validate({"law": {"own": name}, "h": "0.2", "missions": 10, **given_})
    return fly(draw(study.cells()[0], 0, study.missions))


# --- what was published ---


def test_vasarhelyi_flocks() -> None:
    """With the published numbers for 4 m/s (a unit is a metre) and no shape, thirty agents with
    random headings fly one way within a minute, at the flock's speed, and nobody meets anybody."""
    found, random = own_law("vasarhelyi"), np.random.default_rng(3)
    published = {"r0_rep": 25.6, "p_rep": 0.13, "r0_frict": 85.3, "c_frict": 0.05}
    published |= {"v_frict": 0.63, "p_frict": 3.2, "a_frict": 4.16, "cruise": 4.0, "gather": 0.0}
    numbers = found.law.numbers(*(each.value for each in found.given(published)))
    grid = [complex(15.0 * i, 15.0 * j) for i, j in itertools.product(range(6), range(5))]
    at = [p + complex(*random.uniform(-4, 4, 2)) for p in grid]
    flies = [4.0 * np.exp(1j * angle).item() for angle in random.uniform(0, 2 * np.pi, 30)]
    order, nearest = [0.0], math.inf
    for _ in range(240):
        rows = [
            NO_ONE._replace(id=j + 1, at=p, flies=v)
            for j, (p, v) in enumerate(zip(at, flies, strict=True))
        ]
        wishes = []
        for i in range(30):
            me = SOMEONE._replace(id=i + 1, at=at[i], flies=flies[i], speed=8.0, tick_s=0.25)
            wish = sum(found.law.form(me, rows[:i] + rows[i + 1 :], numbers, [], [])[:2])
            wishes.append(wish * min(1.0, 8.0 / max(abs(wish), 1e-9)))
        flies = [v + (w - v) * 0.25 for v, w in zip(flies, wishes, strict=True)]  # tau 1 s
        at = [p + v * 0.25 for p, v in zip(at, flies, strict=True)]
        order.append(abs(sum(v / abs(v) for v in flies)) / 30)
        nearest = min(nearest, min(abs(p - q) for p, q in itertools.combinations(at, 2)))
    assert order[1] < 0.5
    assert order[-1] > 0.95
    assert nearest > 3.0
    assert np.mean(np.abs(flies)) == pytest.approx(4.0, rel=0.15)


def test_orca_keeps_ideal_vehicles_apart() -> None:
    """Points that fly what they are told, and hear each other at once: none comes nearer than
    `apart`, though all pass through the middle. Some block each other there for good, as known."""
    swap = {"vehicle": "ideal", "safety": "off", "compensation": "none", "limit_s": 60.0}
    for n in (2, 8):
        flown = studied("orca", **swap, n=n, start="antipodal", slots="given")
        assert flown.smallest == pytest.approx(0.85, abs=1e-3)
        assert flown.converged.any()


def test_orca_shares_the_way_round() -> None:
    """Two head-on: each gives way by as much as the other, to opposite sides, and flies on."""
    one = SOMEONE._replace(at=-2 + 0.1j, slot=2 + 0j, flies=0.9 + 0j)
    two = SOMEONE._replace(id=2, at=2 - 0.1j, slot=-2 + 0j, flies=-0.9 + 0j)

    def seen(me: Me, *, lower: bool) -> Known:
        return Known(me.id, me.at, me.slot, me.flies, 0.0, True, lower)

    first = sum(terms("orca", one, seen(two, lower=True)))
    second = sum(terms("orca", two, seen(one, lower=False)))
    assert first == pytest.approx(-second, abs=1e-6)
    assert abs(first.imag) > 0.05
    assert abs(first) <= one.speed + 1e-9


def test_the_field_pushes_as_khatib_s() -> None:
    """eta (1/x - 1/width) / x^2 away from the other, and nothing beyond the width."""
    near, far = NO_ONE._replace(at=-1 + 0j), NO_ONE._replace(at=-1.6 + 0j)
    _, push = terms("potential_field", SOMEONE, near)
    assert push == pytest.approx(0.5 * (1 - 1 / 1.5))
    assert terms("potential_field", SOMEONE, far) == (0j, 0j)


def test_the_leader_stands_and_the_others_form_around_it() -> None:
    other = NO_ONE._replace(id=2, at=3 + 0j, neighbour=True)
    assert terms("leader", SOMEONE, other) == (0j, 0j)
    assert terms("leader", SOMEONE._replace(id=3), other)[0].real > 0
    assert terms("leader", SOMEONE, other, leader=2)[0].real > 0
    assert studied("leader").converged.all()


def test_the_filter_holds_the_hostile_one() -> None:
    """Without it, all run into each other."""
    bare, held = (studied("hostile", safety=each, limit_s=30.0) for each in ("off", "align"))
    assert (bare.smallest < 0.5).all()
    assert (held.smallest > 0.5).all()


# --- compiled, called ---


@settings(max_examples=6, deadline=None)
@given(
    name=st.sampled_from(LAWS),
    seed=st.integers(0, 1000),
    n=st.integers(2, 5),
    safety=st.sampled_from(("off", "align", "exchange")),
    loss=st.sampled_from(("0", "0:0.3")),
)
def test_compiled_called_and_interpreted_a_law_flies_the_same(
    name: str, seed: int, n: int, safety: str, loss: str
) -> None:
    """A compiled law in a compiled flight, a called law in a compiled flight, Python all the way,
    and where numba is not installed: to 1e-6, with late and lost states."""
    pytest.importorskip("numba")
    assert law_compiled(own_law(name).law).pointer is not None
    drawn = {"seed": seed, "n": n, "safety": safety, "loss": loss, "delay_s": "0:0.2"}
    short = {"missions": 2, "limit_s": 2.0, "start": "crossing", "slots": "random"}
    whole = studied(name, **drawn, **short)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(batch_flight, "interpreted", lambda _: True)
        called = studied(name, **drawn, **short)
        patch.setattr(batch_flight, "compiled", lambda _: flight.fly)
        interpreted = studied(name, **drawn, **short)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(compiled, "available", lambda: False)
        patch.setattr(compiled, "_whole", lambda: None)
        without = studied(name, **drawn, **short)
    for other in (called, interpreted, without):
        held_alike(whole, other, 1e-6)


# --- law check ---


@pytest.mark.parametrize("name", [*LAWS, "paper"])
def test_the_laws_that_are_here_pass(name: str) -> None:
    """But `noise`, which flies on where it hears nobody."""
    failed = {each.name for each in checked(name, _Clock(), flies=False) if each.good is False}
    assert failed == ({"silence"} if name == "noise" else set())


class _Clock:
    """So long each call takes [s]."""

    def __init__(self, each_s: float = 1e-5) -> None:
        self.now_s, self.each_s = 0.0, each_s

    def __call__(self) -> float:
        self.now_s += self.each_s
        return self.now_s


WRONG = {
    "shapes, finite": "return math.exp(abs(me.at)), 0j",
    "translation": "return 0.1 * me.at, 0j",
    "place of the shape": "return 0.1 * (me.slot if others else 0j), 0j",
    "order of rows": "return (others[0].flies if others else 0j), 0j",
    "determinism": "return next(COUNT) * (0.1 if others else 0.0), 0j",
    "rows unchanged": "others.append(others[0]) if others else None; return 0j, 0j",
    "state": "SEEN.append(me.at) if others else None; return len(SEEN) * 1e-3, 0j",
    "units": "return sum(o.at - me.at for o in others) * me.tick_s, 0j",
    "bounds": "return 0j, 1.0 / p.rate",
    "pairs on one spot": "return 0j, sum((me.at - o.at) / abs(me.at - o.at) for o in others)",
    "silence": "return 0.5, 0j",
}
"""What must not be, by the check that finds it."""


@pytest.mark.parametrize("name", [*WRONG, "time per call"])
def test_each_check_finds_what_it_looks_for(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(law_loader.FOLDER_VARIABLE, str(tmp_path))
    (tmp_path / "wrong.py").write_text(
        "import itertools, math\nfrom swarm_ctl.law import Annotated, Between, NamedTuple\n"
        "COUNT, SEEN = itertools.count(), []\n"
        "class Parameters(NamedTuple):\n    rate: Annotated[float, Between(0, 1)] = 1.0\n"
        f"def terms(me, others, p, memory):\n    {WRONG.get(name, 'return 0j, 0j')}\n"
    )
    assert "wrong" in found_laws()
    clock = _Clock(0.01 if name == "time per call" else 1e-5)
    failed = {
        each.name: each.found for each in checked("wrong", clock, flies=False) if each.good is False
    }
    assert name in failed
    assert name == "rows unchanged" or "allowed" in failed[name]


# --- the league ---


def test_the_league_flies_the_same_missions_by_each_law(tmp_path: Path) -> None:
    """Without the filter and with it; the table has intervals, the picture is written. A law that
    brings pairs under r_in stands behind the others."""
    from rich.console import Console

    plan = Study.model_validate({"n": 4, "missions": 8, "h": "0.2", "limit_s": 20.0})
    names = ["hostile", "paper", "orca"]
    each = studies_of(plan, names)
    assert [(name, *study.safety) for name, study in each[:2]] == [
        ("hostile", "off"),
        ("hostile", "align"),
    ]
    starts = [draw(study.cells()[0], 0, 8).starts for _, study in each]
    assert all(np.array_equal(start, starts[0]) for start in starts)
    console = Console(width=200, record=True, file=io.StringIO())
    places = fly_league(plan, names, tmp_path / "league.csv", 1, console)
    assert ranked(places)[-1] == "hostile"
    console.print(table(places))
    said = console.export_text()
    assert "100 % (63.1 to 100)" in said
    assert "95 % confidence intervals" in said
    draw_league(places, 0.5, tmp_path / "league.png")
    assert (tmp_path / "league.png").read_bytes().startswith(b"\x89PNG")
    rows = {path.name for path in tmp_path.glob("league-*.csv")}
    assert rows == {f"league-{name}-{way}.csv" for name in names for way in ("off", "align")}


@pytest.mark.parametrize("text", ["paper,paper", "paper,", ","])
def test_a_league_needs_different_laws(text: str) -> None:
    with pytest.raises(InputError, match="allowed: different names"):
        laws_of(text)
