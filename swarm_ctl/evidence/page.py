"""The evidence as a page and as JSON: what is claimed, what was found here, and what is not
covered."""

from __future__ import annotations

import html
import json
from collections import Counter
from collections.abc import Iterable
from pathlib import Path
from typing import Final

from swarm_ctl.core.model.text import printable
from swarm_ctl.engine.clock import date_and_time
from swarm_ctl.evidence.claims import ClaimRow, Claims, FlownWith
from swarm_ctl.evidence.flown import (
    FAILED,
    HOLDS,
    MOVED,
    NOT_FLOWN,
    Evidence,
    FigureAgain,
    RowAgain,
)
from swarm_ctl.runfolder.files import write_whole
from swarm_ctl.study.rows import MEANINGS

PAGE: Final = "evidence.html"
DATA: Final = "evidence.json"
SORA: Final = (
    "JARUS SORA 2.5 (main body JAR_doc_25, annexes B, D and E), by which EASA's AMC1 to Article 11"
    " (ED Decision 2025/018/R) goes. Names are its own, what it asks is said in short."
)
_HEAD: Final = (
    "No real flight stands behind these figures: missions are simulated, some by real autopilots in"
    " simulation. A bound is the exact 95 % interval (Clopper and Pearson) of a share among the"
    " missions that were drawn; it says nothing of missions outside of them. A count has to be the"
    " same; what is measured may differ by one in its last digit."
)
_READINGS: Final = {
    "missions": "How many were flown.",
    "smallest, silent, zone": "The least of the columns smallest_units, smallest_silent_units,"
    " smallest_zone_units; /r_in: in r_in.",
    "median, p95": "Of the times at which the formation stood, where it did [s].",
    **{name: MEANINGS[name] for name in ("collided", "hit", "entered", "converged")},
    "kept_broken": "1 and more: links of live agents got longer than r while their slots were"
    " within 0.9 r.",
    "collided%, collided<": "The missions' share in %, and the upper end of its interval.",
    "after these": "Columns and their values, of the missions that count; a..b is a range.",
}
"""What the figures' lines call what they read."""
_SHORT: Final = 5
"""So many lines are shown without a click."""
_STYLE: Final = """
:root { color-scheme: light dark; --rule: #ddd; --good: #1b6e2e; --bad: #b00020; --dim: #666; }
@media (prefers-color-scheme: dark) { :root { --rule: #3a3d42; --good: #7fd494; --bad: #ff8095;
  --dim: #a0a4aa; } body { background: #17191c; color: #e6e6e6; } }
body { font: 15px/1.45 system-ui, sans-serif; margin: 2em auto; max-width: 90em; padding: 0 1em; }
h1 { font-size: 1.5em; } h2 { font-size: 1.15em; margin-top: 2em; } .wide { overflow-x: auto; }
table { border-collapse: collapse; width: 100%; }
td, th { padding: .35em .8em .35em 0; border-bottom: 1px solid var(--rule); text-align: left;
  vertical-align: top; } .claims th { width: 28%; }
table.claims { table-layout: fixed; } .claims th:last-child { width: 16%; }
td p { margin: 0 0 .3em; }
code { font: 12px/1.4 ui-monospace, monospace; overflow-wrap: anywhere; }
.holds { color: var(--good); }
.moved, .failed, .moved-figure { color: var(--bad); font-weight: 600; }
ul { margin: 0; padding-left: 1.2em; font-size: .9em; }
.dim { color: var(--dim); } .state { white-space: nowrap; }
"""


def write_evidence(evidence: Evidence, claims: Claims) -> Path:
    """Write `evidence.json` and the page into the folder; the page's path."""
    at = date_and_time().isoformat(timespec="seconds")
    done = evidence.done
    rows = [
        row.model_dump(mode="json") | {"found": again.model_dump() if again else None}
        for row in claims.rows
        for again in [done.get(row.name)]
    ]
    sora = [row.model_dump() for row in claims.sora]
    data = {"at": at, "made_with": evidence.made, "rows": rows, "sora": sora}
    write_whole(evidence.folder / DATA, json.dumps(data, indent=1, ensure_ascii=False) + "\n")
    write_whole(evidence.folder / PAGE, _page(evidence, claims, at))
    return evidence.folder / PAGE


def counted(evidence: Evidence, claims: Claims) -> str:
    """`11 hold, 1 moved, 20 not flown here`."""
    states = Counter(
        evidence.done[row.name].state if row.name in evidence.done else NOT_FLOWN
        for row in claims.rows
    )
    words = {HOLDS: "hold", MOVED: "moved", FAILED: "failed", NOT_FLOWN: "not flown here"}
    return ", ".join(f"{states[state]} {words[state]}" for state in words if states[state])


def told(again: RowAgain) -> str:
    """What was found, in a line."""
    moved = [
        f"{each.read} is {each.found}, not {each.said}" for each in again.figures if not each.same
    ]
    same = len(again.figures) - len(moved)
    counted = f"{same} figure{'s' * (same > 1)} as said" if same else ""
    more = [f"and {len(moved) - _SHORT} more"] if len(moved) > _SHORT else []
    return "; ".join(filter(None, [again.why, counted, *moved[:_SHORT], *more]))


def _page(evidence: Evidence, claims: Claims, at: str) -> str:
    made = evidence.made
    changed = " Files were changed beside this commit." if made["commit"].endswith("+") else ""
    title = f"Evidence of swarm-ctl {made['version']}"
    flown = ("claim", "found here", "by", "limits")
    asked = ("SORA 2.5", "asks for", "covered", "rows", "why")
    return (
        '<!doctype html><html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        '<meta http-equiv="Content-Security-Policy" content="default-src \'none\'; style-src'
        f" 'unsafe-inline'\"><title>{_text(title)}</title><style>{_STYLE}</style></head><body>"
        f"<h1>{_text(title)}</h1><p>{_text(counted(evidence, claims))}.</p><p>{_text(_HEAD)}</p>"
        f"<p>Commit <code>{_text(made['commit'])}</code>.{changed} {_text(at)}, on"
        f" {_text(made['machine'])}, Python {_text(made['python'])}, numpy"
        f" {_text(made['numpy'])}.</p><h2>Claims</h2>"
        f"<details><summary>what figures are called</summary>{_readings()}</details>"
        + _table(flown, (_claim(row, evidence.done.get(row.name)) for row in claims.rows), "claims")
        + f"<h2>What an assessor asks for</h2><p>{_text(SORA)}</p>"
        + _table(
            asked,
            (
                f"<tr><td>{_text(row.name)}</td><td>{_text(row.asks)}</td>"
                f'<td class="{"state" if row.rows else "dim state"}">{_text(row.covered)}</td><td>'
                + "<br>".join(f'<a href="#{_text(n)}">{_text(n)}</a>' for n in row.rows)
                + f"</td><td>{_text(row.why)}</td></tr>"
                for row in claims.sora
            ),
        )
        + "</body></html>\n"
    )


def _claim(row: ClaimRow, again: RowAgain | None) -> str:
    state = again.state if again else NOT_FLOWN
    if again:
        seed = f"seed {again.seed}; " if again.seed != "-" else ""
        lines = "".join(map(_figure, again.figures))
        more = _folded("figures", f"<ul>{lines}</ul>", len(again.figures))
        found = (
            f"<p>{_text(told(again))}</p>{more}<p class='dim'>{_text(seed)}{again.took_s:.0f} s, of"
            f" the processors {again.cpu_s:.0f} s; {_text(again.at)}</p>"
        )
    else:
        how = f"swarm-ctl evidence --row {row.name}"
        by_hand = " (by hand: its figures are the machine's, or it takes days)"
        found = (
            f"<p><code>{_text(how)}</code>{by_hand if row.flown is FlownWith.BY_HAND else ''}</p>"
        )
    said = [f"“{words.strip('| ').replace('`', '')}”" for words in row.words]
    said += [f"{name.replace('#', ', ')}: the whole section" for name in row.sections]
    words = _folded("on pages", "".join(f"<p>{_text(each)}</p>" for each in said), len(said))
    return (
        f'<tr id="{_text(row.name)}"><td><p><b>{_text(row.name)}</b>: {_text(row.claim)}</p>'
        f'<div class="dim">{words}</div></td>'
        f'<td><p class="{state.replace(" ", "-")} state">{state}</p>{found}</td>'
        f"<td><p>{row.method}</p><code>{_text(row.command)}</code></td>"
        f"<td>{_text(row.limits.replace('`', ''))}</td></tr>"
    )


def _figure(again: FigureAgain) -> str:
    bound = f"; 95 %: {again.bound}" if again.bound else ""
    said, state = ("", HOLDS) if again.same else (f", where {again.said} is said", MOVED)
    return f'<li class="{state}-figure">{_text(f"{again.read}: {again.found}{said}{bound}")}</li>'


def _readings() -> str:
    lines = (f"<dt>{_text(name)}</dt><dd>{_text(means)}</dd>" for name, means in _READINGS.items())
    return f"<dl>{''.join(lines)}</dl>".replace("`", "")


def _folded(what: str, inside: str, count: int) -> str:
    """Open where it is short."""
    shown = " open" if count <= _SHORT else ""
    return f"<details{shown}><summary>{what} ({count})</summary>{inside}</details>" * bool(count)


def _table(head: Iterable[str], lines: Iterable[str], kind: str = "") -> str:
    cells = "".join(f"<th>{_text(name)}</th>" for name in head)
    return f'<div class="wide"><table class="{kind}"><tr>{cells}</tr>{"".join(lines)}</table></div>'


def _text(text: str) -> str:
    return html.escape(printable(text, 2000))
