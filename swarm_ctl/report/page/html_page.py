"""The report of a run: one HTML page that fetches nothing, and its figures as files."""

from __future__ import annotations

import base64
import html
import io
import itertools
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Final, ParamSpec, TypeVar

from matplotlib.figure import Figure
from rich.table import Table
from rich.text import Text

from swarm_ctl.core.model.messages import Payload, Severity
from swarm_ctl.core.model.text import agents_named, printable
from swarm_ctl.errors import InputError
from swarm_ctl.report.judge.summarise import summarise
from swarm_ctl.report.judge.summary import Summary, read_summary
from swarm_ctl.report.page.drawing import DPI, same_scale, save
from swarm_ctl.report.page.figures import FIGURES, overlay
from swarm_ctl.report.page.player import player
from swarm_ctl.report.page.player_parts import script, script_hash, style
from swarm_ctl.report.page.run_history import RunHistory, read_history
from swarm_ctl.report.page.summary_table import (
    SummaryFigure,
    figures_of,
    opening_of,
    step_rows,
    why_so,
)
from swarm_ctl.rim import Rim
from swarm_ctl.runfolder.files import write_whole
from swarm_ctl.runfolder.last_statuses import read_events
from swarm_ctl.runfolder.manifest import Manifest
from swarm_ctl.station.picture.alarms import LEVEL_OF, Level
from swarm_ctl.station.picture.journal import EntryKind, JournalLine
from swarm_ctl.station.picture.playback import Film

P = ParamSpec("P")
T = TypeVar("T")
PAGE: Final = "report.html"
_NOT_DRAWN: Final = "<p>This can't be drawn; the notes say why.</p>"
_STYLE: Final = """
:root { color-scheme: light dark; --ink: #1a1a1a; --paper: #fff; --rule: #ddd;
  --well: #1e6914; --warning: #8a5a00; --error: #b00020; }
@media (prefers-color-scheme: dark) { :root { --ink: #e6e6e6; --paper: #17191c; --rule: #3a3d42;
  --well: #8fd08a; --warning: #f0b34a; --error: #ff8095; } }
body { font: 15px/1.45 system-ui, sans-serif; margin: 2em auto; max-width: 90em; padding: 0 1em;
  color: var(--ink); background: var(--paper); }
h1 { font-size: 1.5em; margin: 0; } h2 { font-size: 1.15em; margin-top: 2em; }
.verdict { border-left: .5em solid var(--rule); padding: .2em 1em; }
.completed { border-color: var(--well); } .completed strong { color: var(--well); }
.aborted { border-color: var(--warning); } .aborted strong { color: var(--warning); }
.failed { border-color: var(--error); } .failed strong { color: var(--error); }
.verdict strong { text-transform: uppercase; } .verdict p { margin: .3em 0 .8em; }
dl { display: flex; flex-wrap: wrap; gap: .6em 2.5em; margin: 0; }
dt { font-size: .85em; opacity: .75; } dd { margin: 0; }
.sides { display: flex; flex-wrap: wrap; gap: 1em 4em; align-items: start; }
.figures { columns: 36em; column-gap: 1em; }
.figures figure { break-inside: avoid; margin-bottom: 1em; }
figure { margin: 0; background: #fff; color: #1a1a1a; overflow-x: auto; }
figcaption { padding: .4em .6em 0; font-size: .9em; }
img { display: block; width: 100%; min-width: 30em; max-width: 52em; height: auto; }
.broad { column-span: all; } .broad img { max-width: 78em; min-width: 45em; }
table { border-collapse: collapse; }
.names th { font-weight: normal; opacity: .75; white-space: nowrap; }
td, th { padding: .25em .8em; border-bottom: 1px solid var(--rule); text-align: left;
  vertical-align: top; }
.warning { color: var(--warning); } .error { color: var(--error); font-weight: 600; }
.wide { overflow-x: auto; } .time { text-align: right; white-space: nowrap; }
@media print { .bar, .hint, input { display: none !important; } h2 { break-after: avoid; } }
"""
_BROAD: Final = ("velocity",)
"""Figures of many panels."""


class _Parts:
    """Makes the parts of a page: an error in one of them costs that one."""

    def __init__(self) -> None:
        self.failed: list[str] = []
        """What could not be made, and why."""

    def make(
        self, name: str, draw: Callable[P, T], /, *args: P.args, **named: P.kwargs
    ) -> T | None:
        """The part; None where it failed, or has nothing to show."""
        rim = Rim(name)
        made = rim.run(draw, *args, **named)
        self.failed += [f"{name}: can't be drawn: {trouble.why}" for trouble in rim.troubles()]
        return made


def make_report(folder: Path) -> Path:
    """Write figures and page into the run folder; the page's path.

    Raises:
        InputError: it is no run folder.
    """
    history, summary = read_history(folder), _summary(folder)
    figures = folder / "figures"
    if figures.is_symlink():
        raise InputError(f"{figures}: is a link to elsewhere; allowed: a folder, or none yet")
    figures.mkdir(exist_ok=True)
    drawn = []
    parts_of_page = _Parts()
    for name, draw in FIGURES:
        made = parts_of_page.make(name, draw, history)
        if made is not None:
            drawn.append(_image(save(made, figures, name)[0].read_bytes(), name))
    entries = parts_of_page.make("log", _log, folder, history) or []
    flight = parts_of_page.make("flight", player, [(history, entries)])
    notes = (*parts_of_page.failed, *_notes(history, summary))
    parts = {
        "Flight": flight or _NOT_DRAWN,
        "Alarms and notes": _alarms(entries, notes),
        "Numbers": f'<div class="sides">{_steps(summary)}{_figures(figures_of(summary))}</div>',
        "Figures": _gallery(drawn) if drawn else "",
    }
    name = summary.mission or folder.name
    write_whole(folder / PAGE, _page(f"{name}: {summary.outcome}", _opening(name, summary), parts))
    return folder / PAGE


def make_comparison(folders: Sequence[Path], path: Path) -> Path:
    """Write a page with the figures of several runs side by side; its path."""
    if len(folders) < 2:
        raise InputError(f"{len(folders)} run to compare; allowed: two or more")
    histories = [read_history(folder) for folder in folders]
    names = [history.name for history in histories]
    parts_of_page = _Parts()
    flights = [
        (h, parts_of_page.make("log", _log, f, h) or [])
        for f, h in zip(folders, histories, strict=True)
    ]
    parts = {
        "Flights": parts_of_page.make("flight", player, flights) or _NOT_DRAWN,
        "Numbers": _numbers(names, [_summary(folder) for folder in folders]),
        "Together": _figure(overlay(histories), "together"),
    }
    for name, draw in FIGURES:
        made = [parts_of_page.make(name, draw, history) for history in histories]
        if any(made):
            same_scale([figure for figure in made if figure is not None])
            sides = zip(names, made, strict=True)
            parts[name] = _gallery(_side(run, name, figure) for run, figure in sides)
    if parts_of_page.failed:
        parts["Not drawn"] = "".join(f"<p>{_text(words)}</p>" for words in parts_of_page.failed)
    write_whole(path, _page("Runs compared", "<h1>Runs compared</h1>", parts))
    return path


def comparison_table(folders: Sequence[Path]) -> Table:
    """The numbers of several runs for a terminal."""
    table = Table()
    for name in ("", *(folder.resolve().name for folder in folders)):
        table.add_column(Text(printable(name)), overflow="fold")
    for row in _rows([_summary(folder) for folder in folders]):
        table.add_row(*(Text(cell) for cell in row))
    return table


def _log(folder: Path, history: RunHistory) -> list[JournalLine]:
    return log_entries(folder, history.manifest, history.heard.said)


def _notes(history: RunHistory, summary: Summary) -> tuple[str, ...]:
    return (*summary.warnings, *history.notes, *summary.notes)


def _summary(folder: Path) -> Summary:
    """The summary in the folder; a run that was killed has none, so it is made."""
    try:
        return read_summary(folder)
    except InputError:
        return summarise(folder)


def _rows(summaries: Sequence[Summary]) -> list[list[str]]:
    outcome = ["outcome", *(str(summary.outcome) for summary in summaries)]
    columns = [
        {name: value for name, value, _ in itertools.chain(opening_of(s), figures_of(s))}
        for s in summaries
    ]
    names = list(dict.fromkeys(name for column in columns for name in column))
    return [outcome, *([name, *(column.get(name, "-") for column in columns)] for name in names)]


def _numbers(names: Sequence[str], summaries: Sequence[Summary]) -> str:
    head = "".join(f"<th>{_text(name)}</th>" for name in names)
    rows = "".join(f"<tr>{_cells(row)}</tr>" for row in _rows(summaries))
    return f'<div class="wide"><table><tr><th></th>{head}</tr>{rows}</table></div>'


def _opening(name: str, summary: Summary) -> str:
    """Verdict and reason, date, duration, smallest distance."""
    facts = "".join(
        f"<div><dt>{_text(fact)}</dt><dd{_bad(good)}>{_text(value)}</dd></div>"
        for fact, value, good in opening_of(summary)
    )
    return (
        f'<header class="verdict {summary.outcome}"><h1>{_text(name)}: '
        f"<strong>{_text(summary.outcome)}</strong></h1><p>{_text(why_so(summary))}</p>"
        f"<dl>{facts}</dl></header>"
    )


def _steps(summary: Summary) -> str:
    heads, *rows = step_rows(summary)
    head = "".join(f"<th>{_text(words)}</th>" for words in heads)
    told = "".join(f"<tr>{_cells(row)}</tr>" for row in rows)
    return f'<div class="wide"><table><tr>{head}</tr>{told}</table></div>' if rows else ""


def _figures(figures: Iterable[SummaryFigure]) -> str:
    rows = "".join(
        f"<tr><th>{_text(name)}</th><td{_bad(good)}>{_text(value)}</td></tr>"
        for name, value, good in figures
    )
    return f'<div class="wide"><table class="names">{rows}</table></div>'


def _bad(good: bool) -> str:
    return "" if good else ' class="error"'


def _alarms(entries: Iterable[JournalLine], notes: Sequence[str]) -> str:
    rows = [_alarm(entry) for entry in entries]
    said = (_cells(("", "note", note)) for note in dict.fromkeys(notes))
    rows += [f'<tr class="warning"><td></td>{cells}</tr>' for cells in said]
    return f'<div class="wide"><table>{"".join(rows)}</table></div>' if rows else ""


def _alarm(entry: JournalLine) -> str:
    agents = agents_named(entry.agents) if entry.agents else ""
    times = f" (×{entry.count})" if entry.count > 1 else ""
    cells = _cells((agents, entry.kind, entry.text + times))
    time = f'<td class="time" data-s="{entry.time_s:.2f}">{entry.time_s:.1f} s</td>'
    return f'<tr class="{entry.level.name.lower()}">{time}{cells}</tr>'


def _cells(texts: Iterable[str]) -> str:
    return "".join(f"<td>{_text(text)}</td>" for text in texts)


def _text(text: str) -> str:
    """Any text as HTML: markup and control characters are escaped."""
    return html.escape(printable(text, 1000))


def _gallery(figures: Iterable[str]) -> str:
    return f'<div class="figures">{"".join(figures)}</div>'


def _side(run: str, name: str, made: Figure | None) -> str:
    if made is None:
        return f"<figure><figcaption>{_text(run)}: nothing to draw</figcaption></figure>"
    return _figure(made, name, run)


def _figure(made: Figure, name: str, caption: str = "") -> str:
    data = io.BytesIO()
    made.savefig(data, format="png", dpi=DPI)
    return _image(data.getvalue(), name, caption)


def _image(png: bytes, name: str, caption: str = "") -> str:
    alt = _text(f"{caption}: {name}" if caption else name)
    above = f"<figcaption>{_text(caption)}</figcaption>" if caption else ""
    broad = ' class="broad"' if name in _BROAD else ""
    source = f"data:image/png;base64,{base64.b64encode(png).decode()}"
    return f'<figure{broad}>{above}<img alt="{alt}" title="{alt}" src="{source}"></figure>'


def _page(title: str, opening: str, parts: Mapping[str, str]) -> str:
    """A whole page; `opening` is HTML, and so are `parts` by their headings; empty ones are left
    out."""
    found = ((heading, part) for heading, part in parts.items() if part)
    body = "".join(f"<h2>{_text(heading)}</h2>{part}" for heading, part in found)
    policy = (
        "default-src 'none'; base-uri 'none'; form-action 'none'; img-src data:; "
        f"style-src 'unsafe-inline'; script-src '{script_hash(script())}'"
    )
    return (
        '<!doctype html><html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f'<meta http-equiv="Content-Security-Policy" content="{policy}">'
        f"<title>{_text(title)}</title><style>{_STYLE}{style()}</style></head>"
        f"<body>{opening}{body}</body></html>\n"
    )


def log_entries(
    folder: Path, manifest: Manifest, said: Sequence[tuple[float, Payload]]
) -> list[JournalLine]:
    """Alarms, warnings, errors and commands, of all that the recording holds; without a recording
    the agents' warnings alone."""
    try:
        by_time = sorted(said, key=lambda message: message[0])
        film = Film([by_time], manifest.plan, speedup=manifest.speedup)
        film.seek(film.end_s)
        entries = film.journal.entries
    except InputError:  # no recording, or nothing in it: the notes say so
        entries = tuple(
            JournalLine(
                event.time_s, EntryKind.EVENT, LEVEL_OF[event.level], (event.agent,), event.text
            )
            for event in read_events(folder, [])
            if event.level is not Severity.INFO
        )
    wanted = (
        entry
        for entry in entries
        if entry.level >= Level.WARNING or entry.kind in (EntryKind.CLEARED, EntryKind.COMMAND)
    )
    return sorted(wanted, key=lambda entry: entry.time_s)
