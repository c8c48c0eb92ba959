"""What a vehicle would do in trouble, in words, by its parameters. Pure.

Sources: ArduCopter/Parameters.cpp, AC_Fence.cpp and AP_BattMonitor_Params.cpp of ArduPilot 4.6;
commander_params.c and geofence_params.c of PX4 1.15.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Final

Values = Mapping[str, float]

_RTL_FIRST: Final = "returns to launch by its own path, else straight"
_COPTER_ACTIONS: Final = {
    0: "goes on",
    1: "returns to launch",
    2: "goes on in AUTO, else returns to launch",
    3: _RTL_FIRST,
    4: "returns to launch by its own path, else lands",
    5: "lands",
    6: "flies the landing sequence of its mission, else returns to launch",
    7: "brakes, else lands",
}
_BATTERY_ACTIONS: Final = {
    0: "only says so",
    1: "lands",
    2: "returns to launch",
    3: _RTL_FIRST,
    4: _COPTER_ACTIONS[4],
    5: "stops its motors",
    6: _COPTER_ACTIONS[6],
    7: _COPTER_ACTIONS[7],
}
_FENCE_ACTIONS: Final = {
    0: "only says so",
    1: "returns to launch, else lands",
    2: "lands",
    3: "returns to launch by its own path or straight, else lands",
    4: "brakes, else lands",
    5: _COPTER_ACTIONS[4],
}
_EKF_ACTIONS: Final = {
    0: "only says so",
    1: "lands",
    2: "holds its height and drifts (ALT_HOLD)",
    3: "lands, in every mode",
}
_GUIDED_GOES_ON: Final = 1 << 2
"""FS_OPTIONS: continue in GUIDED on the loss of RC."""
_PX4_ACTIONS: Final = {
    0: "goes on",
    1: "holds",
    2: "returns",
    3: "lands",
    5: "stops its motors (terminate)",
    6: "stops its motors (disarm)",
}
_OFFBOARD_ACTIONS: Final = {
    0: "goes to position mode, which needs a pilot",
    1: "goes to altitude mode, which needs a pilot",
    2: "goes to stabilized mode, which needs a pilot",
    3: "returns",
    4: "lands",
    5: "holds",
    6: "stops its motors (terminate)",
    7: "stops its motors (disarm)",
}
_LOW_BATTERY: Final = {
    0: "only says so",
    1: "returns",
    2: "lands",
    3: "returns, and lands when it is dangerously low",
}
_FENCE: Final = {
    0: "nothing",
    1: "only says so",
    2: "holds",
    3: "returns",
    4: "stops its motors (terminate)",
    5: "lands",
}
_OFFBOARD_GOES_ON: Final = 1 << 2
"""COM_RCL_EXCEPT: no failsafe in OFFBOARD on the loss of RC."""
_NO_RC: Final = 4
"""COM_RC_IN_MODE: stick input disabled."""
_BREAKERS: Final = {
    "CBRK_SUPPLY_CHK": (894281, "the power supply is not checked before arming"),
    "CBRK_USB_CHK": (197848, "it arms with a USB cable connected"),
    "CBRK_IO_SAFETY": (22027, "the safety switch does nothing"),
    "CBRK_FLIGHTTERM": (121212, "it does not stop its motors when it turns over or is told to"),
}

NAMES: Final[Mapping[str, tuple[str, ...]]] = {
    "ardupilot": (
        "GUID_TIMEOUT",
        "FS_GCS_ENABLE",
        "FS_GCS_TIMEOUT",
        "MAV_GCS_SYSID",
        "MAV_GCS_SYSID_HI",
        "SYSID_MYGCS",
        "FS_OPTIONS",
        "FS_THR_ENABLE",
        "BATT_MONITOR",
        "BATT_FS_LOW_ACT",
        "BATT_LOW_VOLT",
        "BATT_LOW_MAH",
        "BATT_FS_CRT_ACT",
        "BATT_CRT_VOLT",
        "BATT_CRT_MAH",
        "FENCE_ENABLE",
        "FENCE_ACTION",
        "FS_EKF_ACTION",
        "FS_EKF_THRESH",
        "FS_CRASH_CHECK",
    ),
    "px4": (
        "COM_OF_LOSS_T",
        "COM_OBL_RC_ACT",
        "NAV_RCL_ACT",
        "COM_RC_LOSS_T",
        "COM_RCL_EXCEPT",
        "COM_RC_IN_MODE",
        "NAV_DLL_ACT",
        "COM_DL_LOSS_T",
        "COM_LOW_BAT_ACT",
        "BAT_CRIT_THR",
        "GF_ACTION",
        "GF_MAX_HOR_DIST",
        "GF_MAX_VER_DIST",
        *_BREAKERS,
    ),
}
"""The parameters that the words come from. A vehicle need not have all of them."""


def failsafe_words(autopilot: str, values: Values) -> list[str]:
    """One sentence for each kind of trouble that the known parameters tell of."""
    return list({"ardupilot": _copter, "px4": _px4}[autopilot](values))


def _copter(values: Values) -> Iterator[str]:
    yield f"agent silent: {_copter_silent(values)}"
    if "FS_THR_ENABLE" in values:
        action = _say(_COPTER_ACTIONS, values, "FS_THR_ENABLE")
        if int(values.get("FS_OPTIONS", 0)) & _GUIDED_GOES_ON and values["FS_THR_ENABLE"]:
            action = f"goes on in GUIDED (FS_OPTIONS {values['FS_OPTIONS']:g})"
        yield f"RC lost: {action}"
    if values.get("BATT_MONITOR") == 0:
        yield "battery low: it is not measured (BATT_MONITOR 0)"
    else:
        yield from _copter_battery(values, "low", "LOW")
        yield from _copter_battery(values, "critical", "CRT")
    if values.get("FENCE_ENABLE") == 0:
        yield "fence: none (FENCE_ENABLE 0)"
    elif "FENCE_ACTION" in values:
        yield f"outside its fence: {_say(_FENCE_ACTIONS, values, 'FENCE_ACTION')}"
    if values.get("FS_EKF_THRESH") == 0:
        yield "position estimate bad: goes on (FS_EKF_THRESH 0)"
    elif "FS_EKF_ACTION" in values:
        yield f"position estimate bad: {_say(_EKF_ACTIONS, values, 'FS_EKF_ACTION')}"
    if "FS_CRASH_CHECK" in values:
        stops = "stops its motors" if values["FS_CRASH_CHECK"] else "goes on"
        yield f"crashed: {stops} (FS_CRASH_CHECK {values['FS_CRASH_CHECK']:g})"


def _copter_silent(values: Values) -> str:
    stops = "stops at some time"
    if "GUID_TIMEOUT" in values:
        stops = f"stops after {values['GUID_TIMEOUT']:g} s (GUID_TIMEOUT)"
    enable = values.get("FS_GCS_ENABLE")
    if enable is None:
        return f"{stops}; what follows is not known (no FS_GCS_ENABLE)"
    if enable == 0:
        return f"{stops} and hovers there until its battery is empty (FS_GCS_ENABLE 0)"
    first = values.get("MAV_GCS_SYSID", values.get("SYSID_MYGCS"))
    last = values.get("MAV_GCS_SYSID_HI", 0.0)
    named = "a ground station" if first is None else f"id {first:g}"
    if first is not None and last > first:
        named = f"ids {first:g} to {last:g}"
    wait = values.get("FS_GCS_TIMEOUT", 5.0)  # a constant before 4.2
    action = _COPTER_ACTIONS.get(int(enable), "does what this program does not know")
    known = f", FS_GCS_TIMEOUT {wait:g}" if "FS_GCS_TIMEOUT" in values else ""
    return (
        f"{stops}, {action} after {wait:g} s without heartbeats of {named}"
        f" (FS_GCS_ENABLE {enable:g}{known})"
    )


def _copter_battery(values: Values, kind: str, short: str) -> Iterator[str]:
    name = f"BATT_FS_{short}_ACT"
    if name not in values:
        return
    volts, charge = values.get(f"BATT_{short}_VOLT", 0.0), values.get(f"BATT_{short}_MAH", 0.0)
    limits = [f"under {volts:g} V"] * (volts > 0) + [f"with {charge:g} mAh left"] * (charge > 0)
    if limits:
        action = _say(_BATTERY_ACTIONS, values, name)
        yield f"battery {kind} ({' or '.join(limits)}): {action}"
    else:
        yield f"battery {kind}: never (BATT_{short}_VOLT 0, BATT_{short}_MAH 0)"


def _px4(values: Values) -> Iterator[str]:
    if "COM_OBL_RC_ACT" in values:
        action = _say(_OFFBOARD_ACTIONS, values, "COM_OBL_RC_ACT")
        wait = f"{values['COM_OF_LOSS_T']:g} s" if "COM_OF_LOSS_T" in values else "some time"
        yield f"agent silent: leaves OFFBOARD after {wait} (COM_OF_LOSS_T) and {action}"
    if values.get("COM_RC_IN_MODE") == _NO_RC:
        yield f"RC lost: it has none (COM_RC_IN_MODE {_NO_RC})"
    elif int(values.get("COM_RCL_EXCEPT", 0)) & _OFFBOARD_GOES_ON:
        yield f"RC lost: goes on in OFFBOARD (COM_RCL_EXCEPT {values['COM_RCL_EXCEPT']:g})"
    elif "NAV_RCL_ACT" in values:
        after = _after(values, "COM_RC_LOSS_T")
        yield f"RC lost{after}: {_say(_PX4_ACTIONS, values, 'NAV_RCL_ACT')}"
    if "NAV_DLL_ACT" in values:
        after = _after(values, "COM_DL_LOSS_T")
        yield f"ground station lost{after}: {_say(_PX4_ACTIONS, values, 'NAV_DLL_ACT')}"
    if "COM_LOW_BAT_ACT" in values:
        limit = values.get("BAT_CRIT_THR")
        under = f" (under {100 * limit:g} %)" if limit is not None else ""
        yield f"battery critical{under}: {_say(_LOW_BATTERY, values, 'COM_LOW_BAT_ACT')}"
    if "GF_ACTION" in values:
        radius, height = values.get("GF_MAX_HOR_DIST", 0.0), values.get("GF_MAX_VER_DIST", 0.0)
        limits = [f"{radius:g} m away"] * (radius > 0) + [f"{height:g} m high"] * (height > 0)
        where = f" (farther than {' or '.join(limits)})" if limits else ""
        yield f"outside its fence{where}: {_say(_FENCE, values, 'GF_ACTION')}"
    for name, (key, effect) in _BREAKERS.items():
        if values.get(name) == key:
            yield f"circuit breaker: {effect} ({name} {key})"


def _after(values: Values, name: str) -> str:
    return f" for {values[name]:g} s" if name in values else ""


def _say(actions: Mapping[int, str], values: Values, name: str) -> str:
    value = values[name]
    return f"{actions.get(int(value), 'does what this program does not know')} ({name} {value:g})"
