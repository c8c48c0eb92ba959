"""PX4's parameters, with the values of a new vehicle unless said otherwise."""

from __future__ import annotations

from swarm_sim.firmware.parameters.parameter_set import typed

_GAINS = {"P": 0.15, "I": 0.2, "D": 0.003}
_INERT = typed(
    {
        f"RC{i}_{end}": value
        for i in range(1, 9)
        for end, value in (("MIN", 1100.0), ("TRIM", 1500.0), ("MAX", 1900.0))
    }
    | {f"COM_FLTMODE{i}": -1 for i in range(1, 7)}
    | {
        f"MC_{axis}RATE_{gain}": value
        for axis in ("PITCH", "ROLL")
        for gain, value in _GAINS.items()
    }
    | {
        "BAT_LOW_THR": 0.15,
        "BAT_EMERGEN_THR": 0.05,
        "CBRK_SUPPLY_CHK": 894281,
        "COM_ARM_WO_GPS": 1,
        "COM_RC_IN_MODE": 1,
        "EKF2_AID_MASK": 1,
        "GF_ACTION": 2,
        "GF_MAX_HOR_DIST": 0.0,
        "GF_MAX_VER_DIST": 0.0,
        "MAV_TYPE": 2,
        "MIS_YAWMODE": 0,
        "MPC_TILTMAX_AIR": 45.0,
        "MPC_XY_P": 0.95,
        "MPC_XY_VEL_I_ACC": 0.4,
        "MPC_XY_VEL_P_ACC": 1.8,
        "MPC_Z_P": 1.0,
        "MPC_Z_VEL_I_ACC": 2.0,
        "MPC_Z_VEL_MAX_DN": 1.5,
        "MPC_Z_VEL_MAX_UP": 3.0,
        "MPC_Z_VEL_P_ACC": 4.0,
        "NAV_RCL_ACT": 2,
        "SDLOG_MODE": 0,
        "SENS_BOARD_ROT": 0,
        "SYS_HAS_BARO": 1,
        "SYS_HAS_GPS": 1,
        "SYS_HAS_MAG": 1,
        "SYS_HITL": 0,
    }
)
"""Clients ask for them and show them; nothing flies by them here."""

PX4_DEFAULTS = _INERT | typed(
    {
        "BAT1_CAPACITY": 3300.0,
        "BAT_CRIT_THR": 0.07,
        "COM_DISARM_LAND": 2.0,
        "COM_DISARM_PRFLT": 10.0,
        "COM_DL_LOSS_T": 10,
        "COM_LOW_BAT_ACT": 0,
        "COM_OBL_RC_ACT": 0,
        "COM_OF_LOSS_T": 1.0,
        "COM_SPOOLUP_TIME": 1.0,
        "EKF2_DRAG_CTRL": 0,  # no estimate of the wind
        "MAV_SYS_ID": 1,
        "MIS_TAKEOFF_ALT": 2.5,
        "MPC_LAND_ALT1": 10.0,
        "MPC_LAND_ALT2": 5.0,
        "MPC_LAND_SPEED": 0.7,
        "MPC_TKO_RAMP_T": 3.0,
        "MPC_TKO_SPEED": 1.5,
        "MPC_XY_CRUISE": 5.0,
        "MPC_XY_VEL_MAX": 12.0,
        "MPC_Z_V_AUTO_DN": 1.5,
        "MPC_Z_V_AUTO_UP": 3.0,
        "NAV_ACC_RAD": 2.0,
        "NAV_DLL_ACT": 0,
        "RTL_DESCEND_ALT": 10.0,
        "RTL_LAND_DELAY": 0.0,
        "RTL_RETURN_ALT": 30.0,
        "SYS_AUTOSTART": 10040,
    }
)
