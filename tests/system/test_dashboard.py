"""The dashboard driven by keystrokes in a real terminal, and stations that come late."""

from __future__ import annotations

import json
import subprocess
import time
from pathlib import Path

import pytest

from tests.system.running import HELD, LOW, SWARM_CTL, Running
from tests.system.terminal import Terminal, needs_tmux
from tests.system.test_run import assert_truth_ends_on_the_ground

RUN = ("run", LOW, "--speedup", "4")


@needs_tmux
def test_screens_orders_and_the_end(tmp_path: Path) -> None:
    """From the first picture over all screens to a landing by one key, and the same again from the
    recording; the terminal is left as it was. Stations that come in mid-flight have the whole
    picture in two seconds, and the log from its begin."""
    with Terminal("run", HELD, cwd=tmp_path) as terminal:
        terminal.wait_for("3/3 agents")
        terminal.wait_for("takeoff")
        assert_whole_picture(tmp_path)
        terminal.press("2")
        terminal.wait_for("rx\\tx")
        terminal.press("3")
        terminal.wait_for("tally of the flight")
        terminal.press("?")
        terminal.wait_for("stop the motors")
        terminal.press("4")
        terminal.wait_for("step 1: takeoff")
        terminal.press("K")
        terminal.wait_for("their motors stop, and they fall")
        terminal.press("n")
        terminal.wait_for("kill: not sent")
        terminal.press(":")
        terminal.wait_for("tab completes")
        terminal.press(*"tune", "Space", "h", "Tab")
        terminal.wait_for(":tune h=0.05")
        terminal.press("BSpace", "4", "Enter")
        terminal.wait_for("tune h 0.04, kappa 10")
        terminal.press("3")
        terminal.wait_for("(tuned: h 0.05 -> 0.04)")
        terminal.press(":", *"land", "Enter")
        terminal.wait_for("land agents 1-3: they land where they are")
        terminal.wait_for("Enter sends it")
        terminal.press("Enter")
        terminal.wait_for(lambda text: "land  ✓ agents 1-3" in text or "DONE" in text)
        code, shown = terminal.wait_for_end()
        assert code == 1
        assert "landed by the operator" in shown
    with Terminal("replay", "--speed", "20", cwd=tmp_path) as terminal:
        terminal.wait_for("REPLAY")
        terminal.press("K")
        terminal.wait_for("kill: this is a recording: nothing can be ordered")
        terminal.press("4", "End")
        terminal.wait_for(lambda text: "landed by the operator" in text and "■" in text)
        terminal.press("Home", "Space")
        terminal.wait_for(lambda text: "landed by the operator" not in text and "REPLAY" in text)
        terminal.press("q")
        code, _ = terminal.wait_for_end()
        assert code == 0


def assert_whole_picture(where: Path) -> None:
    """Of a station that comes now, and on the screen of another one."""
    (folder,) = (where / "runs").iterdir()
    command = [str(SWARM_CTL), "station", "--json"]
    with subprocess.Popen(command, cwd=where, stdout=subprocess.PIPE, text=True) as late:
        assert late.stdout is not None
        try:
            for line in late.stdout:
                told = json.loads(line)
                if all(agent["position_ned_m"] and agent["mode"] for agent in told["agents"]):
                    break
        finally:
            late.kill()
    first = json.loads((folder / "events.jsonl").read_text().splitlines()[0])
    (aside := where / "aside").mkdir()  # a terminal that closes ends the runs of its folder
    with Terminal("station", folder, cwd=aside, size=(120, 60)) as one:
        one.wait_for("3/3 agents")
        one.press("4")
        one.wait_for("the log begins with the run's events and commands")
        one.wait_for(f"{first['time_s']:.1f}")  # in this picture, or in the next one
    assert told["step_name"] in ("takeoff", "form hexagon", "hold")
    assert all(agent["heartbeat_age_s"] < 2.0 for agent in told["agents"])
    assert told["time_s"] - told["since_s"] < 2.0


@needs_tmux
def test_ctrl_c_is_the_runs(tmp_path: Path) -> None:
    """The first one lands the swarm, the second one asks, and Enter stops all at once: the keys are
    ours, the meaning is `run`'s. The verdict has one cause: who did it."""
    with Terminal(*RUN[:2], "--speedup", "2", cwd=tmp_path) as terminal:
        terminal.wait_for("takeoff")
        terminal.press("C-c")
        terminal.wait_for("landing the swarm; Ctrl-C again stops everything at once")
        terminal.press("C-c")
        terminal.wait_for("stop at once, whatever is in the air")
        time.sleep(1.0)  # as a person reads it
        terminal.press("Enter")
        code, shown = terminal.wait_for_end()
        assert code == 130
        up = "the vehicles of agents 1-3 may be in the air"
        words = " ".join(shown.split())  # however wide the terminal is
        assert f"FAILED: ended by a second Ctrl-C: {up} steps:" in words


@needs_tmux
def test_a_killed_station_gives_the_terminal_back(tmp_path: Path) -> None:
    """Ctrl-C must reach `run` again, and the shell must not be left without echo."""
    with Terminal(*RUN, cwd=tmp_path) as terminal:
        terminal.wait_for("takeoff")
        terminal.kill("station")
        terminal.wait_for(lambda text: "3/3 agents" not in text)
        terminal.press("C-c")
        terminal.wait_for("landing the swarm")
        code, _ = terminal.wait_for_end()
        assert code == 130


@needs_tmux
def test_a_killed_run_leaves_the_terminal_to_the_shell(tmp_path: Path) -> None:
    """The station gives it back at once, lands nothing itself, and writes the summary when all is
    over."""
    with Terminal(*RUN, cwd=tmp_path) as terminal:
        terminal.wait_for("takeoff")
        terminal.kill("run")
        terminal.wait_for(
            lambda text: "3/3 agents" not in text and {"isig", "echo", "icanon"} <= terminal.modes()
        )
        terminal.press(*"mine", "Enter")  # to `cat`, which says it again
        terminal.wait_for(lambda text: text.count("mine") == 2)
        terminal.wait_for(lambda _: bool(list(tmp_path.glob("runs/*/summary.json"))))


@pytest.mark.long
@needs_tmux
def test_two_more_stations_watch_command_and_leave(tmp_path: Path) -> None:
    with Running(*RUN[:2], "--speedup", "2", "--headless", cwd=tmp_path) as running:
        running.wait_for_event("step 1: takeoff")
        with (
            Terminal("station", cwd=tmp_path) as one,
            Terminal("station", "--headless", cwd=tmp_path) as other,
        ):
            other.wait_for("agents 1-3: ")
            other.press("C-c")
            other.wait_for("DONE")
            one.wait_for("3/3 agents")
            one.press("l")
            one.wait_for("Enter sends it")
            one.press("Enter")
            one.wait_for("land  ✓ agents 1-3")
            one.press("q")
            code, _ = one.wait_for_end()
            assert code == 0
        assert running.wait() == 1
        assert (
            '"kind":"land"' in (running.folder / "commands.jsonl").read_text()
        )  # stations hear each other
        running.assert_nothing_left()


@needs_tmux
def test_a_closed_terminal_lands_the_swarm(tmp_path: Path) -> None:
    """All processes live until the vehicles are down; the verdict says it, and there is a
    report."""
    with Terminal("run", HELD, "--speedup", "2", cwd=tmp_path) as terminal:
        terminal.wait_for("takeoff")
        (folder,) = (tmp_path / "runs").iterdir()
        terminal.close()
        until = time.monotonic() + 90
        while not (folder / "report.html").exists():
            assert time.monotonic() < until, sorted(folder.iterdir())
            time.sleep(0.1)
    summary = json.loads((folder / "summary.json").read_text())
    assert summary["reason"] == "the terminal was closed: all landed"
    assert summary["outcome"] == "aborted"
    assert set(summary["exit_codes"].values()) == {0}
    assert_truth_ends_on_the_ground(folder)
