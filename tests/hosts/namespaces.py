"""Hosts of a swarm as network namespaces of this machine, and the bad network between them
(`relay.py`).

Each namespace lives as long as a process that waits in it for the end of its stdin: whatever
becomes of the tests, SIGKILL included, the kernel takes namespaces, addresses and veth pairs back.
Nothing is made in this machine's own.
"""

from __future__ import annotations

import functools
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import asdict
from pathlib import Path
from typing import Any, Self

from tests.hosts.relay import Air, Count

_WAIT_S = 10


@functools.cache
def why_not() -> str:
    """Why there are no namespaces here; '' where there are."""
    if not hasattr(os, "geteuid") or os.geteuid() != 0:
        return "network namespaces need root"
    try:
        with Network(2) as network:
            network.air(Air())
    except (OSError, RuntimeError, subprocess.SubprocessError) as error:
        return f"no network namespaces here: {error}"
    return ""


class Namespace:
    """One network namespace, with its loopback up."""

    def __init__(self) -> None:
        self._holder = subprocess.Popen(
            [
                "/usr/bin/env",
                "unshare",
                "--net",
                "sh",
                "-c",
                "ip link set lo up && echo ready && exec cat",
            ],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
        )
        assert self._holder.stdout is not None
        if self._holder.stdout.readline() != b"ready\n":
            raise RuntimeError(
                self._holder.communicate()[1].decode().strip() or "unshare --net failed"
            )

    @property
    def pid(self) -> int:
        """Of a process inside."""
        return self._holder.pid

    def inside(self, command: Sequence[str | Path]) -> list[str]:
        """The command line that runs `command` inside; the process keeps its id."""
        return ["nsenter", f"--net=/proc/{self.pid}/ns/net", "--", *map(str, command)]

    def run(self, command: str) -> None:
        """Run a command of words inside to its end; RuntimeError says what it said."""
        done = subprocess.run(
            self.inside(command.split()),
            capture_output=True,
            text=True,
            timeout=_WAIT_S,
            check=False,
        )
        if done.returncode:
            raise RuntimeError(f"{command}: {done.stderr.strip()}")

    def close(self) -> None:
        """Let it go; it is gone with the last process inside."""
        self._holder.communicate(timeout=_WAIT_S)


class Network:
    """`sides` hosts that meet over the relay alone, at `address(side)`; and a place in the middle
    for their vehicles.

    Each host has a link of its own to the middle that nothing disturbs: `middle_address(side)` is
    its far end.
    """

    def __init__(self, sides: int) -> None:
        self._open = ExitStack()
        try:
            self.middle = self._namespace()
            self.sides = [self._namespace() for _ in range(sides)]
            for side, namespace in enumerate(self.sides):
                self._join(namespace, "mesh0", f"{self.address(side)}/24", f"air{side}", "")
                there = self.middle_address(side)
                self._join(
                    namespace, "vehicles0", f"{there[:-1]}2/24", f"vehicles{side}", f"{there}/24"
                )
            self._errors = tempfile.TemporaryFile()  # noqa: SIM115 - open as long as this
            self._open.callback(self._errors.close)
            self._relay = subprocess.Popen(
                self.middle.inside(
                    [
                        sys.executable,
                        "-m",
                        "tests.hosts.relay",
                        *(f"air{side}" for side in range(sides)),
                    ]
                ),
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=self._errors,
                cwd=Path(__file__).parents[2],
            )
            self._open.callback(self._relay.communicate, timeout=_WAIT_S)
            self.air(Air())
        except BaseException:
            self._open.close()
            raise

    def _namespace(self) -> Namespace:
        namespace = Namespace()
        self._open.callback(namespace.close)
        return namespace

    def _join(
        self, side: Namespace, here: str, address: str, there: str, other_address: str
    ) -> None:
        """A veth pair between a side and the middle."""
        side.run(f"ip link add {here} type veth peer name {there} netns {self.middle.pid}")
        side.run(f"ip address add {address} dev {here}")
        side.run(f"ip link set {here} up")
        if other_address:
            self.middle.run(f"ip address add {other_address} dev {there}")
        self.middle.run(f"ip link set {there} up")

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Take everything down."""
        self._open.close()

    @staticmethod
    def address(side: int) -> str:
        """Where a side is found by the others."""
        return f"10.77.0.{side + 1}"

    def move(self, side: int, address: str) -> None:
        """A side gets another address on the mesh, as of DHCP or behind a NAT, and loses the
        old one."""
        self.sides[side].run(f"ip address del {self.address(side)}/24 dev mesh0")
        self.sides[side].run(f"ip address add {address}/24 dev mesh0")

    @staticmethod
    def middle_address(side: int) -> str:
        """Where a side finds what runs in the middle."""
        return f"10.78.{side}.1"

    def air(self, air: Air) -> Count:
        """So is the air between the sides from now on; what has passed until now."""
        assert self._relay.stdin is not None
        assert self._relay.stdout is not None
        try:
            self._relay.stdin.write(json.dumps(asdict(air)).encode() + b"\n")
            self._relay.stdin.flush()
        except OSError:
            pass  # it has ended: the answer will not come
        answer = self._relay.stdout.readline()
        if not answer:
            self._errors.seek(0)
            raise RuntimeError(f"the relay has ended: {self._errors.read().decode().strip()}")
        found: dict[str, Any] = json.loads(answer)
        return Count(**found)
