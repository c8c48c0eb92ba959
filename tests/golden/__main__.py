"""Golden traces: a hash a flight over every state, setpoint, event, answer and verdict.

    python -m tests.golden check              # the ready missions and a hundred scenarios
    python -m tests.golden check hexagon 017  # these alone
    python -m tests.golden write              # a change that means to change flights: name its rows
    python -m tests.golden trace FOLDER [ROW ...]
    python -m tests.golden compare FOLDER FOLDER

`check` ends with 1 where a hash differs, and names the rows. `trace` writes what each tick had;
`compare` says the first tick in which two such folders differ, of which agent, in which field.
Hashes hold for one kind of machine: other processors and numpys round otherwise, in the last digit.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

from tests.golden.traces import HASHES, Golden, differences, first_difference, fly, read, rows


def main(words: list[str] | None = None) -> int:
    """Its exit code."""
    parser = argparse.ArgumentParser(prog="python -m tests.golden", description=__doc__)
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.add_argument("command", choices=("check", "write", "trace", "compare"))
    parser.add_argument("names", nargs="*")
    parser.add_argument("--processes", type=int, default=None, help="default: one per core")
    given = parser.parse_args(words)
    if given.command == "compare":
        return _compare(*map(Path, given.names))
    folder = None
    if given.command == "trace":
        folder, given.names = Path(given.names[0]), given.names[1:]
        folder.mkdir(parents=True, exist_ok=True)
    unknown = set(given.names) - rows().keys()
    if unknown:
        sys.stderr.write(f"no such row: {', '.join(sorted(unknown))}\n")
        return 2
    start_s = time.monotonic()
    found = fly(given.names or sorted(rows()), given.processes, folder)
    sys.stdout.write(f"{len(found)} flights in {time.monotonic() - start_s:.0f} s\n")
    if given.command == "check":
        return _check(found)
    if given.command == "write":
        before = read() if HASHES.exists() else None
        kept = {**before.hashes, **found} if before is not None and given.names else found
        Golden.here(kept).write()
        changed = differences(before.hashes, found) if before is not None else sorted(found)
        sys.stdout.write(f"changed: {', '.join(changed) or 'none'}\n")
    return 0


def _check(found: dict[str, str]) -> int:
    golden = read()
    if not golden.is_of_here():
        sys.stderr.write(f"the hashes are of another machine: {golden.made_with}\n")
        return 2
    changed = differences(golden.hashes, found)
    sys.stdout.write(f"changed: {', '.join(changed)}\n" if changed else "all are the same\n")
    return 1 if changed else 0


def _compare(one: Path, other: Path) -> int:
    names = sorted({path.name for path in one.iterdir()} & {path.name for path in other.iterdir()})
    changed = 0
    for name in names:
        text = first_difference(one / name, other / name)
        if text:
            changed += 1
            sys.stdout.write(f"{name}: {text}\n")
    sys.stdout.write(f"{len(names)} flights, {changed} differ\n")
    return 1 if changed else 0


if __name__ == "__main__":
    sys.exit(main())
