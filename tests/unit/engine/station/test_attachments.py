"""Extensions of a station: each in a thread of its own, from an entry point to its end."""

from __future__ import annotations

import importlib
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any, ClassVar

import pytest

from swarm_ctl.commands.parse import Order, parse
from swarm_ctl.commands.send import SentCommand
from swarm_ctl.core.model.messages import Ack, CommandKind
from swarm_ctl.engine.station import attachments
from swarm_ctl.engine.station.attachments import Attachments
from swarm_ctl.engine.station.ground_station import Station
from swarm_ctl.errors import InputError, StartError
from swarm_ctl.extension import Answer, Extension, StationHandle, check, found_extensions, wanted
from swarm_ctl.mesh import keys
from swarm_ctl.mesh.memory_transport import MemoryHub, MemoryTransport
from swarm_ctl.mesh.node import Node
from swarm_ctl.recording.topics import BY_NAME
from swarm_ctl.station.picture.protection import MeshKind, Protection
from tests.unit.report.run_folders import PLAN
from tests.unit.station.pictures import PICTURES

STATE = BY_NAME["state"]


class Noting(Extension):
    """Notes what it gets, and in which thread."""

    made: ClassVar[list[Noting]] = []

    def __init__(self, argument: str, station: StationHandle) -> None:
        self.argument, self.station = argument, station
        self.got: list[Any] = []
        self.threads = set[threading.Thread]()
        self.go = threading.Event()
        self.go.set()
        self.sink = self
        self.made.append(self)

    def note(self, what: Any) -> None:
        self.go.wait(20.0)
        self.threads.add(threading.current_thread())
        self.got.append(what)

    def take(self, view: Any) -> None:
        self.note(view)

    def write(self, topic: Any, agent: int | None, heard: int, said: int, data: bytes) -> None:
        self.note(data)

    def flush(self) -> None:
        self.note("flush")

    def abandon(self) -> None:
        self.note("abandon")

    def close(self) -> None:
        self.note("close")


class Setting:
    """A station on a mesh in memory."""

    def __init__(self, protection: Protection | None = None) -> None:
        self.now = 1.0
        self.hub = MemoryHub(lambda: self.now)
        self.agent = Node(MemoryTransport(self.hub), "swarm", 1)
        self.agent.listen(keys.COMMAND)
        node = Node(MemoryTransport(self.hub), "swarm", "station")
        clock = SimpleNamespace(stepped=False, speedup=1.0, now=lambda: self.now)
        more = {} if protection is None else {"protection": protection}
        self.station = Station(PLAN, node, clock, **more)


@pytest.fixture
def noting(monkeypatch: pytest.MonkeyPatch) -> Callable[[], Noting]:
    """`--attach any=ARGUMENT` attaches one; gives the newest."""
    monkeypatch.setattr(attachments, "wanted", lambda word: ("any", Noting, word.partition("=")[2]))
    monkeypatch.setattr(Noting, "made", [])
    return lambda: Noting.made[-1]


def until(what: Callable[[], Any]) -> None:
    limit = time.monotonic() + 20.0
    while not what():
        assert time.monotonic() < limit
        time.sleep(0.005)


def test_what_it_says_is_told_to_the_operator(noting: Callable[[], Noting]) -> None:
    station = Setting().station
    with Attachments(["any"], station) as attached:
        noting().station.tell("the link: http://127.0.0.1:1/x")
        attached.turn()
        assert station.turn() == ["the link: http://127.0.0.1:1/x"]
        attached.turn()
        assert station.turn() == []


def test_it_gets_views_and_messages_in_a_thread_of_its_own(noting: Callable[[], Noting]) -> None:
    view = PICTURES["waiting"]()
    with Attachments(["any=7"], Setting().station) as attached:
        extension = noting()
        assert (extension.argument, extension.station.plan) == ("7", PLAN)
        assert (extension.station.now(), extension.station.name) == (1.0, "station")
        attached.show(view)
        until(lambda: extension.got)
        (sink,) = attached.sinks
        sink.write(STATE, 1, 2, 3, b"{}")
        sink.flush()
        sink.close()
    assert extension.got == [view, b"{}", "flush", "close", "close"]
    assert len(extension.threads) == 1
    assert threading.current_thread() not in extension.threads


def test_one_that_hangs_delays_nothing_and_misses_views_and_messages(
    noting: Callable[[], Noting], capsys: pytest.CaptureFixture[str]
) -> None:
    """100 views and 30,000 messages are handed over while it takes the first; of the views it then
    gets the newest, of the messages as many as may wait. Its end is not waited for longer than two
    seconds. That it was slow is told once."""
    setting = Setting()
    attached = Attachments(["any"], setting.station)
    extension = noting()
    extension.go.clear()
    views = [PICTURES["waiting"]() for _ in range(100)]
    began = time.monotonic()
    attached.show(views[0])
    until(lambda: attached._all[0]._view is None)
    for view in views[1:]:
        attached.show(view)
        attached.turn()
    for _ in range(30_000):
        attached.sinks[0].write(STATE, 1, 2, 3, b"{}")
    assert time.monotonic() - began < 5.0
    (told,) = setting.station.troubles()
    assert "extension any, which is slow, failed" in told
    began = time.monotonic()
    attached.close()
    assert 1.9 < time.monotonic() - began < 8.0
    assert "extension any does not end" in capsys.readouterr().err
    extension.go.set()
    until(lambda: "close" in extension.got)
    shown = [each for each in extension.got if each in views]
    assert [view is views[k] for view, k in zip(shown, (0, 99), strict=True)] == [True, True]
    assert extension.got.count(b"{}") == pytest.approx(20_000, abs=3)


def test_ten_errors_in_a_row_close_it(noting: Callable[[], Noting]) -> None:
    """It is told twice: that it failed, and that it has stopped. Nothing reaches it after that."""
    setting = Setting()
    with Attachments(["any"], setting.station) as attached:
        extension, calls = noting(), list[bytes]()

        def fails(topic: object, agent: object, heard: object, said: object, data: bytes) -> None:
            calls.append(data)
            raise IndexError("out of range")

        extension.write = fails  # type: ignore[method-assign]
        for _ in range(30):
            attached.sinks[0].write(STATE, 1, 2, 3, b"{}")
        until(lambda: "close" in extension.got)
        told = setting.station.troubles()
    assert [line.partition(":")[0] for line in told] == [
        "extension any failed",
        "extension any has stopped",
    ]
    assert len(calls) == 10
    assert extension.got == ["close"]


def test_its_orders_are_sent_in_the_stations_turn_and_answered(
    noting: Callable[[], Noting],
) -> None:
    """One a turn; an answer comes once all agents have answered, in the extension's thread; what
    the station leaves unanswered is answered as it stands when it ends."""
    setting, answers = Setting(), list[Answer]()
    with Attachments(["any"], setting.station) as attached:
        extension = noting()

        def answered(answer: Answer) -> None:
            extension.note("answer")
            answers.append(answer)

        extension.station.order(parse("hold 1", PLAN), answered)
        extension.station.order(parse("land", PLAN), answered)
        assert setting.agent.take(keys.COMMAND) == []
        attached.turn()
        ((command, _),) = setting.agent.take(keys.COMMAND)
        assert (command.kind, command.agents) == (CommandKind.HOLD, (1,))
        assert answers == []
        setting.agent.send(keys.ACK, Ack(1, command.id, True, ""))
        setting.station.hear()
        attached.turn()
        until(lambda: answers)
        assert [c.kind for c, _ in setting.agent.take(keys.COMMAND)] == [CommandKind.LAND]
    first, second = answers
    assert isinstance(first, SentCommand)
    assert (first.accepted, first.over) == (True, True)
    assert isinstance(second, SentCommand)
    assert (second.over, second.silent) == (False, tuple(a.id for a in PLAN.agents))
    assert threading.current_thread() not in extension.threads


def test_an_order_that_cannot_be_sent_is_answered_with_the_reason(
    noting: Callable[[], Noting],
) -> None:
    """A viewer's station sends none; what is no order ends nothing, and is told; too many wait."""
    setting, answers = Setting(Protection(MeshKind.TLS, "viewer-1", commands=False)), []
    with Attachments(["any"], setting.station) as attached:
        for _ in range(101):
            noting().station.order(Order(CommandKind.LAND), answers.append)
        attached.turn()
        until(lambda: len(answers) == 2)
    assert "100 orders wait; allowed: fewer" in str(answers[0])
    assert "may only watch; allowed: an operator's keys" in str(answers[1])
    setting, answers = Setting(), []
    with Attachments(["any"], setting.station) as attached:
        noting().station.order(None, answers.append)  # type: ignore[arg-type]
        attached.turn()
        until(lambda: answers)
        assert isinstance(answers[0], InputError)
        (told,) = setting.station.troubles()
        assert "an order of extension any failed" in told


def test_an_error_at_the_start_closes_those_before(
    noting: Callable[[], Noting], monkeypatch: pytest.MonkeyPatch
) -> None:
    """It is a StartError that says where; one that the extension means is passed on."""

    class Broken(Noting):
        def __init__(self, argument: str, station: StationHandle) -> None:
            raise InputError("no such domain") if argument else KeyError("x")

    monkeypatch.setattr(
        attachments,
        "wanted",
        lambda word: ("any", Noting if word == "any" else Broken, word.partition("=")[2]),
    )
    with pytest.raises(StartError, match=r"--attach broken: KeyError: 'x'"):
        Attachments(["any", "broken"], Setting().station)
    with pytest.raises(InputError, match="no such domain"):
        Attachments(["any", "broken=3"], Setting().station)
    assert noting().got == ["close"]


PACKAGE = """
from swarm_ctl.extension import Extension

class Lamp(Extension):
    @classmethod
    def check(cls, argument):
        if argument == "odd":
            raise KeyError(argument)

no_class = 3
"""


@pytest.fixture
def package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """An installed package with entry points."""
    (tmp_path / "lamp_of_a_test.py").write_text(PACKAGE)
    about = tmp_path / "lamp-1.0.dist-info"
    about.mkdir()
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: lamp\nProvides-Extra: lacks\n")
    (about / "entry_points.txt").write_text(
        "[swarm_ctl.extensions]\nlamp = lamp_of_a_test:Lamp\nnumber = lamp_of_a_test:no_class\n"
        "lacks = lamp_of_no_test:Lamp\ngone = lamp_of_a_test:Gone\n"
        "prometheus = lamp_of_a_test:Lamp\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    importlib.invalidate_caches()
    yield
    sys.modules.pop("lamp_of_a_test", None)


@pytest.mark.usefixtures("package")
def test_an_installed_package_brings_one() -> None:
    assert found_extensions().keys() >= {"foxglove", "prometheus", "lamp"}
    name, kind, argument = wanted("lamp=a=b")
    assert (name, kind.__name__, argument) == ("lamp", "Lamp", "a=b")
    check(["lamp", "lamp=3"])


@pytest.mark.usefixtures("package")
@pytest.mark.parametrize(
    ("word", "error", "said"),
    [
        ("lmap", InputError, "--attach lmap: no such extension is installed; allowed: .*lamp, "),
        ("prometheus=1", InputError, "there more than once: .*lamp_of_a_test:Lamp.*allowed: once"),
        ("number", InputError, "lamp_of_a_test:no_class: is no Extension; allowed: a subclass of"),
        ("gone=1", InputError, "--attach gone=1: lamp_of_a_test:Gone: AttributeError: .*allowed"),
        (
            "lacks",
            StartError,
            r"needs lamp_of_no_test, .*install with: pip install 'lamp\[lacks\]'",
        ),
        ("lamp=odd", StartError, "--attach lamp: KeyError: 'odd'"),
    ],
)
def test_what_cannot_be_attached_is_refused_before_the_flight(
    word: str, error: type[Exception], said: str
) -> None:
    with pytest.raises(error, match=said):
        check([word])
