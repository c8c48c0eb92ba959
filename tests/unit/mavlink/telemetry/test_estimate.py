"""The vehicle's own word of its estimate: what of EKF_STATUS_REPORT, ESTIMATOR_STATUS and
GPS_RAW_INT is a fault, and how accurate the position is."""

from __future__ import annotations

import math
from typing import Any

import pytest

from swarm_ctl.mavlink.telemetry.estimate import EKF_RULES, ESTIMATOR_RULES, SILENT_S, EstimateRules
from swarm_ctl.mavlink.telemetry.incoming import fold
from swarm_ctl.mavlink.telemetry.vehicle_telemetry import Telemetry
from tests.unit.mavlink import wire

GLITCHING = 33599
"""What a real ArduCopter says 1.5 s after its GPS has jumped 4 m."""


def heard(*messages: Any, now: float = 0.0) -> Telemetry:
    telemetry = Telemetry()
    for message in messages:
        fold(telemetry, message, now)
    return telemetry


ROWS: list[tuple[str, EstimateRules, list[Any], str]] = [
    ("ArduCopter in the air", EKF_RULES, [wire.ekf_report()], ""),
    ("PX4 in the air", ESTIMATOR_RULES, [wire.estimator_status()], ""),
    ("PX4 on the ground", ESTIMATOR_RULES, [wire.estimator_status(1023)], ""),
    ("its GPS jumped", EKF_RULES, [wire.ekf_report(pos_horiz=1.18)], "horizontal position differs"),
    ("at the limit", EKF_RULES, [wire.ekf_report(pos_horiz=0.8)], ""),
    ("a glitch", EKF_RULES, [wire.ekf_report(GLITCHING)], "the estimator says: GPS glitch"),
    (
        "compass",
        EKF_RULES,
        [wire.ekf_report(compass=0.9)],
        "compass differs from its sensors (0.90",
    ),
    ("no velocity", EKF_RULES, [wire.ekf_report(831 & ~2)], "has no horizontal velocity"),
    (
        "no position",
        ESTIMATOR_RULES,
        [wire.estimator_status(101)],
        "has no horizontal velocity, hor",
    ),
    ("a PX4's glitch", ESTIMATOR_RULES, [wire.estimator_status(895 | 1024)], "says: GPS glitch"),
    ("PX4's ratio", ESTIMATOR_RULES, [wire.estimator_status(vel=1.1)], "velocity differs"),
    ("not measured", ESTIMATOR_RULES, [wire.estimator_status(mag=math.nan)], ""),
    ("no GPS at all", EKF_RULES, [wire.ekf_report(), wire.gps_raw(0, 0)], ""),
    ("a fix", EKF_RULES, [wire.gps_raw(3, 6)], ""),
    ("the fix is lost", EKF_RULES, [wire.gps_raw(), wire.gps_raw(1, 9)], "the GPS has no 3D fix"),
    ("few satellites", EKF_RULES, [wire.gps_raw(3, 5)], "5 GPS satellites; allowed: 6 and more"),
    ("unknown satellites", EKF_RULES, [wire.gps_raw(3, 255)], "0 GPS satellites"),
]


@pytest.mark.parametrize(("what", "rules", "messages", "fault"), ROWS, ids=[r[0] for r in ROWS])
def test_what_is_a_fault(what: str, rules: EstimateRules, messages: list[Any], fault: str) -> None:
    found = heard(*messages).estimate.fault(rules, 0.0)
    assert fault in found if fault else found == ""


@pytest.mark.parametrize(
    ("message", "silent"),
    [
        (wire.ekf_report(), "no EKF_STATUS_REPORT for 3 s"),
        (wire.gps_raw(), "no GPS_RAW_INT for 3 s"),
    ],
)
def test_reports_that_stop_are_a_fault_and_reports_never_heard_are_none(
    message: Any, silent: str
) -> None:
    assert Telemetry().estimate.fault(EKF_RULES, 1e6) == ""
    estimate = heard(message).estimate
    assert estimate.fault(EKF_RULES, SILENT_S) == ""
    assert estimate.fault(EKF_RULES, SILENT_S + 0.1) == silent


def test_the_accuracy_is_the_estimator_s_and_the_receiver_s_where_it_gives_none() -> None:
    receiver = wire.gps_raw(h_acc_mm=300)
    assert heard().estimate.position_accuracy_m is None
    assert heard(wire.ekf_report(), receiver).estimate.position_accuracy_m == pytest.approx(0.3)
    px4 = heard(wire.estimator_status(accuracy_m=2.5), receiver)
    assert px4.estimate.position_accuracy_m == 2.5
    assert heard(wire.gps_raw(h_acc_mm=0)).estimate.position_accuracy_m is None


def test_an_accuracy_that_is_no_longer_told_is_not_taken_for_good() -> None:
    messages = (wire.gps_raw(), wire.gps_raw(h_acc_mm=0))
    estimate = heard(*messages).estimate
    assert estimate.position_accuracy_m is None
    assert estimate.fault(EKF_RULES, 0.0) == "the GPS no longer says how accurate it is"
    assert heard(*messages, wire.estimator_status()).estimate.fault(ESTIMATOR_RULES, 0.0) == ""


@pytest.mark.parametrize(
    ("message", "rules", "words"),
    [
        (wire.ekf_report(velocity=math.nan), EKF_RULES, "velocity differs from its sensors (inf"),
        (wire.ekf_report(compass=-1.0), EKF_RULES, "compass differs from its sensors (inf"),
        (wire.estimator_status(vel=math.inf), ESTIMATOR_RULES, "velocity differs"),
    ],
)
def test_a_ratio_that_cannot_be_true_is_a_fault_and_costs_no_flag(
    message: Any, rules: EstimateRules, words: str
) -> None:
    """The whole report was refused, and said to be missing."""
    telemetry = Telemetry()
    assert fold(telemetry, message, 5.0)
    assert telemetry.estimate.report_s == 5.0
    assert telemetry.estimate.flags == message.flags
    assert words in telemetry.estimate.fault(rules, 5.0)


def test_a_restart_forgets_the_reports() -> None:
    telemetry = heard(wire.local_position(boot_ms=60_000), wire.ekf_report(), wire.gps_raw())
    fold(telemetry, wire.local_position(boot_ms=100), 1.0)
    assert telemetry.estimate.report_s == -math.inf
    assert telemetry.estimate.position_accuracy_m is None
