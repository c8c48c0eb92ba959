"""Flies rows of the evidence again, each as the command that a reader would type, and reads what
came of it. A folder keeps a journal, so the same command goes on where one was ended."""

from __future__ import annotations

import hashlib
import json
import math
import os
import platform
import re
import shlex
import signal
import subprocess
import sys
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
from pydantic import BaseModel, ValidationError

from swarm_ctl.cores import cores
from swarm_ctl.engine.clock import date_and_time, wall_s
from swarm_ctl.errors import InputError, StartError
from swarm_ctl.evidence.claims import ClaimRow, Figure, FlownWith
from swarm_ctl.files import append_line
from swarm_ctl.fuzz.campaign import FLIGHTS, DrawnFlight
from swarm_ctl.installed import commit, version
from swarm_ctl.runfolder.files import Damage, read_lines, write_whole
from swarm_ctl.study.rows import Row, read_rows, study_of
from swarm_ctl.study.rows_table import exact_interval

ROOT: Final = Path(__file__).parents[2]
JOURNAL: Final = "journal.jsonl"
HOLDS, MOVED, FAILED, NOT_FLOWN = "holds", "moved", "failed", "not flown"
_SHORT: Final = {
    "smallest": "smallest_units",
    "silent": "smallest_silent_units",
    "zone": "smallest_zone_units",
}
"""Readings that are the least of a column."""
_ZERO: Final = ("no", "none")
_TIMES: Final = {"median": 50, "p95": 95}
"""Percentiles of the time to form, of what formed."""
_SKIPPED: Final = re.compile(r"SKIPPED \[(\d+)\] (.*)")
_ENDS_S: Final = 20.0
"""Wall time that a command has to end by itself."""


class FigureAgain(BaseModel):
    """One figure, read again."""

    read: str
    """What was read, and in which rows."""
    said: str
    of: str
    """The page's words that it stands in."""
    found: str
    bound: str = ""
    """Of a share, with 95 % confidence."""
    same: bool


class RowAgain(BaseModel):
    """One line of the journal: a row, flown."""

    name: str
    row: str
    """The digest of the row: one that was changed is read again."""
    state: str
    why: str = ""
    """Of what failed, or what a test or campaign says."""
    command: str
    """As it was run."""
    seed: str
    at: str
    took_s: float
    cpu_s: float
    figures: list[FigureAgain] = []


class Evidence:
    """A folder of evidence. InputError: it is another commit's."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.made = {
            "version": version(),
            "commit": commit() or "unknown",
            "machine": f"{platform.machine()}, {cores()} cores, {platform.system()}",
            "python": platform.python_version(),
            "numpy": np.__version__,
        }
        self.done = dict[str, RowAgain]()
        journal = folder / JOURNAL
        if not journal.exists():
            folder.mkdir(parents=True, exist_ok=True)
            write_whole(journal, json.dumps(self.made) + "\n")
            return
        head, *lines = list(read_lines(journal, Damage())) or [b""]
        if head.decode().strip() != json.dumps(self.made):
            raise InputError(f"{journal}: is of another commit or machine; choose another --out")
        for line in lines:
            try:
                again = RowAgain.model_validate_json(line)
            except ValidationError:
                continue  # cut off: it is flown again
            self.done[again.name] = again

    def fly(self, rows: Sequence[ClaimRow]) -> Iterator[tuple[ClaimRow, RowAgain | None]]:
        """Each row twice: before it is flown with None, then with its result. What a row before
        this one has found stays. StartError: studies and tests are not here."""
        if not (ROOT / "studies").is_dir():
            raise StartError(
                "the studies and tests are not in this package; allowed: swarm-ctl of a checkout,"
                " installed with pip install -e '.[dev]'"
            )
        for row in rows:
            before = self.done.get(row.name)
            if before is None or before.row != _digest(row):
                yield row, None
                again = self._fly(row)
                append_line(self.folder / JOURNAL, again.model_dump_json())
                if again.state != NOT_FLOWN:
                    self.done[row.name] = again
                yield row, again
            else:
                yield row, before

    def _fly(self, row: ClaimRow) -> RowAgain:
        said, log = self._words(row), self.folder / f"{row.name}.log"
        began_s, before = wall_s(), os.times()
        with log.open("w", encoding="utf-8") as file:
            code = _run(said, file)
        after = os.times()
        text = log.read_text(encoding="utf-8", errors="replace")
        figures, state, why = list[FigureAgain](), HOLDS, ""
        try:
            figures, why = self._read(row, text, code)
        except _NotFlownError as error:
            state, why = NOT_FLOWN, str(error)
        except (_FailedError, InputError, OSError) as error:
            state, why = FAILED, f"{error}; see {log}"
        if not all(each.same for each in figures):
            state = MOVED
        cpu_s = sum(after[2:4]) - sum(before[2:4])
        return RowAgain(
            name=row.name,
            row=_digest(row),
            state=state,
            why=why,
            command=shlex.join(["swarm-ctl", *said[3:]] if said[2].endswith("cli.main") else said),
            seed=self._seed(row),
            at=date_and_time().isoformat(timespec="seconds"),
            took_s=round(wall_s() - began_s, 1),
            cpu_s=round(cpu_s, 1),
            figures=figures,
        )

    def _words(self, row: ClaimRow) -> list[str]:
        first, *rest = shlex.split(row.command)
        if first == "swarm-ctl":
            out = ["--out", str(self._out(row).resolve())]
            first, rest = "-m", ["swarm_ctl.cli.main", *rest, *out]
        elif first == "python":
            first, *rest = rest
        return [sys.executable, first, *rest]

    def _out(self, row: ClaimRow) -> Path:
        return self.folder / (row.name if row.kind == "fuzz" else f"{row.name}.csv")

    def _seed(self, row: ClaimRow) -> str:
        if given := re.search(r"--seed (\d+)", row.command):
            return given[1]
        if row.kind == "study" and self._out(row).exists():
            return str(study_of(self._out(row)).seed)
        return "in the test" if "pytest" in row.command else "-"

    def _read(self, row: ClaimRow, text: str, code: int) -> tuple[list[FigureAgain], str]:
        """The figures, and what else the command says."""
        if row.kind == "fuzz" and code in (0, 1):
            return [], self._campaign(row)
        passed = re.search(r"(\d+) passed", text)
        if "pytest" in row.command and code in (0, 5) and not passed:
            skipped = _SKIPPED.search(text)
            raise _NotFlownError(
                skipped[2].partition(";")[0] if skipped else "no test of it is here"
            )
        if "tests.golden" in row.command and "of another machine" in text:
            raise _NotFlownError("the hashes are of another machine: processor or numpy differ")
        if code:
            raise _FailedError(f"ended with {code}")
        if row.kind != "study":
            last = (text.strip().splitlines() or [""])[-1]
            return [*_printed(row, text)], _tests(passed[1], text) if passed else last
        rows = list(read_rows(self._out(row)))
        r_in = study_of(self._out(row)).law.r_in
        return [*(_again(each, rows, r_in) for each in row.figures), *_printed(row, text)], ""

    def _campaign(self, row: ClaimRow) -> str:
        lines = list(read_lines(self._out(row) / FLIGHTS, Damage()))[1:]
        flights = DrawnFlight.by_number(lines).values()
        found = [(f.number, each.invariant) for f in flights for each in f.broken]
        bad = {number for number, kind in found if kind.name in row.invariants}
        told = (
            f"{len(bad)} of {len(flights)} flights broke one of these invariants"
            f" ({_bound(len(bad), len(flights))}); {sum(f.flown_s for f in flights) / 3600:.1f} h"
        )
        told += "".join(f"; flight {number} broke: {kind}" for number, kind in found)
        if bad:
            raise _FailedError(told)
        return told


class _NotFlownError(Exception):
    """It can't be flown here; why."""


class _FailedError(Exception):
    """It was flown, and did not end well; how."""


def _tests(passed: str, text: str) -> str:
    """What passed, and what was not flown here, with pytest's reasons."""
    skipped = [f"not flown here: {count}, {why}" for count, why in _SKIPPED.findall(text)]
    return "; ".join([f"passed: {passed}", *skipped])


def _digest(row: ClaimRow) -> str:
    return hashlib.sha256(row.model_dump_json().encode()).hexdigest()[:16]


def _run(words: Sequence[str], log: Any) -> int:
    """Its exit code. What ends this process ends the command first, by one signal that it hears
    under `nohup`, too: a second one would leave the command's own processes behind."""
    child = subprocess.Popen(
        words, cwd=ROOT, stdout=log, stderr=subprocess.STDOUT, start_new_session=True
    )
    try:
        return child.wait()
    except (KeyboardInterrupt, SystemExit):
        # pytest takes SIGTERM for its death, and leaves what its tests have started
        child.send_signal(signal.SIGINT if "pytest" in words else signal.SIGTERM)
        try:
            child.wait(_ENDS_S)
        except subprocess.TimeoutExpired:
            child.kill()
            child.wait()
        raise


def _printed(row: ClaimRow, text: str) -> Iterator[FigureAgain]:
    plain = " ".join(text.split())
    for words in row.prints:
        same = words in plain
        found = words if same else "another"
        yield FigureAgain(read="printed", said=words, of=words, found=found, same=same)


def _again(figure: Figure, rows: Iterable[Row], r_in: float) -> FigureAgain:
    """The figure, read in a study's rows.

    A count has to be the same. Processors round otherwise in the last digit: what is measured may
    differ by one in the last digit that the page shows.
    """
    counted = [row for row in rows if all(_is(row[name], value) for name, value in figure.where)]
    name, kind = figure.reading.rstrip("%<"), figure.reading[-1]
    said = "0" if figure.said.lower() in _ZERO else figure.said.replace(",", "")
    digits = len(said.partition(".")[2])
    bound, near = "", 1.01 * 10.0**-digits
    if name == "missions":
        value, near = float(len(counted)), 0.0
    elif name.removesuffix("/r_in") in _SHORT:
        column = _SHORT[name.removesuffix("/r_in")]
        value = min((row[column] for row in counted), default=math.nan)
        value /= r_in if name.endswith("/r_in") else 1.0
    elif name in _TIMES:
        times = [row["time_s"] for row in counted if row["converged"]]
        value = float(np.percentile(times, _TIMES[name])) if times else math.nan
    else:
        hits, of = sum(row[name] > 0 for row in counted), len(counted)
        shares = {"%": hits / max(of, 1), "<": exact_interval(hits, of)[1]}
        value = 100 * shares[kind] if kind in shares else float(hits)
        bound, near = _bound(hits, of), near if kind in shares else 0.0
    same = math.isfinite(value) and abs(round(value, digits) - float(said)) <= near
    return FigureAgain(
        read=" ".join([figure.reading, *(f"{name} {value}" for name, value in figure.where)]),
        said=figure.said,
        of=figure.of,
        found=f"{value:.{digits}f}",
        bound=bound,
        same=same,
    )


def _is(found: Any, wanted: str) -> bool:
    """A text, a number, or a number in `low..high`, whose ends may be missing."""
    if isinstance(found, str):
        return found == wanted
    number = float(found)
    low, dots, high = wanted.partition("..")
    if not dots:
        return math.isclose(number, float(wanted))
    return float(low or "-inf") <= number <= float(high or "inf")


def _bound(hits: int, of: int) -> str:
    low, high = (f"{100 * end:.3g} %" for end in exact_interval(hits, of))
    return f"under {high}" if hits == 0 else f"over {low}" if hits == of else f"{low} to {high}"


def wanted(
    rows: Sequence[ClaimRow], flown: FlownWith | None, names: Sequence[str]
) -> list[ClaimRow]:
    """The rows that were asked for; InputError for a name that is none."""
    known = {row.name: row for row in rows}
    for name in names:
        if name not in known:
            raise InputError(f"--row {name}: allowed: {', '.join(known)}")
    quick = [row for row in rows if row.flown is FlownWith.QUICK]
    all_rows = [*quick, *(row for row in rows if row.flown is FlownWith.ALL)]
    chosen = {FlownWith.QUICK: quick, FlownWith.ALL: all_rows, None: []}[flown]
    return list({row.name: row for row in [*chosen, *(known[name] for name in names)]}.values())
