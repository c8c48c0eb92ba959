"""Gives a vehicle its signing key on the bench, or takes it off, and looks what the vehicle then
does. No sockets of its own, no clock."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterator
from dataclasses import dataclass
from enum import Enum, StrEnum
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as dialect

from swarm_ctl.mavlink.framer import MavlinkFrame
from swarm_ctl.mavlink.outgoing import AUTOPILOT_COMPONENT, interval, request
from swarm_ctl.mavlink.signing import KEY_BYTES, LinkSigning, SigningRefusal
from swarm_ctl.mavlink.visitor import EACH_S, WAIT_S, Visitor
from swarm_ctl.mavlink.wires import Wire

_UNSIGNED_S: Final = 3.0
"""In which the vehicle does not answer unsigned frames: three are sent."""


class Signs(StrEnum):
    """How the vehicle's newest heartbeat was signed."""

    NOT = "it does not sign"
    OURS = "it signs with its key"
    OTHER = "it signs with another key"


@dataclass(frozen=True, slots=True)
class KeyReport:
    """What the vehicle did."""

    trouble: str = ""
    """Why it is not set up; ''."""
    px4: bool = False
    signs: Signs | None = None
    """None: it was not heard."""
    takes_unsigned: bool = False
    """It answered an unsigned frame on this link."""


class _Asks(Enum):
    """The commands that go signed, and unsigned; their answers name them."""

    SIGNED = dialect.MAV_CMD_REQUEST_MESSAGE
    UNSIGNED = dialect.MAV_CMD_SET_MESSAGE_INTERVAL


class KeySetup:
    """One vehicle on one link. `step` is to be called again and again until it gives the report.

    With `clear` the key is taken off, by a frame that is signed with it.
    """

    def __init__(
        self, wire: Wire, sysid: int, key: bytes, signing: LinkSigning, *, clear: bool = False
    ) -> None:
        self._sysid, self._clear, self._key, self._signing = sysid, clear, key, signing
        self._open, self._signed = Visitor(wire, sysid), Visitor(wire, sysid, signing)
        self._signs: Signs | None = None
        self._armed = self._px4 = False
        self._answered: set[int] = set()
        self._now = 0.0
        self._plan = self._work()

    def step(self, now: float) -> KeyReport | None:
        """Take in what has come, and send what is due."""
        self._now = now
        for frame in self._open.heard(now):
            self._take(frame)
        try:
            next(self._plan)
        except StopIteration as end:
            trouble: str = end.value
            unsigned = not self._clear and _Asks.UNSIGNED.value in self._answered
            return KeyReport(trouble, self._px4, self._signs, unsigned)
        return None

    def _work(self) -> Generator[None, None, str]:
        """One thing after another; its value is the trouble."""
        yield from self._until(lambda: self._signs is not None, self._greet)
        if self._signs is None:
            return f"vehicle {self._sysid} was not heard in {WAIT_S:.0f} s"
        if self._armed:
            return f"vehicle {self._sysid} is armed; allowed: a disarmed one, on the bench"
        wanted = Signs.NOT if self._clear else Signs.OURS
        if self._signs is not wanted:
            yield from self._until(lambda: self._signs is wanted, self._set)
        if self._signs is not wanted:
            return self._not_taken()
        if not self._clear:
            self._answered.clear()
            yield from self._until(self._answers, lambda: self._say(_Asks.SIGNED))
            if not self._answers():
                return f"vehicle {self._sysid} signs, and does not answer signed frames"
            self._answered.clear()
            until = self._now + _UNSIGNED_S
            yield from self._until(lambda: self._now > until, lambda: self._say(_Asks.UNSIGNED))
        return ""

    def _not_taken(self) -> str:
        about = f"vehicle {self._sysid}: {self._signs}"
        if self._signs is Signs.OTHER:
            return (
                f"{about}; allowed: take that off first, with the trust folder that has it"
                " (--clear), or over USB on an ArduPilot, or with the SD card on a PX4"
            )
        older = " (PX4 signs from 1.18)" if self._px4 else ""
        return f"{about}, although it was told to{older}" if not self._clear else about

    def _answers(self) -> bool:
        return _Asks.SIGNED.value in self._answered

    def _until(self, condition: Callable[[], bool], act: Callable[[], None]) -> Iterator[None]:
        end, due = self._now + WAIT_S, self._now
        while not condition() and self._now < end:
            if self._now >= due:
                due = self._now + EACH_S
                act()
            yield

    def _greet(self) -> None:
        """A vehicle on UDP speaks to those that it has heard."""
        for visitor in (self._open, self._signed):
            visitor.say(interval(self._sysid, dialect.MAVLINK_MSG_ID_HEARTBEAT, 1.0), self._now)

    def _set(self) -> None:
        key = bytes(KEY_BYTES) if self._clear else self._key
        stamp = 0 if self._clear else self._signing.next_stamp(self._now)
        to = (self._sysid, AUTOPILOT_COMPONENT)
        message = dialect.MAVLink_setup_signing_message(*to, list(key), stamp)
        (self._signed if self._clear else self._open).say(message, self._now)

    def _say(self, ask: _Asks) -> None:
        if ask is _Asks.SIGNED:
            message = request(self._sysid, dialect.MAVLINK_MSG_ID_AUTOPILOT_VERSION)
            self._signed.say(message, self._now)
        else:
            message = interval(self._sysid, dialect.MAVLINK_MSG_ID_HEARTBEAT, 1.0)
            self._open.say(message, self._now)

    def _take(self, frame: MavlinkFrame) -> None:
        why = self._signing.refusal(frame)
        signs = Signs.OURS if why is None else _SIGNS.get(why, Signs.OURS)
        message = self._open.read(frame)
        kind = message.get_type()
        if kind == "HEARTBEAT":
            self._signs = signs
            self._armed = bool(message.base_mode & dialect.MAV_MODE_FLAG_SAFETY_ARMED)
            self._px4 = message.autopilot == dialect.MAV_AUTOPILOT_PX4
        elif kind == "COMMAND_ACK":
            self._answered.add(message.command)


_SIGNS: Final = {
    SigningRefusal.UNSIGNED: Signs.NOT,
    SigningRefusal.MAVLINK_1: Signs.NOT,
    SigningRefusal.WRONG_KEY: Signs.OTHER,
}
