"""Settings for all tests: how many workers run them, and which rows run.

`python -m pytest` shares the tests among three workers. One process runs them where a debugger or
the order needs it: with `--pdb`, `--trace` or `-s`, where files or single tests are named, and for
the long rows (`python -m pytest -m long`). `-n0` or another number wins over this choice.

Tests in real time (processes, sockets, the system's clock) mostly wait, and must not be kept
waiting. They are two groups of about the same length, each run in order by one worker: whole runs
(autopilots that boot take both cores, so they never boot beside a run at a speed-up), and links and
terminals. The workers begin with them. All other tests only compute, beside them, on a worker that
gives way, file by file: what the tests of a file share is made once. Flights in lockstep take both
cores, but wait for them: they come last, beside each other, and not before both groups have ended.
"""

from __future__ import annotations

import fcntl
import gc
import os
import signal
import sys
import tempfile
from collections.abc import Generator
from pathlib import Path

import pytest
from hypothesis import settings
from xdist.remote import Producer
from xdist.scheduler import LoadGroupScheduling

if hasattr(signal, "SIGHUP"):
    # Under nohup it is ignored, by all children as well; tests close terminals.
    signal.signal(signal.SIGHUP, signal.SIG_DFL)

WORKERS = 3
RUNS, LINKS = "runs", "links"
REALTIME = {"system": RUNS, "hosts": RUNS, "autopilots": RUNS, "protocol": LINKS}
"""The group of each folder."""
TERMINALS = ("test_dashboard", "test_keys", "test_measure", "test_zenoh_links")
"""Of the folder `system`, but beside the whole runs."""
LONG_ONES = ("test_several_swarms", "test_send", "test_plugin", "test_python")
LONG_ONES += ("test_foxglove", "test_readers", "test_whole")
"""In lockstep for more than 15 s."""
_GIVE_WAY = 5
"""As `nice` counts: a third of the weight."""


@pytest.hookimpl(tryfirst=True)
def pytest_xdist_auto_num_workers(config: pytest.Config) -> int:
    """The number of workers for `-n auto`, which pyproject.toml asks for; 0: this process."""
    option = config.option
    debugging = option.usepdb or option.trace or option.capture == "no"
    named = any(".py" in argument for argument in config.args)
    return 0 if debugging or named or option.markexpr else WORKERS


@pytest.hookimpl(tryfirst=True)  # before xdist reads the groups
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Leave out long rows that are not asked for; give tests in real time their group."""
    if not config.option.markexpr:
        every, items[:] = list(items), [item for item in items if _wanted(item, config)]
        config.hook.pytest_deselected(items=[item for item in every if not _wanted(item, config)])
    for number, item in enumerate(items):
        group = _group(item)
        if not group and _waits_for_the_machine(item):
            group = f"lockstep-{number}"  # by itself, for whichever worker is free
        if item.path.parent == Path(__file__).with_name("foreign"):
            item.add_marker(pytest.mark.foreign)
        if group in (RUNS, LINKS):
            item.add_marker(pytest.mark.realtime)
        if group:
            item.add_marker(pytest.mark.xdist_group(group))
    items.sort(key=_turn)


def _turn(item: pytest.Item) -> int:
    """Tests in real time come first, by group; flights in lockstep last, and of these the long ones
    first: none is left to one worker at the end."""
    group = item.get_closest_marker("xdist_group")
    if group is None:
        return 2
    return {RUNS: 0, LINKS: 1}.get(group.args[0], 3 if item.path.stem in LONG_ONES else 4)


@pytest.hookimpl(tryfirst=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Producer) -> LoadGroupScheduling:
    """As pytest-xdist's own for groups; a file of tests that only compute is one, too."""
    return _ByFile(config, log)


class _ByFile(LoadGroupScheduling):
    def _split_scope(self, nodeid: str) -> str:
        group: str = super()._split_scope(nodeid)
        return nodeid.partition("::")[0] if group == nodeid else group


def _waits_for_the_machine(item: pytest.Item) -> bool:
    """It flies in lockstep (a folder of that name is a keyword, too)."""
    in_lockstep = item.get_closest_marker("lockstep") is not None
    return in_lockstep and "realtime" not in item.keywords


def _wanted(item: pytest.Item, config: pytest.Config) -> bool:
    """Whether this is no long row and no campaign, or the command line has its very id."""
    ids = [argument for argument in config.args if "::" in argument]
    named = any(item.nodeid.endswith(name) or name.endswith(item.nodeid) for name in ids)
    # a folder `fuzz` is a keyword, too
    return named or not any(item.get_closest_marker(name) for name in ("long", "fuzz"))


def _group(item: pytest.Item) -> str:
    folder = item.path.relative_to(Path(__file__).parent).parts[0]
    if _waits_for_the_machine(item):  # all tests in `foreign` look at one flight
        return folder if folder == "foreign" else ""
    if folder == "system" and item.path.stem in TERMINALS:
        return LINKS
    return REALTIME.get(folder, RUNS if "realtime" in item.keywords else "")


def pytest_collection_finish(session: pytest.Session) -> None:
    """Flights side by side on two workers disturb each other: end if the groups are not kept."""
    if "PYTEST_XDIST_WORKER" not in os.environ:
        return
    for item in session.items:
        if item.get_closest_marker("xdist_group") and "@" not in item.nodeid:
            raise pytest.UsageError("this pytest-xdist does not keep the groups of this pytest")


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup(item: pytest.Item) -> None:
    """A worker beside another one gives way to flights from its first test that only computes."""
    beside_another = "PYTEST_XDIST_WORKER" in os.environ
    if beside_another and "realtime" not in item.keywords and os.getsid(0) != os.getpid():
        _give_way()


@pytest.hookimpl(wrapper=True, tryfirst=True)  # outside of the time that pytest-timeout allows
def pytest_runtest_protocol(
    item: pytest.Item, nextitem: pytest.Item | None
) -> Generator[None, object, object]:
    """A group in real time holds the gate from its first test to its last; a flight in lockstep
    passes when none does."""
    if "PYTEST_XDIST_WORKER" in os.environ:
        if "realtime" in item.keywords:
            _GATE.hold()
        elif _waits_for_the_machine(item):
            _GATE.wait()
    try:
        return (yield)
    finally:
        if nextitem is None or "realtime" not in nextitem.keywords:
            _GATE.leave()


class _Gate:
    """A lock on this very file, which all workers know; it ends with its process."""

    def __init__(self) -> None:
        self._held: int | None = None

    def hold(self) -> None:
        if self._held is None:
            self._held = self._locked(fcntl.LOCK_SH)

    def wait(self) -> None:
        os.close(self._locked(fcntl.LOCK_EX))

    def leave(self) -> None:
        if self._held is not None:
            os.close(self._held)
            self._held = None

    def _locked(self, how: int) -> int:
        descriptor = os.open(__file__, os.O_RDONLY | os.O_CLOEXEC)
        fcntl.flock(descriptor, how)
        return descriptor


_GATE = _Gate()


def _give_way() -> None:
    """In a session of its own: Linux shares the machine out by session (autogroup), and `nice`
    counts within one alone."""
    os.setsid()
    try:
        Path("/proc/self/autogroup").write_text(str(_GIVE_WAY))
    except OSError:  # no such thing here
        os.nice(_GIVE_WAY)


# Half of Hypothesis' own number, where a test names none: the suite has a time to keep. Drawn
# alike for each of mutmut's mutants, whose figure is the same again.
settings.register_profile("here", deadline=None, max_examples=50)
settings.register_profile("ci", deadline=None, derandomize=True, max_examples=50)
settings.load_profile("ci" if {"CI", "MUTANT_UNDER_TEST"} & os.environ.keys() else "here")

# Flights that are kept for other tests are many objects: each collection looks at all of them.
gc.set_threshold(20_000, 20, 20)

# Vehicles that tests fly are not remembered among the user's own.
_STATE = tempfile.TemporaryDirectory(prefix="swarm-ctl-state-")
os.environ["SWARM_CTL_STATE"] = _STATE.name

# Where it is set, each of some 150 processes that tests start would compile the package anew, and
# each worker all tests.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False

# A shell has its background jobs ignore Ctrl-C, and they hand that down to the processes that tests
# start and interrupt.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

# Known to pytest already where the package is installed anew.
pytest_plugins = ["swarm_ctl.testing.plugin"]
