"""The process that starts autopilots ends every one of them, however it ends itself."""

from __future__ import annotations

import contextlib
import os
import signal
import stat
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from swarm_ctl.core.model.fleet import VehicleKind
from swarm_ctl.core.model.plan import Geodetic
from swarm_ctl.engine.launch.ground_control import KNOWN
from swarm_ctl.engine.vehicles.containers import Image
from swarm_ctl.engine.vehicles.order import (
    ORDERS,
    ORDERS_JSON,
    STARTED,
    STARTED_JSON,
    Orders,
    Started,
    VehicleOrder,
)

FAKE = Path(__file__).with_name("fake_autopilot.py")
ENGINE = FAKE.with_name("fake_engine.py")
KINDS = [VehicleKind.ARDUCOPTER, VehicleKind.PX4]


class Running:
    """The process, with a stand-in for one autopilot of each kind; ArduCopter's may be in a
    container."""

    def __init__(self, folder: Path, program: str, copter: Image | None = None) -> None:
        self.folder = folder
        binary = folder / "theirs" / "bin" / "px4"
        binary.parent.mkdir(parents=True)
        binary.write_text(program)
        binary.chmod(binary.stat().st_mode | stat.S_IXUSR)
        place = Geodetic(47.0, 8.0, 488.0)
        programs = {VehicleKind.ARDUCOPTER: copter or binary, VehicleKind.PX4: folder / "theirs"}
        orders = tuple(
            VehicleOrder(k, 10 + k, kind, programs[kind], place) for k, kind in enumerate(KINDS)
        )
        (folder / ORDERS).write_bytes(ORDERS_JSON.dump_json(Orders(2.0, orders)))
        module = "swarm_ctl.engine.vehicles.vehicles_process"
        self.process = subprocess.Popen(
            [sys.executable, "-m", module, str(folder)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
        )

    @property
    def started(self) -> tuple[Started, ...]:
        return STARTED_JSON.validate_json((self.folder / STARTED).read_bytes())

    def wait_ready(self) -> None:
        assert self.process.stdout is not None
        assert self.process.stdout.readline()

    def let_go(self) -> None:
        assert self.process.stdin is not None
        self.process.stdin.close()

    def assert_nothing_left(self) -> None:
        until = time.monotonic() + 5.0
        while alive := [v.pid for v in self.started if Path(f"/proc/{v.pid}").exists()]:
            assert time.monotonic() < until, alive
            time.sleep(0.02)


PROGRAM = f'#!/bin/sh\nexec {sys.executable} {FAKE} "$@"\n'


@pytest.fixture
def running(tmp_path: Path) -> Iterator[Running]:
    found = Running(tmp_path, PROGRAM)
    with found.process:
        yield found
        found.process.kill()


def _program(path: Path, text: str) -> Path:
    path.parent.mkdir(exist_ok=True)
    path.write_text(text)
    path.chmod(0o755)
    return path


@pytest.fixture
def contained(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Running]:
    """With an ArduCopter in a container of a stand-in for podman."""
    engine_text = f'#!/bin/sh\nexec {sys.executable} {ENGINE} "{tmp_path}/containers" "$@"\n'
    engine = _program(tmp_path / "containers" / "podman", engine_text)
    inside = _program(tmp_path / "image" / "arducopter", PROGRAM).parent
    monkeypatch.setenv("PATH", f"{inside}:{os.environ['PATH']}")
    found = Running(tmp_path, PROGRAM, Image(str(engine), "copter"))
    with found.process:
        yield found
        found.process.kill()
    for left in engine.parent.glob("swarm-ctl-*"):
        with contextlib.suppress(ProcessLookupError, FileNotFoundError):
            os.kill(int(left.read_text()), signal.SIGKILL)


def test_the_end_of_its_parent_ends_it_once_no_vehicle_is_armed(running: Running) -> None:
    """Ctrl-C of the terminal is not for it. Each vehicle has its agent's endpoint and its own
    system id."""
    running.wait_ready()
    copter, px4 = running.started
    assert copter.endpoint == f"tcp:127.0.0.1:{5760 + 10 * copter.instance}"
    assert px4.endpoint == f"udpin:127.0.0.1:{14540 + px4.instance}"
    assert [copter.sysid, px4.sysid] == [10, 11]
    arm(running)
    running.process.send_signal(signal.SIGINT)
    time.sleep(0.3)
    assert running.process.poll() is None
    running.let_go()
    time.sleep(0.7)
    assert running.process.poll() is None
    (running.folder / "1" / "armed").unlink()
    assert running.process.wait(10) == 0
    running.assert_nothing_left()


def arm(running: Running) -> None:
    """The PX4, which has told it then."""
    armed = running.folder / "1" / "armed"
    armed.touch()
    until = time.monotonic() + 30.0
    while not armed.with_name("said").exists():
        assert time.monotonic() < until
        time.sleep(0.02)


def test_an_autopilot_that_ends_by_itself_is_named(running: Running) -> None:
    running.wait_ready()
    os.kill(running.started[0].pid, signal.SIGKILL)
    time.sleep(0.3)
    running.let_go()
    assert running.process.wait(10) == 1
    assert running.process.stderr is not None
    assert "arducopter of agent 0 ended, code -9" in running.process.stderr.read().decode()
    running.assert_nothing_left()


def test_two_runs_that_start_at_once_have_autopilots_at_other_ports(tmp_path: Path) -> None:
    """Each holds the numbers that it has chosen until it ends, also before its autopilots have
    bound their ports. Simulated vehicles leave those numbers' ports alone, too."""
    late = f'#!/bin/sh\nsleep 1; exec {sys.executable} {FAKE} "$@"\n'
    with contextlib.ExitStack() as opened:
        runs = [Running(tmp_path / name, late) for name in ("one", "two", "three")]
        for each in runs:
            opened.enter_context(each.process)
            opened.callback(each.process.kill)
        files = [each.folder / STARTED for each in runs]
        until = time.monotonic() + 20.0
        while not all(file.exists() and file.stat().st_size for file in files):
            assert time.monotonic() < until
            time.sleep(0.02)
        for kind, known in zip(KINDS, ("ardupilot", "px4"), strict=True):
            taken = [v.instance for each in runs for v in each.started if v.kind is kind]
            assert len(set(taken)) == len(runs)
            for instance in taken:
                with pytest.raises(OSError, match="in use"):
                    KNOWN[known].hold(instance)
        for each in runs:
            each.wait_ready()
            each.let_go()
        assert [each.process.wait(10) for each in runs] == [0, 0, 0]


def test_an_autopilot_that_does_not_start_is_an_error_that_names_its_log(tmp_path: Path) -> None:
    found = Running(tmp_path, "#!/bin/sh\nexit 4\n")
    with found.process:
        assert found.process.wait(20) == 3
        assert found.process.stderr is not None
        said = found.process.stderr.read().decode()
    assert "of agent 0 ended, code 4; see " in said or "of agent 1 ended, code 4; see " in said
    assert "output.log" in said


@pytest.mark.parametrize("whose", ["lifeline", "SIGTERM", "SIGKILL", "client"])
def test_all_ends_however_the_process_or_the_engines_client_ends(
    contained: Running, whose: str
) -> None:
    """The lifeline cut, the process asked to end or killed (at once, though a vehicle is armed),
    the client killed: no program of the container runs on, the engine has removed it, and no other
    autopilot runs without the process."""
    contained.wait_ready()
    (file,) = (contained.folder / "containers").glob("swarm-ctl-*")
    program = Path(f"/proc/{file.read_text()}")
    assert program.exists()
    if whose == "lifeline":
        contained.let_go()
    elif whose == "client":
        os.kill(contained.started[0].pid, signal.SIGKILL)
    else:
        arm(contained)
        contained.process.send_signal(signal.Signals[whose])
    until = time.monotonic() + 5.0
    while file.exists() or program.exists():
        assert time.monotonic() < until
        time.sleep(0.02)
    if whose == "client":
        assert contained.process.poll() is None
    else:
        contained.process.wait(10)
        contained.assert_nothing_left()
