"""Signals that end a program: who hears them, and what a second one says."""

from __future__ import annotations

import signal
import subprocess
import sys
from collections.abc import Callable

import pytest

from swarm_ctl.engine import interrupts
from swarm_ctl.engine.interrupts import Interrupts
from swarm_ctl.signals import ENDING, deaf_children, ended_by

WORK = "import time; print('up', flush=True); time.sleep(60)"


@pytest.mark.parametrize("number", ENDING)
def test_a_deaf_child_hears_none_from_its_first_instruction_on(number: int) -> None:
    """Sent at once, before Python can have set any handler."""
    with deaf_children():
        child = subprocess.Popen([sys.executable, "-c", WORK], stdout=subprocess.PIPE)
    child.send_signal(number)
    assert child.stdout is not None
    assert child.stdout.readline() == b"up\n"
    child.send_signal(number)
    with pytest.raises(subprocess.TimeoutExpired):
        child.wait(0.2)
    child.kill()
    child.wait()
    child.stdout.close()


def test_what_comes_while_children_are_started_is_heard_afterwards() -> None:
    with Interrupts() as counted:
        with deaf_children():
            signal.raise_signal(signal.SIGINT)
            assert counted.count == 0
        assert (counted.count, counted.first) == (1, "Ctrl-C")


@pytest.mark.parametrize(
    ("sent", "again"),
    [
        ([(signal.SIGINT, 0.0)], False),
        ([(signal.SIGINT, 0.0), (signal.SIGINT, 0.05)], False),  # one, sent twice
        (
            [(signal.SIGINT, 0.0), *((signal.SIGINT, 0.5 + k / 30) for k in range(60))],
            False,
        ),  # held
        ([(signal.SIGINT, 0.0), (signal.SIGINT, 1.0)], True),
        ([(signal.SIGTERM, 0.0), (signal.SIGTERM, 5.0)], False),  # `timeout` sends two
        ([(signal.SIGTERM, 0.0), (signal.SIGINT, 5.0)], False),
        ([(signal.SIGTERM, 0.0), (signal.SIGINT, 5.0), (signal.SIGINT, 6.0)], True),
    ],
)
def test_only_a_second_press_of_ctrl_c_stops_at_once(
    sent: list[tuple[int, float]], again: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    now = [0.0]
    clock: Callable[[], float] = lambda: now[0]  # noqa: E731
    monkeypatch.setattr(interrupts, "wall_s", clock)
    with Interrupts() as counted:
        for number, now[0] in sent:
            signal.raise_signal(number)
    assert counted.again is again
    assert counted.first == interrupts.said_of(sent[0][0])


def test_what_has_a_loop_of_its_own_is_left_first(capfd: pytest.CaptureFixture[str]) -> None:
    """No exception comes into the loop; the process ends behind it, in one line."""
    before = {number: signal.getsignal(number) for number in ENDING}
    left: list[int] = []
    try:
        with pytest.raises(SystemExit) as ended, ended_by(lambda: left.append(1)):  # noqa: PT012
            signal.raise_signal(signal.SIGTERM)
            left.append(2)
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
    assert left == [1, 2]
    assert ended.value.code == 130
    assert capfd.readouterr().err == "ended: SIGTERM\n"
