"""The report of a run as one HTML page that needs nothing beside it, and the same figures as
files."""

from __future__ import annotations

import base64
import html
import io
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Final

from matplotlib.figure import Figure
from rich.console import Console, RenderableType
from rich.table import Table

from swarm_ctl.core.model.text import agents_named, printable
from swarm_ctl.errors import InputError
from swarm_ctl.report.folder.files import write_whole
from swarm_ctl.report.judge.summarise import summarise
from swarm_ctl.report.judge.summary import Summary, read_summary
from swarm_ctl.report.page.alarm_list import told
from swarm_ctl.report.page.drawing import DPI, same_scale, save
from swarm_ctl.report.page.figures import FIGURES, overlay
from swarm_ctl.report.page.flight_history import History, read_history
from swarm_ctl.report.page.summary_table import figures_of, render_summary
from swarm_ctl.station.picture.alarms import Level
from swarm_ctl.station.picture.journal import Entry

PAGE: Final = "report.html"
_STYLE: Final = """
:root { color-scheme: light dark; --ink: #1a1a1a; --paper: #fff; --rule: #ddd; --warning: #8a5a00; --error: #b00020; }
@media (prefers-color-scheme: dark) {
  :root { --ink: #e6e6e6; --paper: #17191c; --rule: #3a3d42; --warning: #f0b34a; --error: #ff8095; }
}
body { font: 15px/1.45 system-ui, sans-serif; margin: 2em auto; max-width: 90em; padding: 0 1em; color: var(--ink);
  background: var(--paper); }
h1 { font-size: 1.5em; } h2 { font-size: 1.15em; margin-top: 2em; }
pre { background: #f6f6f6; color: #1a1a1a; padding: 1em; overflow-x: auto; font: 13px/1.35 ui-monospace, monospace; }
.figures { display: grid; grid-template-columns: repeat(auto-fill, minmax(min(100%, 36em), 1fr)); gap: 1em; }
figure { margin: 0; background: #fff; color: #1a1a1a; overflow-x: auto; }
figcaption { padding: .4em .6em 0; font-size: .9em; }
img { display: block; width: 100%; min-width: 30em; max-width: 52em; height: auto; }
.broad { grid-column: 1 / -1; } .broad img { max-width: 78em; min-width: 45em; }
table { border-collapse: collapse; }
td, th { padding: .25em .8em; border-bottom: 1px solid var(--rule); text-align: left; vertical-align: top; }
.warning { color: var(--warning); } .error { color: var(--error); font-weight: 600; }
.wide { overflow-x: auto; } .time { text-align: right; white-space: nowrap; }
"""
_BROAD: Final = ("velocity",)
"""Figures of many panels."""


def make_report(folder: Path) -> Path:
    """Write figures and page into the run folder; where the page is. InputError where it is no run
    folder."""
    history = read_history(folder)
    summary = _summary(folder)
    figures = folder / "figures"
    figures.mkdir(exist_ok=True)
    parts = [_block("Summary", _pre(render_summary(summary)))]
    parts.append(
        _block("Alarms", _alarms(told(folder, history.manifest), (*history.notes, *summary.notes)))
    )
    drawn = []
    for name, draw in FIGURES:
        made = draw(history)
        if made is not None:
            picture, _ = save(made, figures, name)
            drawn.append(_image(picture.read_bytes(), name))
    parts.append(
        _block("Figures", _gallery(drawn) if drawn else "<p>The run left nothing to draw.</p>")
    )
    write_whole(folder / PAGE, _page(f"{summary.mission or folder.name}: {summary.outcome}", parts))
    return folder / PAGE


def make_comparison(folders: Sequence[Path], path: Path) -> Path:
    """Write a page with the figures of several runs side by side; where it is."""
    if len(folders) < 2:
        raise InputError(f"{len(folders)} run to compare; allowed: two or more")
    histories = [read_history(folder) for folder in folders]
    summaries = [_summary(folder) for folder in folders]
    parts = [
        _block("Numbers", _numbers(histories, summaries)),
        _block("Together", _figure(overlay(histories), "together")),
    ]
    for name, draw in FIGURES:
        made = [draw(history) for history in histories]
        if any(made):
            same_scale([figure for figure in made if figure is not None])
            side = [
                _side(history.name, name, figure)
                for history, figure in zip(histories, made, strict=True)
            ]
            parts.append(_block(name, _gallery(side)))
    write_whole(path, _page("Runs compared", parts))
    return path


def comparison_table(folders: Sequence[Path]) -> Table:
    """The same numbers for the screen."""
    table = Table("", *(folder.resolve().name for folder in folders))
    for row in _rows([_summary(folder) for folder in folders]):
        table.add_row(*row)
    return table


def _summary(folder: Path) -> Summary:
    """The summary that was written at the end, or what can be said of a run that never came to
    it."""
    try:
        return read_summary(folder)
    except InputError:
        return summarise(folder)


def _rows(summaries: Sequence[Summary]) -> list[list[str]]:
    outcome = ["outcome", *(summary.outcome for summary in summaries)]
    columns = [dict(figures_of(summary)) for summary in summaries]
    names = list(dict.fromkeys(name for column in columns for name in column))
    return [outcome, *([name, *(column.get(name, "-") for column in columns)] for name in names)]


def _numbers(histories: Sequence[History], summaries: Sequence[Summary]) -> str:
    head = "".join(f"<th>{html.escape(history.name)}</th>" for history in histories)
    rows = "".join(
        "<tr>" + "".join(f"<td>{html.escape(cell)}</td>" for cell in row) + "</tr>"
        for row in _rows(summaries)
    )
    return f'<div class="wide"><table><tr><th></th>{head}</tr>{rows}</table></div>'


def _alarms(entries: Iterable[Entry], notes: Sequence[str]) -> str:
    rows = [
        _alarm(f"{entry.time_s:.1f} s", agents_named(entry.agents) if entry.agents else "", entry.kind, entry.level,
               entry.text + (f" (×{entry.count})" if entry.count > 1 else ""))
        for entry in entries
    ]  # fmt: skip
    rows += [_alarm("", "", "note", Level.WARNING, note) for note in dict.fromkeys(notes)]
    return f'<div class="wide"><table>{"".join(rows)}</table></div>' if rows else "<p>None.</p>"


def _alarm(time: str, who: str, kind: str, level: Level, text: str) -> str:
    cells = "".join(f"<td>{html.escape(printable(cell, 1000))}</td>" for cell in (who, kind, text))
    return f'<tr class="{level.name.lower()}"><td class="time">{time}</td>{cells}</tr>'


def _pre(what: RenderableType) -> str:
    console = Console(record=True, width=110, file=io.StringIO(), force_terminal=True)
    console.print(what)
    return console.export_html(inline_styles=True, code_format="<pre>{code}</pre>")


def _gallery(figures: Iterable[str]) -> str:
    return f'<div class="figures">{"".join(figures)}</div>'


def _side(run: str, name: str, made: Figure | None) -> str:
    if made is None:
        return f"<figure><figcaption>{html.escape(run)}: nothing to draw</figcaption></figure>"
    return _figure(made, name, run)


def _figure(made: Figure, name: str, caption: str = "") -> str:
    data = io.BytesIO()
    made.savefig(data, format="png", dpi=DPI)
    return _image(data.getvalue(), name, caption)


def _image(png: bytes, name: str, caption: str = "") -> str:
    text = base64.b64encode(png).decode()
    alt = html.escape(f"{caption}: {name}" if caption else name)
    above = f"<figcaption>{html.escape(caption)}</figcaption>" if caption else ""
    broad = ' class="broad"' if name in _BROAD else ""
    return f'<figure{broad}>{above}<img alt="{alt}" title="{alt}" src="data:image/png;base64,{text}"></figure>'


def _block(title: str, content: str) -> str:
    return f"<h2>{html.escape(title)}</h2>{content}"


def _page(title: str, parts: Iterable[str]) -> str:
    return (
        f'<!doctype html><html lang="en"><head><meta charset="utf-8">'
        f'<meta name="viewport" content="width=device-width, initial-scale=1"><title>{html.escape(title)}</title>'
        f"<style>{_STYLE}</style></head><body><h1>{html.escape(title)}</h1>{''.join(parts)}</body></html>\n"
    )
