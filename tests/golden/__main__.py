"""Golden traces: a hash a flight over every state, setpoint, event, answer and verdict.

    python -m tests.golden check              # the ready missions and a hundred scenarios
    python -m tests.golden check hexagon 017  # these alone
    python -m tests.golden write              # a change that means to change flights: name its rows
    python -m tests.golden trace FOLDER [ROW ...]
    python -m tests.golden compare FOLDER FOLDER

`trace` writes what each tick had; `compare` says the first tick in which two such folders differ,
of which agent, in which field. The exit code is 0 where all is the same, 1 where something differs,
2 for bad input, and where the hashes are of another machine: other processors and numpys round
otherwise, in the last digit.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

from tests.golden.traces import (
    HASHES,
    SUFFIX,
    Golden,
    differences,
    first_difference,
    fly,
    read,
    rows,
)


class _InputError(Exception):
    """What is wrong, and what is allowed."""


def main(words: list[str] | None = None) -> int:
    """Its exit code."""
    parser = argparse.ArgumentParser(prog="python -m tests.golden", description=__doc__)
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.add_argument("command", choices=("check", "write", "trace", "compare"))
    parser.add_argument("names", nargs="*", metavar="FOLDER or ROW")
    parser.add_argument("--processes", type=int, default=None, help="default: one per core")
    given = parser.parse_args(words)
    try:
        if given.processes is not None and given.processes < 1:
            raise _InputError(f"--processes {given.processes}; allowed: 1 and more")
        if given.command == "compare":
            return _compare(given.names)
        if given.command == "trace":
            return _trace(given.names, given.processes)
        names = _known(given.names)
        return (_check if given.command == "check" else _write)(names, given.processes)
    except (_InputError, OSError) as error:
        sys.stderr.write(f"{error}\n")
        return 2


def _known(names: list[str]) -> list[str]:
    """These rows; all where none is named."""
    unknown = sorted(set(names) - rows().keys())
    if unknown:
        allowed = ", ".join(sorted(rows()))
        raise _InputError(f"no such row: {', '.join(unknown)}; allowed: {allowed}")
    return sorted(set(names)) or sorted(rows())


def _fly(names: list[str], processes: int | None, folder: Path | None = None) -> dict[str, str]:
    start_s = time.monotonic()
    found = fly(names, processes, folder)
    sys.stdout.write(f"{len(found)} flights in {time.monotonic() - start_s:.0f} s\n")
    return found


def _here() -> Golden:
    """The hashes, where they hold on this machine."""
    try:
        golden = read()
    except (ValueError, TypeError) as error:
        raise _InputError(f"{HASHES}: {error}; allowed: what `write` writes") from error
    if not golden.is_of_here():
        made, here = golden.made_with, Golden.here({}).made_with
        raise _InputError(f"{HASHES}: of another machine: {made}; this one: {here}")
    return golden


def _check(names: list[str], processes: int | None) -> int:
    golden = _here()  # before minutes of flight
    found = _fly(names, processes)
    changed = differences(golden.hashes, found)
    gone = sorted(golden.hashes.keys() - rows().keys())
    for what, which in (("changed", changed), ("gone", gone)):
        if which:
            sys.stdout.write(f"{what}: {', '.join(which)}\n")
    if changed or gone:
        return 1
    sys.stdout.write("all are the same\n")
    return 0


def _write(names: list[str], processes: int | None) -> int:
    whole = names == sorted(rows())
    kept = {} if whole else _here().hashes  # one file, one machine
    known = read().hashes if HASHES.exists() and whole else kept
    found = _fly(names, processes)
    hashes = {name: digest for name, digest in kept.items() if name in rows()} | found
    Golden.here(hashes).write()
    sys.stdout.write(f"changed: {', '.join(differences(known, found)) or 'none'}\n")
    return 0


def _trace(names: list[str], processes: int | None) -> int:
    if not names:
        raise _InputError("trace: no folder; allowed: trace FOLDER [ROW ...]")
    known = _known(names[1:])
    folder = Path(names[0])
    folder.mkdir(parents=True, exist_ok=True)
    _fly(known, processes, folder)
    return 0


def _compare(names: list[str]) -> int:
    if len(names) != 2:
        raise _InputError(f"compare: {len(names)} folders; allowed: compare FOLDER FOLDER")
    one, other = map(Path, names)
    in_one, in_other = ({path.name for path in folder.iterdir()} for folder in (one, other))
    traces = sorted(name for name in in_one | in_other if name.endswith(SUFFIX))
    if not traces:
        raise _InputError(f"{one}, {other}: no traces; allowed: folders that `trace` has written")
    told = {name: _told(one, other, name) for name in traces}
    for name, text in told.items():
        if text:
            sys.stdout.write(f"{name.removesuffix(SUFFIX)}: {text}\n")
    differ = sum(map(bool, told.values()))
    sys.stdout.write(f"{len(traces)} flights, {differ} differ\n")
    return 1 if differ else 0


def _told(one: Path, other: Path, name: str) -> str:
    for folder in (one, other):
        if not (folder / name).exists():
            return f"not in {folder}"
    try:
        return first_difference(one / name, other / name)
    except (EOFError, ValueError) as error:
        raise _InputError(f"{name}: no whole trace: {error}") from error


if __name__ == "__main__":
    sys.exit(main())
