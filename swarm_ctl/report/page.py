"""The report of a run as one HTML page that needs nothing beside it, and the same figures as files."""

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

from swarm_ctl.core.state import Event
from swarm_ctl.core.text import printable
from swarm_ctl.errors import InputError
from swarm_ctl.report.accounts import read_events
from swarm_ctl.report.drawing import save
from swarm_ctl.report.figures import FIGURES, overlay
from swarm_ctl.report.files import write_whole
from swarm_ctl.report.history import History, read_history
from swarm_ctl.report.summarise import summarise
from swarm_ctl.report.summary import Summary, read_summary
from swarm_ctl.report.table import figures_of, render_summary

PAGE: Final = "report.html"
_STYLE: Final = """
body { font: 15px/1.45 system-ui, sans-serif; margin: 2em auto; max-width: 72em; padding: 0 1em; color: #1a1a1a; }
h1 { font-size: 1.5em; } h2 { font-size: 1.15em; margin-top: 2em; }
pre { background: #f6f6f6; padding: 1em; overflow-x: auto; font: 13px/1.35 ui-monospace, monospace; }
figure { margin: 1em 0; display: inline-block; vertical-align: top; max-width: 100%; }
img { max-width: 100%; height: auto; }
table { border-collapse: collapse; } td, th { padding: .25em .8em; border-bottom: 1px solid #ddd; text-align: left; }
.warning { color: #8a5a00; } .error { color: #b00020; font-weight: 600; }
.wide { overflow-x: auto; } .side figure { max-width: 46%; }
"""


def make_report(folder: Path) -> Path:
    """Write figures and page into the run folder; where the page is. InputError where it is no run folder."""
    history = read_history(folder)
    summary = _summary(folder)
    figures = folder / "figures"
    figures.mkdir(exist_ok=True)
    parts = [_block("Summary", _pre(render_summary(summary)))]
    parts.append(_block("Alarms", _alarms(read_events(folder, []), (*history.notes, *summary.notes))))
    drawn = []
    for name, draw in FIGURES:
        made = draw(history)
        if made is not None:
            picture, _ = save(made, figures, name)
            drawn.append(_image(picture.read_bytes(), name))
    parts.append(_block("Figures", "".join(drawn) or "<p>The run left nothing to draw.</p>"))
    write_whole(folder / PAGE, _page(f"{summary.mission or folder.name}: {summary.outcome}", parts))
    return folder / PAGE


def make_comparison(folders: Sequence[Path], path: Path) -> Path:
    """Write a page with the figures of several runs side by side; where it is."""
    if len(folders) < 2:
        raise InputError(f"{len(folders)} run to compare; allowed: two or more")
    histories = [read_history(folder) for folder in folders]
    summaries = [_summary(folder) for folder in folders]
    both = overlay(histories)
    parts = [_block("Numbers", _numbers(histories, summaries)), _block("Together", _figure(both, "together"))]
    for name, draw in FIGURES:
        made = [(history.name, draw(history)) for history in histories]
        side = "".join(_figure(found, f"{run}: {name}") for run, found in made if found is not None)
        if side:
            parts.append(_block(name, f'<div class="side">{side}</div>'))
    write_whole(path, _page("Runs compared", parts))
    return path


def comparison_table(folders: Sequence[Path]) -> Table:
    """The same numbers for the screen."""
    table = Table("", *(folder.resolve().name for folder in folders))
    for row in _rows([_summary(folder) for folder in folders]):
        table.add_row(*row)
    return table


def _summary(folder: Path) -> Summary:
    """The summary that was written at the end, or what can be said of a run that never came to it."""
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
        "<tr>" + "".join(f"<td>{html.escape(cell)}</td>" for cell in row) + "</tr>" for row in _rows(summaries)
    )
    return f'<div class="wide"><table><tr><th></th>{head}</tr>{rows}</table></div>'


def _alarms(events: Iterable[Event], notes: Sequence[str]) -> str:
    rows = [
        f'<tr class="{html.escape(event.level)}"><td>{event.time_s:.1f} s</td><td>agent {event.agent}</td>'
        f"<td>{html.escape(event.level)}</td><td>{html.escape(printable(event.text, 1000))}</td></tr>"
        for event in events
        if event.level != "info"
    ]
    rows += [
        f'<tr class="warning"><td></td><td></td><td>note</td><td>{html.escape(printable(note, 1000))}</td></tr>'
        for note in dict.fromkeys(notes)
    ]
    return f"<table>{''.join(rows)}</table>" if rows else "<p>None.</p>"


def _pre(what: RenderableType) -> str:
    console = Console(record=True, width=110, file=io.StringIO(), force_terminal=True)
    console.print(what)
    return console.export_html(inline_styles=True, code_format="<pre>{code}</pre>")


def _figure(made: Figure, name: str) -> str:
    data = io.BytesIO()
    made.savefig(data, format="png", dpi=130)
    return _image(data.getvalue(), name)


def _image(png: bytes, name: str) -> str:
    text = base64.b64encode(png).decode()
    alt = html.escape(name)
    return f'<figure><img alt="{alt}" title="{alt}" src="data:image/png;base64,{text}"></figure>'


def _block(title: str, content: str) -> str:
    return f"<h2>{html.escape(title)}</h2>{content}"


def _page(title: str, parts: Iterable[str]) -> str:
    return (
        f'<!doctype html><html lang="en"><head><meta charset="utf-8"><title>{html.escape(title)}</title>'
        f"<style>{_STYLE}</style></head><body><h1>{html.escape(title)}</h1>{''.join(parts)}</body></html>\n"
    )
