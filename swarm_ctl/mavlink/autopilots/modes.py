"""Mode names of each firmware, as HEARTBEAT reports them and DO_SET_MODE asks for them.

Which mode a goal needs is chosen by `base.Autopilot` (landing), `ardupilot.py` and `px4.py` (the
rest), from the mode that the vehicle is seen in.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as dialect

from swarm_ctl.mavlink import outgoing
from swarm_ctl.mavlink.outgoing import Message

_PX4_NAMES: Final[Mapping[tuple[int, ...], str]] = {
    (1, 0): "MANUAL",
    (2, 0): "ALTCTL",
    (3, 0): "POSCTL",
    (4, 1): "AUTO.READY",
    (4, 2): "AUTO.TAKEOFF",
    (4, 3): "AUTO.LOITER",
    (4, 4): "AUTO.MISSION",
    (4, 5): "AUTO.RTL",
    (4, 6): "AUTO.LAND",
    (4, 8): "AUTO.FOLLOW",
    (4, 9): "AUTO.PRECLAND",
    (5, 0): "ACRO",
    (6, 0): "OFFBOARD",
    (7, 0): "STABILIZED",
}
"""px4_custom_mode.h: main mode, sub mode."""


@dataclass(frozen=True, slots=True)
class ModeTable:
    """The modes of one firmware."""

    names: Mapping[tuple[int, ...], str]
    """By parameters 2 and 3 of DO_SET_MODE."""
    parameters: Callable[[int], tuple[int, ...]]
    """From a HEARTBEAT's custom_mode to those parameters."""

    def name(self, custom_mode: int | None) -> str:
        """`GUIDED`, `AUTO.LOITER`, ...; '' for None; `MODE 99` or `MODE 9/0` for an unknown one."""
        if custom_mode is None:
            return ""
        numbers = self.parameters(custom_mode)
        return self.names.get(numbers) or f"MODE {'/'.join(map(str, numbers))}"

    def command(self, system: int, mode: str) -> Message:
        """DO_SET_MODE for the mode of this name."""
        numbers = next(numbers for numbers, name in self.names.items() if name == mode)
        return outgoing.command(system, outgoing.SET_MODE, outgoing.CUSTOM_MODE, *numbers)


def _copter_parameters(custom_mode: int) -> tuple[int, ...]:
    return (custom_mode,)


def _px4_parameters(custom_mode: int) -> tuple[int, ...]:
    main, sub = custom_mode >> 16 & 0xFF, custom_mode >> 24 & 0xFF
    # Only AUTO (4) has sub modes.
    return (main, 0) if (main, 0) in _PX4_NAMES else (main, sub)


COPTER_MODES: Final = ModeTable(
    {
        (number,): entry.name.removeprefix("COPTER_MODE_")
        for number, entry in dialect.enums["COPTER_MODE"].items()
        if not entry.name.endswith("_ENUM_END")
    },
    _copter_parameters,
)
PX4_MODES: Final = ModeTable(_PX4_NAMES, _px4_parameters)
