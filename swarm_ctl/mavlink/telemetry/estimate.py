"""What a vehicle says of its own estimate: EKF_STATUS_REPORT (ArduPilot), ESTIMATOR_STATUS (PX4),
GPS_RAW_INT.

Here is what makes an estimate unfit to fly a formation by; how accurate a position has to be is the
mission's (`Policies.position_accuracy_m`).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Final

from pymavlink.dialects.v20 import ardupilotmega as dialect

SILENT_S: Final = 3.0
"""Six reports in a row missing (2 Hz). A report that was there and is not any more is a fault."""
LEAST_SATELLITES: Final = 6
"""The autopilots' own figure for arming (EK3_GPS_CHECK, EKF2_REQ_NSATS)."""
_MAX_ACCURACY_M: Final = 1e6
_RATIOS: Final = {
    "velocity": ("velocity_variance", "vel_ratio"),
    "horizontal position": ("pos_horiz_variance", "pos_horiz_ratio"),
    "height": ("pos_vert_variance", "pos_vert_ratio"),
    "compass": ("compass_variance", "mag_ratio"),
}
"""Of a measurement's surprise to the largest one that the estimator accepts. By name: field of
EKF_STATUS_REPORT, field of ESTIMATOR_STATUS."""
_NEEDED: Final = {
    dialect.EKF_ATTITUDE: "attitude",
    dialect.EKF_VELOCITY_HORIZ: "horizontal velocity",
    dialect.EKF_VELOCITY_VERT: "vertical velocity",
    dialect.EKF_POS_HORIZ_ABS: "horizontal position",
    dialect.EKF_POS_VERT_ABS: "height",
}
"""Flags, of a bit each, without which nothing is flown; ESTIMATOR_STATUS has the same bits. The
flag of a constant position is none of the wrong ones: PX4 sets it while it stands on the ground."""
_ALL_NEEDED: Final = sum(_NEEDED)


@dataclass(frozen=True, slots=True)
class EstimateRules:
    """What one firmware's reports have to say."""

    message: str
    """Its report's name."""
    wrong: Mapping[int, str]
    """Flags that say what is wrong."""
    most_ratio: float


EKF_RULES: Final = EstimateRules(
    "EKF_STATUS_REPORT",
    {dialect.EKF_UNINITIALIZED: "not initialised", dialect.EKF_GPS_GLITCHING: "GPS glitch"},
    0.8,  # FS_EKF_THRESH as delivered: its own failsafe wants two of them for 1 s
)
ESTIMATOR_RULES: Final = EstimateRules(
    "ESTIMATOR_STATUS",
    {
        dialect.ESTIMATOR_GPS_GLITCH: "GPS glitch",
        dialect.ESTIMATOR_ACCEL_ERROR: "accelerometer fault",
    },
    1.0,  # over 1 the estimator refuses the measurement
)


@dataclass(slots=True)
class EstimateHealth:
    """The newest reports. Times are the link's clock [s], -inf: never heard."""

    report_s: float = -math.inf
    flags: int = 0
    ratios: dict[str, float] = field(default_factory=dict)
    accuracy_m: float | None = None
    """The estimator's own (PX4), one standard deviation."""
    gps_s: float = -math.inf
    fix_type: int = 0
    satellites: int = 0
    gps_accuracy_m: float | None = None
    """The receiver's own; None where it gives none."""
    had_accuracy: bool = False
    had_fix: bool = False
    """The receiver has had a 3D fix: without one it is not judged (a vehicle may have no GPS)."""

    def report(self, message: Any, now: float) -> bool:
        """Take in EKF_STATUS_REPORT or ESTIMATOR_STATUS. A ratio or an accuracy that can't be true
        is beyond any limit. PX4 gives NaN for what it does not measure."""
        px4 = message.get_msgId() == dialect.MAVLINK_MSG_ID_ESTIMATOR_STATUS
        ratios = {name: getattr(message, fields[px4]) for name, fields in _RATIOS.items()}
        accuracy_m = message.pos_horiz_accuracy if px4 else 0.0
        self.report_s, self.flags = now, message.flags
        self.ratios = {
            name: ratio if ratio >= 0.0 or (px4 and ratio != ratio) else math.inf
            for name, ratio in ratios.items()
        }
        possible = 0.0 <= accuracy_m <= _MAX_ACCURACY_M
        self.accuracy_m = None if not px4 else accuracy_m if possible else _MAX_ACCURACY_M
        return True

    def gps(self, message: Any, now: float) -> bool:
        """Take in GPS_RAW_INT: the fix, the satellites and the receiver's accuracy [mm, 0: not
        known]."""
        self.gps_s, self.fix_type = now, message.fix_type
        self.satellites = 0 if message.satellites_visible == 255 else message.satellites_visible
        self.had_fix |= message.fix_type >= dialect.GPS_FIX_TYPE_3D_FIX
        self.had_accuracy |= message.h_acc > 0
        self.gps_accuracy_m = message.h_acc * 1e-3 or None
        return True

    @property
    def position_accuracy_m(self) -> float | None:
        """The estimator's; the receiver's where the estimator gives none; None: not known."""
        return self.gps_accuracy_m if self.accuracy_m is None else self.accuracy_m

    def fault(self, rules: EstimateRules, now: float) -> str:
        """What is wrong with the estimate, or ''. Before the first report nothing is known."""
        return self._estimator_fault(rules, now) or self._gps_fault(now)

    def _estimator_fault(self, rules: EstimateRules, now: float) -> str:
        if not math.isfinite(self.report_s):
            return ""
        if now - self.report_s > SILENT_S:
            return f"no {rules.message} for {SILENT_S:g} s"
        if self.flags & _ALL_NEEDED != _ALL_NEEDED:
            missing = (name for flag, name in _NEEDED.items() if not self.flags & flag)
            return f"the estimator has no {', '.join(missing)}"
        if self.flags & sum(rules.wrong):
            wrong = (name for flag, name in rules.wrong.items() if self.flags & flag)
            return f"the estimator says: {', '.join(wrong)}"
        most = rules.most_ratio
        for name, ratio in self.ratios.items():
            if ratio > most:
                limit = f"allowed: at most {most:g}"
                return f"the estimator's {name} differs from its sensors ({ratio:.2f}; {limit})"
        return ""

    def _gps_fault(self, now: float) -> str:
        if not self.had_fix:
            return ""
        if now - self.gps_s > SILENT_S:
            return f"no GPS_RAW_INT for {SILENT_S:g} s"
        if self.fix_type < dialect.GPS_FIX_TYPE_3D_FIX:
            return "the GPS has no 3D fix"
        if self.satellites < LEAST_SATELLITES:
            return f"{self.satellites} GPS satellites; allowed: {LEAST_SATELLITES} and more"
        if self.had_accuracy and self.position_accuracy_m is None:
            return "the GPS no longer says how accurate it is"
        return ""
