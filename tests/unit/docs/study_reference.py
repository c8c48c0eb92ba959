"""Writes the page of studies from the code and from the files in studies/.

python -m tests.unit.docs.study_reference > docs/look-up/studies.md
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any, Final

from swarm_ctl.core.swarm.hearing import SMALL_SWARM
from swarm_ctl.study.parameter_space import LISTS, RANGES, Range, Study, StudyFile, study_file
from swarm_ctl.study.rows import MEANINGS

ROOT: Final = Path(__file__).parents[3]
COMMAND: Final = "python -m tests.unit.docs.study_reference > docs/look-up/studies.md"
HEAD: Final = f"""# Studies

A study flies thousands of missions, without processes: the agents' own law, safety filter and slot
exchange (`swarm_ctl/core/kernel/`), and the simulator's own vehicles. numba compiles them, once
after each change, into `~/.cache/swarm-ctl` (or `XDG_CACHE_HOME`). Without numba the same
functions fly the same missions a hundred times slower, and `study` says so. This page is made from
the code by `{COMMAND}`.

```sh
swarm-ctl study studies/mix.yaml                                 # a file, the rows in mix.csv
swarm-ctl study studies/mix.yaml --seed 2 --missions 1000 --out mix2.csv
swarm-ctl study --n 4,6,9 --slots random,nearest --missions 2000 # options alone
swarm-ctl study studies/mix.yaml --row 11 --picture 11.gif --mission 11.yaml
```

- Every study that these pages cite is a file below. An option replaces what the file says.
- A *list* (`4,6,9`) is combined with every other list; a combination is a *cell*, and each has
  `missions` missions. From a *range* (`0:0.2`) each mission draws its own value. A list may hold
  ranges.
- Rows are the same for the same study, however many processes or [machines](../do/cluster.md) fly
  it, and whatever other missions are flown.
- Beside the rows, `FILE.json` has the study. The same command continues a study that was
  interrupted.
- `--law paper,orca,mine` flies the same missions by each [law](../understand/law.md#an-own-law),
  without the filter and with it: the league. A law in plain Python is compiled too where numba
  can; where not, its missions take tens of times as long, and `study` says so.
- In swarms of more than {SMALL_SWARM} each agent hears its near peers at every tick, and of far
  ones a word twice a second, as [agents do](../understand/safety-evidence.md).

## Truth and model

`lag_s`, `dead_time_s` and `acceleration_mps2` are what the vehicles truly do. `model_lag_s`,
`model_dead_time_s` and `model_acceleration_mps2` are what the agents believe; stop points and the
filter's margins are made of them. A model that is not given is the middle of the true range. So **a
single true value without a model is a perfect model**, and `dead_time_s: 0:1` is a model of 0.5 s
with an error of up to 0.5 s either way. An error by itself, whatever the model, is `late_s` (of the
dead time) or `lag_error_s`; both may be negative. Vehicles that answer as a firmware (`ardupilot`,
`px4`) have the autopilot's typical model, unless one is given.

With `spread: mission` all vehicles of a mission are alike, so an error has one sign in the whole
swarm. With `spread: agent` each agent draws its own lag, dead time, acceleration and delay.

A row as a mission (`--mission`) flies what the row flew as far as a mission can carry it; the
command names what is lost.

## Woods

```sh
swarm-ctl study studies/woods.yaml --missions 20
swarm-ctl study --wood trap --n 8 --out trap.csv
swarm-ctl study --out trap.csv --row 3 --picture trap.png
```

With `wood` other than `none`, agents stand in their shape, fly a `move` in file and stand in the
same shape behind the wood. The way is the one that a mission of these zones is planned with. One
behind the other they follow it by the rules of a flight (`swarm_ctl/core/kernel/queue.py`), and its
walls keep them off (`swarm_ctl/core/kernel/walls.py`). A trunk is a circle with the clearance of
missions, `r_in / 2`. Hedges, gates and traps are trunks that overlap. A wood without any way is
drawn again; a way round the wood counts.

A row is `converged` when all live agents stood at their places. `over_shortest` compares with a
file that flies at the top speed from the first moment on and never brakes.

Studies leave out: moves in which all go together through a wide gap (they are flown in file),
polygons, a fence, heights, zones that are added in flight, and the new way of an agent that was
pushed off the old one.

## The worst case

```sh
swarm-ctl study studies/search.yaml --search smallest --budget 20000
```

`--search` finds the worst mission over all lists and ranges of a study within `--budget` missions:

| goal | worst is |
|---|---|
| `smallest` | the smallest distance of two live agents |
| `silent` | the smallest distance of a live agent to the vehicle of a silent one |
| `slowest` | not formed, with the largest error; else the longest time to form |
| `zone` | the smallest distance of a live agent to a trunk, or the deepest inside |
| `link` | most links torn whose slots fit; where none is, the longest link |

Missions fly in regions: one value of each list, a part of each range. After a first round all over
the study, a quarter of the regions is drawn from all of it again. The others are the worst regions
so far, narrowed to their worst missions, half of them with one list's value drawn anew. As many
missions drawn plainly are flown beside them, and both figures are told: where sampling found the
worse one, the search has not shown anything. A search proves nothing about what it did not fly.

The find is a row of a study of its region, at `--out`. With `--picture` and `--mission`, or later
by `--row`, it flies again as a picture and as a mission, which `run` flies with processes. The same
command finds the same row on any number of processes.
"""


def page() -> str:
    """The whole page, as Markdown."""
    return f"{HEAD}\n{_files()}\n{_fields()}\n{_columns()}"


def _files() -> str:
    found = ((path, study_file(path, {})) for path in sorted((ROOT / "studies").glob("*.yaml")))
    lines = [f"| `studies/{path.name}` | {said.about} | {said.rows} |" for path, said in found]
    return _table("Study files", "", "file | what it asks | missions", lines)


def _fields() -> str:
    text = (
        "Of a study file; the command's options have the same names, without units. Lengths without"
        " a suffix are the law's units. `about` says what the study asks, `by` which lists make the"
        " rows of the table.\n"
    )
    names = [name for name in Study.model_fields if name not in (*LISTS, *RANGES)]
    lines = [
        f"| `{name}` | {_kind(name)} | {_default(Study.model_fields[name].default)} |"
        f" {_said(Study.model_fields[name].description)} |"
        for name in (*LISTS, *RANGES, *names)
    ]
    assert set(StudyFile.model_fields) == {*Study.model_fields, "about", "by"}
    return _table("Fields", text, "field | kind | default | meaning", lines)


def _kind(name: str) -> str:
    return "list" if name in LISTS else "list of ranges" if name in RANGES else "value"


def _default(default: Any) -> str:
    if isinstance(default, tuple):
        default = default[0]
    if default is None:
        return ""
    if isinstance(default, int | float | str | Range):
        return f"`{default}`"
    return ", ".join(f"`{name} {value:g}`" for name, value in vars_of(default).items())


def vars_of(law: Any) -> dict[str, float]:
    """The law's constants but its gain."""
    return {name: getattr(law, name) for name in ("r", "r_out", "r_in", "delta_l", "delta_a")}


def _said(text: str | None) -> str:
    return " ".join((text or "").split()).replace("None: ", "Not given: ").replace("|", "\\|")


def _columns() -> str:
    text = (
        "One row a mission; flags are 0 or 1. A row has each list's and range's value under the"
        " field's own name, of the model what was believed, and besides:\n"
    )
    shown = {name: text for name, text in MEANINGS.items() if name not in (*LISTS, *RANGES)}
    lines = [f"| `{name}` | {_said(meaning)} |" for name, meaning in shown.items()]
    return _table("Columns of the rows", text, "column | meaning", lines)


def _table(heading: str, text: str, head: str, lines: list[str]) -> str:
    rule = "|".join("---" for _ in head.split("|"))
    body = "\n".join((f"| {head} |", f"|{rule}|", *lines))
    return f"## {heading}\n\n{text}\n{body}\n" if text else f"## {heading}\n\n{body}\n"


if __name__ == "__main__":
    sys.stdout.write(page())
