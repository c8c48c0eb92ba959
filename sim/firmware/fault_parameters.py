"""SIM_* parameters: what can be made to go wrong, and the weather; the same for both personas, all
off by default.

Real parameters of the simulated vehicle: a client sets them live over MAVLink, a configuration at
start or at a time.
"""

from __future__ import annotations

from sim.firmware.protocol.parameters import Kind, Parameter


def _switch() -> Parameter:
    return Parameter(Kind.INT32, 0.0)  # PX4's clients know no shorter integers


def _number(value: float = 0.0) -> Parameter:
    return Parameter(Kind.REAL32, value)


SIM_DEFAULTS: dict[str, Parameter] = {
    "SIM_ARM_REFUSE": _switch(),  # 1: pre-arm checks fail
    "SIM_BATT_DRAIN": _number(1.0),  # factor on what flying costs
    "SIM_BATT_FAIL": _switch(),  # 1: as good as empty at once
    "SIM_COLL_FALL": _switch(),  # 1: falls after touching another vehicle
    "SIM_DELAY": _number(),  # s, of every frame, both ways
    "SIM_GPS_DRIFT": _number(),  # m, standard deviation of the slow error (a minute)
    "SIM_GPS_FREEZE": _switch(),  # 1: position and velocity stay as they are
    "SIM_GPS_JUMP_D": _number(),  # m, added to the position
    "SIM_GPS_JUMP_E": _number(),
    "SIM_GPS_JUMP_N": _number(),
    "SIM_GPS_NOISE": _number(),  # m, standard deviation of the quick error (a second)
    "SIM_GPS_OFF": _switch(),  # 1: no fix, no position estimate
    "SIM_HB_MUTE": _switch(),  # 1: no HEARTBEAT
    "SIM_LOSS": _number(),  # percent of frames lost, both ways
    "SIM_MOTOR_STOP": _switch(),  # 1: falls
    "SIM_REBOOT": _switch(),  # 1: restarts at once, in flight too; goes back to 0
    "SIM_WIND_DIR": _number(),  # deg, where the wind comes from
    "SIM_WIND_GUST": _number(),  # m/s, standard deviation of gusts
    "SIM_WIND_SPD": _number(),  # m/s
}
