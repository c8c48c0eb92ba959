"""How often a vehicle is asked for its messages."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Final

from swarm_ctl.mavlink import outgoing
from swarm_ctl.mavlink.autopilots.timing import (
    MAY_BE_SILENT,
    QUIET_RETRY_S,
    RETRY_S,
    SLOW_HZ,
    STREAMS_HZ,
    Pacer,
)
from swarm_ctl.mavlink.outgoing import Message
from swarm_ctl.mavlink.telemetry.incoming import message_id
from swarm_ctl.mavlink.telemetry.vehicle_telemetry import Telemetry

_NO_STREAMS: Final = frozenset(
    map(
        message_id,
        (
            "AUTOPILOT_VERSION",
            "COMMAND_ACK",
            "GPS_GLOBAL_ORIGIN",
            "HEARTBEAT",
            "PARAM_VALUE",
            "STATUSTEXT",
            "TIMESYNC",
        ),
    )
)
"""Needed, and sent on request or by themselves."""
_STOPS_AT_ONCE: Final = 4
"""Requests a second of one vehicle that end a stream."""


class Streams:
    """Of one vehicle. `hz` has each message that is wanted, with its rate.

    With another `hz` than `STREAMS_HZ` the link is narrow: then what is not wanted, or comes far
    too often, is asked to stop. A vehicle's own streams as delivered would fill a shared radio.
    """

    def __init__(self, system: int, hz: Mapping[str, float], more_hz: Mapping[str, float]) -> None:
        self._system = system
        self._hz = {message_id(name): rate for name, rate in {**more_hz, **hz}.items()}
        self._silent = frozenset(map(message_id, MAY_BE_SILENT))
        self._narrow = hz is not STREAMS_HZ
        self._counts: dict[int, int] = {}

    def ask(self, heard: Telemetry, pacer: Pacer, now: float) -> list[Message]:
        """To be called each `RETRY_S`: ask for the streams of which less than half has come,
        because another ground station may have slowed them."""
        before, self._counts = self._counts, dict(heard.counts)
        came = {number: count - before.get(number, 0) for number, count in self._counts.items()}
        wanted = [*self._wanted(came, pacer, now)]
        return wanted + [*self._unwanted(came, pacer, now)][:_STOPS_AT_ONCE]

    def _wanted(self, came: Mapping[int, int], pacer: Pacer, now: float) -> Iterator[Message]:
        for number, rate_hz in self._hz.items():
            quiet = number in self._silent or rate_hz <= SLOW_HZ
            least = 1 if quiet else 0.5 * rate_hz * RETRY_S
            count = came.get(number, 0)
            wrong = count < least or (self._narrow and count > 2 * rate_hz * RETRY_S + 1)
            if wrong and pacer.due(f"stream {number}", QUIET_RETRY_S if quiet else RETRY_S, now):
                yield outgoing.interval(self._system, number, rate_hz)

    def _unwanted(self, came: Mapping[int, int], pacer: Pacer, now: float) -> Iterator[Message]:
        others = came.keys() - self._hz.keys() - _NO_STREAMS if self._narrow else set()
        for number in sorted(others, key=lambda each: -came[each]):
            if came[number] and not pacer.recent(f"stop {number}", QUIET_RETRY_S, now):
                pacer.due(f"stop {number}", QUIET_RETRY_S, now)
                yield outgoing.no_stream(self._system, number)
