"""SIM_* parameters: faults and weather; the same for both personas, all off by default.

They are real parameters of the simulated vehicle: a client sets them live over MAVLink, a
configuration at start or at a given time.
"""

from __future__ import annotations

from swarm_sim.firmware.parameters.parameter_set import TypedValue, typed

# switches are INT32: PX4's clients know no shorter integers
SIM_DEFAULTS: dict[str, TypedValue] = typed(
    {
        "SIM_ARM_REFUSE": 0,  # 1: pre-arm checks fail
        "SIM_BATT_DRAIN": 1.0,  # factor on the consumption
        "SIM_BATT_FAIL": 0,  # 1: as good as empty at once
        "SIM_COLL_FALL": 0,  # 1: falls after touching another vehicle
        "SIM_DELAY": 0.0,  # s, of every frame, both ways
        "SIM_GPS_ACC": 0.3,  # m, the accuracy that receiver and estimator tell
        "SIM_GPS_DRIFT": 0.0,  # m, standard deviation of the slow error (a minute)
        "SIM_GPS_FREEZE": 0,  # 1: position and velocity stay as they are
        "SIM_GPS_JUMP_D": 0.0,  # m, added to the position
        "SIM_GPS_JUMP_E": 0.0,
        "SIM_GPS_JUMP_N": 0.0,
        "SIM_GPS_NOISE": 0.0,  # m, standard deviation of the quick error (a second)
        "SIM_GPS_OFF": 0,  # 1: no fix, no position estimate
        "SIM_GPS_SATS": 12,  # satellites that the receiver tells
        "SIM_HB_MUTE": 0,  # 1: no HEARTBEAT
        "SIM_LOSS": 0.0,  # percent of frames lost, both ways
        "SIM_MOTOR_STOP": 0,  # 1: falls
        "SIM_REBOOT": 0,  # 1: restarts at once, in flight too; goes back to 0
        "SIM_VEL_NOISE": 0.0,  # m/s, standard deviation of the velocity estimate's error in flight
        "SIM_WIND_DIR": 0.0,  # deg, where the wind comes from
        "SIM_WIND_GUST": 0.0,  # m/s, standard deviation of gusts
        "SIM_WIND_SPD": 0.0,  # m/s
    }
)
