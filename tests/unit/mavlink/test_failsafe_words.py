"""What parameters mean, in words: each sentence names the parameters that it comes from."""

from __future__ import annotations

import pytest

from swarm_ctl.mavlink.autopilots.failsafe_words import NAMES, failsafe_words

COPTER = {
    "GUID_TIMEOUT": 0.5,
    "FS_GCS_ENABLE": 5.0,
    "FS_GCS_TIMEOUT": 5.0,
    "MAV_GCS_SYSID": 250.0,
    "FS_OPTIONS": 16.0,
    "FS_THR_ENABLE": 1.0,
    "BATT_MONITOR": 4.0,
    "BATT_FS_LOW_ACT": 2.0,
    "BATT_LOW_VOLT": 10.5,
    "BATT_LOW_MAH": 0.0,
    "FENCE_ENABLE": 1.0,
    "FENCE_ACTION": 4.0,
    "FS_EKF_ACTION": 1.0,
    "FS_EKF_THRESH": 0.8,
    "FS_CRASH_CHECK": 1.0,
}
PX4 = {
    "COM_OF_LOSS_T": 1.0,
    "COM_OBL_RC_ACT": 4.0,
    "NAV_RCL_ACT": 2.0,
    "COM_RC_LOSS_T": 0.5,
    "NAV_DLL_ACT": 0.0,
    "COM_DL_LOSS_T": 10.0,
    "COM_LOW_BAT_ACT": 3.0,
    "BAT_CRIT_THR": 0.07,
    "GF_ACTION": 2.0,
    "GF_MAX_HOR_DIST": 100.0,
    "CBRK_SUPPLY_CHK": 894281.0,
    "CBRK_USB_CHK": 0.0,
}
ROWS = [
    ("ardupilot", {}, ("agent silent: stops after 0.5 s (GUID_TIMEOUT), lands after 5 s without"
     " heartbeats of id 250 (FS_GCS_ENABLE 5, FS_GCS_TIMEOUT 5)")),
    ("ardupilot", {"FS_GCS_ENABLE": 0.0}, ("agent silent: stops after 0.5 s (GUID_TIMEOUT) and"
     " hovers there until its battery is empty (FS_GCS_ENABLE 0)")),
    ("ardupilot", {"MAV_GCS_SYSID_HI": 254.0}, "without heartbeats of ids 250 to 254"),
    ("ardupilot", {}, "RC lost: returns to launch (FS_THR_ENABLE 1)"),
    ("ardupilot", {"FS_OPTIONS": 20.0}, "RC lost: goes on in GUIDED (FS_OPTIONS 20)"),
    ("ardupilot", {}, "battery low (under 10.5 V): returns to launch (BATT_FS_LOW_ACT 2)"),
    ("ardupilot", {"BATT_LOW_VOLT": 0.0}, "battery low: never (BATT_LOW_VOLT 0, BATT_LOW_MAH 0)"),
    ("ardupilot", {"BATT_MONITOR": 0.0}, "battery low: it is not measured (BATT_MONITOR 0)"),
    ("ardupilot", {}, "outside its fence: brakes, else lands (FENCE_ACTION 4)"),
    ("ardupilot", {"FENCE_ENABLE": 0.0}, "fence: none (FENCE_ENABLE 0)"),
    ("ardupilot", {}, "position estimate bad: lands (FS_EKF_ACTION 1)"),
    ("ardupilot", {"FS_EKF_THRESH": 0.0}, "position estimate bad: goes on (FS_EKF_THRESH 0)"),
    ("ardupilot", {"FS_EKF_ACTION": 9.0},
     "position estimate bad: does what this program does not know (FS_EKF_ACTION 9)"),
    ("px4", {}, ("agent silent: leaves OFFBOARD after 1 s (COM_OF_LOSS_T) and lands"
     " (COM_OBL_RC_ACT 4)")),
    ("px4", {"COM_OBL_RC_ACT": 0.0}, "goes to position mode, which needs a pilot"),
    ("px4", {}, "RC lost for 0.5 s: returns (NAV_RCL_ACT 2)"),
    ("px4", {"COM_RCL_EXCEPT": 4.0}, "RC lost: goes on in OFFBOARD (COM_RCL_EXCEPT 4)"),
    ("px4", {"COM_RC_IN_MODE": 4.0}, "RC lost: it has none (COM_RC_IN_MODE 4)"),
    ("px4", {}, "ground station lost for 10 s: goes on (NAV_DLL_ACT 0)"),
    ("px4", {}, "battery critical (under 7 %): returns, and lands when it is dangerously low"),
    ("px4", {}, "outside its fence (farther than 100 m away): holds (GF_ACTION 2)"),
    ("px4", {}, "circuit breaker: the power supply is not checked before arming"),
]  # fmt: skip


@pytest.mark.parametrize(("autopilot", "changed", "told"), ROWS)
def test_what_a_vehicle_would_do(autopilot: str, changed: dict[str, float], told: str) -> None:
    values = {"ardupilot": COPTER, "px4": PX4}[autopilot] | changed
    assert told in "\n".join(failsafe_words(autopilot, values))


@pytest.mark.parametrize("autopilot", NAMES)
def test_parameters_that_are_not_known_are_not_guessed(autopilot: str) -> None:
    """A vehicle that has told nothing: at most the sentence that nothing is known."""
    words = failsafe_words(autopilot, {})
    assert all("not known" in text or "never" in text for text in words), words


def test_every_breaker_is_asked_for_and_an_open_one_is_not_told() -> None:
    assert "CBRK_FLIGHTTERM" in NAMES["px4"]
    assert "USB" not in "\n".join(failsafe_words("px4", PX4))
