"""The swarm as a node of ROS 2, in the form of rmw_zenoh: no ROS and no bridge is needed here."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from swarm_ctl.errors import InputError

_LAST: Final = 232


def domain_of(text: str, environment: Mapping[str, str]) -> int:
    """The domain that a text names, or where it is empty `ROS_DOMAIN_ID`, or 0; InputError where
    that is none."""
    told = text or environment.get("ROS_DOMAIN_ID") or "0"
    if not (told.isascii() and told.isdecimal() and int(told) <= _LAST):
        where = f"ros2={text}" if text else f"ROS_DOMAIN_ID={told}"
        raise InputError(f"{where}: is no domain of ROS 2; allowed: 0 to {_LAST}")
    return int(told)
