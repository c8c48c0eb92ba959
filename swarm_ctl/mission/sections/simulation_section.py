"""The section `simulation`: weather and faults of the simulated vehicles; not part of the plan.

The parameters are the simulator's, by their MAVLink names; a test compares the two lists.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping
from typing import Annotated, Any, Literal

from pydantic import Field

from swarm_ctl.mission.sections.section import AgentId, Section

Switch = Literal[0, 1] | None
Pilot = Literal["hold", "land", "return", "manual"]
"""What a pilot may put a vehicle into: LOITER or Hold, LAND, RTL; a mode of sticks alone."""
Offset = Annotated[float, Field(ge=-10_000, le=10_000)] | None
Deviation = Annotated[float, Field(ge=0, le=100)] | None


class SimParameters(Section):
    """SIM_* parameters of the simulator; a parameter that is not given stays as it is."""

    SIM_ARM_REFUSE: Switch = None
    """1: the vehicle refuses to arm."""
    SIM_BATT_DRAIN: Annotated[float, Field(ge=0, le=10_000)] | None = None
    """Factor of the battery's consumption; 1 is normal."""
    SIM_BATT_FAIL: Switch = None
    """1: the battery is empty at once."""
    SIM_COLL_FALL: Switch = None
    """1: the vehicle falls after touching another vehicle."""
    SIM_DELAY: Annotated[float, Field(ge=0, le=60)] | None = None
    """Delay of every MAVLink frame [s], both ways."""
    SIM_GPS_ACC: Deviation = None
    """Accuracy of the position [m] that the vehicle tells."""
    SIM_GPS_DRIFT: Deviation = None
    """Standard deviation [m] of the slow position error (changes within a minute)."""
    SIM_GPS_FREEZE: Switch = None
    """1: the reported position and velocity do not change."""
    SIM_GPS_JUMP_D: Offset = None
    """Added to the reported position [m], down."""
    SIM_GPS_JUMP_E: Offset = None
    """Added to the reported position [m], east."""
    SIM_GPS_JUMP_N: Offset = None
    """Added to the reported position [m], north."""
    SIM_GPS_NOISE: Deviation = None
    """Standard deviation [m] of the fast position error (changes within a second)."""
    SIM_GPS_OFF: Switch = None
    """1: no fix, no position."""
    SIM_GPS_SATS: Annotated[int, Field(ge=0, le=60)] | None = None
    """Number of satellites that the vehicle tells."""
    SIM_HB_MUTE: Switch = None
    """1: the vehicle sends no heartbeat."""
    SIM_LOSS: Annotated[float, Field(ge=0, le=100)] | None = None
    """Percent of MAVLink frames lost, both ways."""
    SIM_MOTOR_STOP: Switch = None
    """1: the motors stop, the vehicle falls."""
    SIM_REBOOT: Literal[1] | None = None
    """1: the autopilot restarts at once, also in flight."""
    SIM_VEL_NOISE: Annotated[float, Field(ge=0, le=5)] | None = None
    """Standard deviation [m/s] of the velocity estimate's error in flight (changes within seconds);
    0.25 for a PX4 if not given."""
    SIM_WIND_DIR: Annotated[float, Field(ge=-360, le=360)] | None = None
    """Direction that the wind comes from [degrees]."""
    SIM_WIND_GUST: Annotated[float, Field(ge=0, le=30)] | None = None
    """Standard deviation of the gusts [m/s]."""
    SIM_WIND_SPD: Annotated[float, Field(ge=0, le=60)] | None = None
    """Mean wind [m/s]."""

    def given(self) -> dict[str, float]:
        """Name and value of each parameter that is given."""
        return self.model_dump(exclude_none=True)


NEUTRAL: dict[str, float] = dict.fromkeys(SimParameters.model_fields, 0.0) | {
    "SIM_BATT_DRAIN": 1.0,
    "SIM_GPS_ACC": 0.3,
    "SIM_GPS_SATS": 12.0,
}
"""What the simulator starts with."""


class FaultEntry(Section):
    """Parameters that change at a time, and for how long."""

    at_s: float = Field(ge=0, le=86_400)
    """Seconds after what `since` names."""
    for_s: float | None = Field(default=None, gt=0, le=86_400)
    """How long; then each parameter gets its first value again. Default: to the end."""
    agents: Annotated[tuple[AgentId, ...], Field(min_length=1, max_length=250)] | None = None
    """Agents whose vehicles it hits. Default: all."""
    set: SimParameters = SimParameters.model_construct()
    pilot: Pilot | None = None
    """A pilot takes the vehicles over, with a mode of this kind; never with `for_s`."""


class SimulationSection(Section):
    """Weather and faults of simulated vehicles; vehicles with an endpoint ignore them."""

    parameters: SimParameters = SimParameters.model_construct()
    """Of all simulated vehicles, from the start."""
    since: Literal["liftoff", "start"] = "liftoff"
    """Zero of the faults' times: the first lift-off, or the run's start (seconds before arming)."""
    faults: Annotated[tuple[FaultEntry, ...], Field(max_length=1000)] = ()
    """In any order."""

    def timetable(self, sysids: Mapping[int, int]) -> list[dict[str, Any]]:
        """The faults as the simulator takes them, in the order of time; of faults at the same time,
        those that end come first.

        `sysids` gives the sysid of each simulated agent; other agents are left out.
        """
        start = NEUTRAL | self.parameters.given()
        begin, end = [], []
        for fault in self.faults:
            given = fault.set.given()
            for sysid in (sysids[i] for i in fault.agents or sysids if i in sysids):
                entry = {"at_s": fault.at_s, "sysid": sysid, "set": given}
                begin.append(entry | ({"pilot": fault.pilot} if fault.pilot else {}))
                if fault.for_s is not None:
                    back = {name: start[name] for name in given}
                    end.append({"at_s": fault.at_s + fault.for_s, "sysid": sysid, "set": back})
        return sorted(end + begin, key=lambda entry: entry["at_s"])


def overlaps(faults: tuple[FaultEntry, ...]) -> Iterator[tuple[int, int, str]]:
    """Pairs of faults (by index) of which the second sets a parameter of a vehicle while the first
    sets the same one, and the parameter."""
    ordered = sorted(enumerate(faults), key=lambda entry: entry[1].at_s)
    for (i, first), (k, second) in itertools.combinations(ordered, 2):
        if first.for_s is None or second.at_s >= first.at_s + first.for_s:
            continue
        same = (
            first.agents is None or second.agents is None or set(first.agents) & set(second.agents)
        )
        for name in first.set.given().keys() & second.set.given().keys() if same else ():
            yield i, k, name
