"""`--gcs`: where ground control software listens. The option may stand alone."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Final

from swarm_ctl.errors import InputError

ADDRESS: Final = re.compile(r"(?:(?P<host>[^:\s-][^:\s]*):)?(?P<port>\d+)")


def gcs_addresses(given: Sequence[str]) -> tuple[tuple[str, int], ...]:
    """Host and port of each `--gcs`; InputError where one is not an address."""
    return tuple(_address(text) for text in dict.fromkeys(given))


def _address(text: str) -> tuple[str, int]:
    found = ADDRESS.fullmatch(text)
    if found is None or not 1 <= int(found["port"]) <= 65535:
        raise InputError(f"--gcs {text!r}: not an address; allowed: PORT or HOST:PORT, 1..65535")
    return found["host"] or "127.0.0.1", int(found["port"])
