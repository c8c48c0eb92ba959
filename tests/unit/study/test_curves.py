"""`study --curves`: what fails over one quantity, as a picture."""

from __future__ import annotations

from pathlib import Path

import pytest
from typer.testing import CliRunner

from swarm_ctl.cli.app import app
from swarm_ctl.errors import InputError
from swarm_ctl.study.curves import draw_curves
from swarm_ctl.study.parameter_space import Study
from swarm_ctl.study.rows import read_rows

FLOWN = ["study", "--n", "6", "--start", "crossing", "--slots", "given", "--missions", "3"]
FLOWN += ["--limit", "20", "--processes", "1"]


def test_a_study_is_drawn_over_its_last_list_of_numbers(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A line in each of the three panels for each combination of the other lists; words, and
    ranges that missions draw from, are no axis."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "c.png").write_text("another picture")
    varied = ["--safety", "off,align", "--delay", "0,0.2", "--spacing", "2:2.5,2.5:3"]
    ran = CliRunner().invoke(app, [*FLOWN, *varied, "--curves", "c.svg"])
    assert ran.exit_code == 0, ran.output
    drawn = (tmp_path / "c.svg").read_text()
    assert "delay [s]" in drawn
    assert "24 missions" in drawn
    for line in ("off, 2:2.5", "align, 2.5:3"):
        assert line in drawn
    assert (tmp_path / "c.png").read_text() == "another picture"


def test_a_study_without_an_axis_and_a_file_of_another_kind_are_refused(tmp_path: Path) -> None:
    study = Study(start=("crossing", "random"))
    with pytest.raises(InputError, match="no list of numbers"):
        draw_curves(study, [], ("start",), tmp_path / "c.svg")
    with pytest.raises(InputError, match=r"allowed: \.svg, \.png"):
        draw_curves(study, [], ("start",), tmp_path / "c.pdf")


def test_the_points_are_the_rows_shares(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The law alone at a gain that it can't fly fails in the share of the rows that failed."""
    import matplotlib.axes

    plotted: list[list[float]] = []
    plot = matplotlib.axes.Axes.plot

    def kept(axes: matplotlib.axes.Axes, x: list[float], y: list[float], **style: object) -> object:
        plotted.append(list(y))
        return plot(axes, x, y, **style)  # type: ignore[arg-type]  # styles of any kind

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(matplotlib.axes.Axes, "plot", kept)
    varied = ["--safety", "off", "--h", "0.05,0.2", "--delay", "0.2"]
    ran = CliRunner().invoke(app, [*FLOWN, *varied, "--out", "r.csv", "--curves", "c.png"])
    assert ran.exit_code == 0, ran.output
    rows = list(read_rows(tmp_path / "r.csv"))
    under = [100 * sum(r["collided"] > 0 for r in rows if r["cell"] == c) / 3 for c in (0, 1)]
    smallest = [min(r["smallest_units"] for r in rows if r["cell"] == c) for c in (0, 1)]
    assert plotted[0] == pytest.approx(under)
    assert plotted[2] == pytest.approx(smallest)
    assert max(under) > 0


def test_curves_without_an_axis_are_refused_before_anything_is_flown(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    ran = CliRunner().invoke(app, [*FLOWN, "--curves", "c.svg"])
    assert isinstance(ran.exception, InputError)
    assert not list(tmp_path.iterdir())
