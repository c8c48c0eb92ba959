"""The command line as a whole: version, help, errors."""

from __future__ import annotations

import io
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from importlib import metadata
from pathlib import Path
from typing import Any, Final

import pytest
import typer

from swarm_ctl.cli.app import app, main
from swarm_ctl.cli.shared.console import PlainConsole
from swarm_ctl.errors import StartError

GROUP = typer.main.get_command(app)
MISSION = str(Path(__file__).parents[3] / "missions" / "hexagon.yaml")
COMMANDS = sorted(GROUP.commands)  # type: ignore[attr-defined]
"""typer's group has its commands by name."""


def called(monkeypatch: pytest.MonkeyPatch, *words: str) -> int:
    """The exit code of `swarm-ctl` with these words."""
    monkeypatch.setattr("sys.argv", ["swarm-ctl", *words])
    monkeypatch.setenv("COLUMNS", "80")
    with pytest.raises(SystemExit) as ended:
        main()
    return int(ended.value.code or 0)


def words_of(text: str) -> str:
    """One line, as if nothing were wrapped: hyphens, too, may end a line."""
    return re.sub(r"\s+", "", text.replace("\b", ""))


def test_the_version(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    assert called(monkeypatch, "--version") == 0
    version = re.escape(metadata.version("swarm-ctl"))
    told = capsys.readouterr().out
    assert re.fullmatch(rf"swarm-ctl {version}( \(commit [0-9a-f]{{12}}\+?\))?\n", told)


@pytest.mark.parametrize("name", COMMANDS)
def test_no_help_text_loses_anything(
    name: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """At 80 columns the help has every character of the docstring and of each option's text; every
    command has an example, and every option says what it does."""
    command = GROUP.commands[name]  # type: ignore[attr-defined]
    assert called(monkeypatch, name, "--help") == 0
    out = capsys.readouterr().out
    assert max(map(len, out.splitlines())) <= 80
    assert f"swarm-ctl {name}" in out
    shown = words_of(out)
    assert words_of(command.help) in shown
    for parameter in command.params:
        assert parameter.help, parameter.name
        assert words_of(parameter.help) in shown


def _below(group: Any, above: str = "") -> Iterator[tuple[str, Any]]:
    for name, command in sorted(getattr(group, "commands", {}).items()):
        path = f"{above} {name}".strip()
        yield path, command
        yield from _below(command, path)


EVERY: Final = dict(_below(GROUP))
"""Commands and their subcommands, by their words."""


@pytest.mark.parametrize("path", EVERY)
def test_each_help_has_an_example_that_the_command_line_takes(path: str) -> None:
    """With options that there are."""
    lines = re.findall(r"^ +(?:\w+\$ +)?swarm-ctl (.+)$", EVERY[path].help or "", re.MULTILINE)
    lines += re.findall(r"^Try: swarm-ctl (.+)$", EVERY[path].help or "", re.MULTILINE)
    assert any(line.startswith(path) for line in lines)
    for line in lines:
        command, *words = re.split(r" [|>] ", line)[0].split()
        if words and f"{command} {words[0]}" in EVERY:
            command = f"{command} {words.pop(0)}"
        known = {name for each in EVERY[command].params for name in each.opts} | {"--help"}
        assert {word for word in words if word.startswith("--")} <= known, line


@pytest.mark.parametrize("group", ["", "hosts", "on-host", "missions", "trust"])
def test_the_list_of_commands_is_whole(
    group: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The first sentence of each command fits on its line."""
    assert called(monkeypatch, *group.split(), "--help") == 0
    listed = capsys.readouterr().out.partition("Commands:")[2]
    assert "..." not in listed
    names = COMMANDS if not group else re.findall(r"^  (\S+)", listed, re.MULTILINE)
    assert names
    assert all(re.search(rf"^  {name} +\S.*\.$", listed, re.MULTILINE) for name in names)


@pytest.mark.parametrize("option", [("--speed", "3"), ("--by",)])
def test_options_of_move_are_no_words_of_another_command(
    option: tuple[str, ...], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A speed behind `land` became the agent that is meant."""
    assert called(monkeypatch, "send", "land", *option) == 2
    of = "move" if option == ("--by",) else "move and goto"
    assert capsys.readouterr().err.startswith(f"error: {option[0]} is of {of} alone; allowed: land")


def test_an_error_is_one_message_without_control_characters(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert called(monkeypatch, "report", "no\x1b[2J[red]run") == 2
    said = capsys.readouterr().err
    assert said.startswith("error: no\\x1b[2J[red]run: is no run folder")
    assert "\x1b" not in said


@pytest.mark.parametrize("command", ["law add no.py", "study no.yaml", "validate no.yaml"])
def test_a_file_that_is_not_there_is_a_wrong_input(
    command: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert called(monkeypatch, *command.split()) == 2
    assert "can't be read: No such file or directory; allowed: " in capsys.readouterr().err


def test_report_takes_the_newest_run(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    monkeypatch.chdir(tmp_path)
    assert called(monkeypatch, "report") == 2
    assert capsys.readouterr().err == "error: no run in runs/; name a run folder\n"
    for name in ("20260101-120000-a", "20260101-120001-b"):
        (tmp_path / "runs" / name).mkdir(parents=True)
        (tmp_path / "runs" / name / "run.json").touch()
    assert called(monkeypatch, "report") == 2
    assert capsys.readouterr().err.startswith("error: runs/20260101-120001-b: ")


_ALONE = "--endpoint udpout:127.0.0.1:9 --mesh tcp/127.0.0.1:9"
UNWRITABLE = {
    "study": "study --missions 1 --out {}.csv",
    "search": "study --missions 1 --search smallest --budget 100000000 --out {}.csv",
    "picture": "study --missions 1 --out x.csv --row 1 --picture {}.png",
    "plan": "plan {mission} --out {}",
    "agent": f"agent {{mission}} --id 1 {_ALONE} --record {{}}",
    "compare": "compare a b --out {}.html",
    "paper": "paper --out {}",
}


@pytest.mark.parametrize("command", UNWRITABLE.values(), ids=UNWRITABLE)
@pytest.mark.parametrize("place", ["/proc/x", "file/x"])
def test_a_place_that_can_not_be_written_is_one_line_before_the_work(
    command: str,
    place: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
) -> None:
    """Exit code 3, as for all that the system refuses, with the option that chooses another; also
    for root, whom permissions do not stop."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "file").touch()
    assert called(monkeypatch, *command.format(place, mission=MISSION).split()) == 3
    said = capsys.readouterr().err
    assert re.match(rf"error: {place}(\.[a-z]+)?: can't be written: ", said)
    assert re.search(r"; choose with --[a-z]+\n$", said)
    assert said.count("\n") == 1


def test_the_command_that_plan_names_can_be_typed(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    monkeypatch.chdir(tmp_path)
    assert called(monkeypatch, "plan", MISSION, "--out", "x y.json") == 0
    assert "swarm-ctl agent 'x y.json' --id ID" in " ".join(capsys.readouterr().out.split())


def test_a_fleet_file_that_can_not_be_written_is_said_before_the_vehicle_takes_off(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    def refused(path: Path, choose: str) -> None:
        raise StartError(f"{path}; {choose}")

    fleet = tmp_path / "fleet.yaml"
    fleet.write_text("agents: [{id: 1, endpoint: 'udpout:127.0.0.1:9'}]")
    monkeypatch.setattr("swarm_ctl.cli.checks.measure.require_writable", refused)
    assert called(monkeypatch, "measure", "--fleet", str(fleet)) == 3
    assert capsys.readouterr().err == f"error: {fleet}; or fly with --dry-run\n"


def test_what_the_system_refuses_later_is_one_line(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("swarm_ctl.cli.missions.missions.require_writable", lambda *_: None)
    assert called(monkeypatch, "plan", MISSION, "--out", "/proc/plan.json") == 3
    assert capsys.readouterr().err == "error: /proc/plan.json: No such file or directory\n"


def test_the_pytest_plugin_imports_nothing_heavy() -> None:
    """Every pytest run of its environment loads it, where extras are missing, too."""
    code = "import swarm_ctl.testing.plugin, sys; print(*sorted(sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    loaded = set(done.stdout.split())
    assert not loaded & {"numpy", "pydantic", "rich", "typer", "yaml", "zenoh", "pymavlink"}
    assert {name for name in loaded if name.startswith("swarm_ctl")} == {
        "swarm_ctl",
        "swarm_ctl.testing",
        "swarm_ctl.testing.plugin",
    }


def test_a_missing_extra_is_named_with_its_remedy(monkeypatch: pytest.MonkeyPatch) -> None:
    """One line, exit code 3, before anything starts; `--help` works all the same."""
    needs = ["numpy>=1", "no-such-thing>=1.2; extra == 'ground'", "rich[x]; extra == 'ground'"]
    monkeypatch.setattr(metadata, "requires", lambda _: needs)
    screen = io.StringIO()
    monkeypatch.setattr("sys.stderr", screen)
    assert called(monkeypatch, "run", "missions/hexagon.yaml") == 3
    assert (
        screen.getvalue() == "error: swarm-ctl run needs no-such-thing;"
        " install with: pip install 'swarm-ctl[ground]'\n"
    )
    assert called(monkeypatch, "run", "--help") == 0
    assert called(monkeypatch, "keys") == 0


def test_a_reader_that_has_gone_ends_no_command() -> None:
    """As in `swarm-ctl run | head -1`, whose flight goes on; what is printed then is lost."""
    read, write = os.pipe()
    os.close(read)
    with os.fdopen(write, "w") as pipe:
        console = PlainConsole(file=pipe)
        console.say("one")
        console.say("two")


@pytest.mark.parametrize(
    "words", [("validate", "{}"), ("run", "{}"), ("run", MISSION, "--runs", "{}")]
)
def test_a_path_that_is_no_text_is_refused_in_one_line(
    words: tuple[str, ...], tmp_path: Path
) -> None:
    """Before anything is made: it could stand in no JSON file."""
    path = os.fsdecode(os.fsencode(tmp_path) + b"/m\xff.yaml")
    shutil.copy(MISSION, path)
    command = [sys.executable, "-m", "swarm_ctl.cli.main", *(word.format(path) for word in words)]
    done = subprocess.run(command, capture_output=True, cwd=tmp_path, check=False)
    assert done.returncode == 2
    assert re.fullmatch(
        rb"error: .*m.udcff.yaml: is not UTF-8; allowed: names in UTF-8\n", done.stderr
    )
    assert not (tmp_path / "runs").exists()


def test_a_library_that_makes_an_error_of_the_end_does_not_show_one(tmp_path: Path) -> None:
    """pydantic does, while it builds its validators."""
    start = """if True:
        import signal
        from swarm_ctl.cli import app, main
        def work():
            try:
                signal.raise_signal(signal.SIGTERM)
            except SystemExit as error:
                raise ValueError("can't build") from error
        app.main = work
        main.main()
    """
    done = subprocess.run(
        [sys.executable, "-c", start], capture_output=True, cwd=tmp_path, check=False
    )
    assert (done.returncode, done.stderr) == (130, b"ended: SIGTERM\n")


@pytest.mark.parametrize(
    ("number", "wait_s"),
    [(signal.SIGINT, 0.0), (signal.SIGTERM, 0.1), (signal.SIGHUP, 0.3), (signal.SIGINT, 0.3)],
)
def test_a_signal_ends_a_command_in_one_line(number: int, wait_s: float, tmp_path: Path) -> None:
    """While it still imports, too."""
    start = "import os, sys; from swarm_ctl.cli import main; os.write(1, b'up'); main.main()"
    command = [sys.executable, "-c", start, "paper", "--out", "paper"]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, cwd=tmp_path
    ) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        assert process.stdout.read(2) == b"up"
        time.sleep(0.02 + wait_s)
        process.send_signal(number)
        said = process.stderr.read()
    assert process.returncode == 130
    assert re.fullmatch(rb"ended: (Ctrl-C|SIGTERM|the terminal was closed)\n", said)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--junit", "."], "--junit .: can't be written"),
        (["--junit", f"{MISSION}/x.xml"], f"--junit {MISSION}/x.xml: can't be written"),
        (["--lockstep-with", "x"], "--lockstep-with: this run is in real time"),
        (["--lockstep-patience", "5", "--speedup", "3"], "--lockstep-patience: this run is in"),
        (["--px4", "x"], "--px4: no px4 flies here; allowed: beside --vehicles px4"),
        (["--px4-log"], "--px4-log: no px4 flies here"),
        (["--arducopter", "x"], "--arducopter: no arducopter flies here"),
        (["--lifeline", "990"], "--lifeline 990: is no pipe"),
    ],
)
def test_run_refuses_what_it_would_ignore(
    words: list[str],
    said: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
) -> None:
    """An option that this run has no use for, or can't use, is said before anything flies: no
    flight of simulated vehicles for one who forgot `--vehicles px4`, none whose JUnit is lost."""
    assert called(monkeypatch, "run", MISSION, "--runs", str(tmp_path), "--headless", *words) == 2
    assert f"error: {said}" in capsys.readouterr().err
    assert not any(tmp_path.iterdir())


def test_rows_of_a_study_are_no_folder(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    """One line before anything is flown, for one that is there and for `.`, which has no name."""
    monkeypatch.chdir(tmp_path)
    for folder in (".", str(tmp_path)):
        assert called(monkeypatch, "study", "--out", folder, "--missions", "1") == 2
        assert f"error: --out {folder}: is a folder; allowed: a .csv" in capsys.readouterr().err
