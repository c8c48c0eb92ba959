"""Stands in for podman where only the life of containers matters: its one image is `copter`; a
container is a process that outlives the client which started it, until it is killed by name.

A file with the container's name, beside the engine, has the pid.
"""

from __future__ import annotations

import argparse
import os
import signal
import subprocess
import sys
from pathlib import Path

HERE = Path(sys.argv[1])


def run(arguments: list[str]) -> int:
    parser = argparse.ArgumentParser()
    for flag in ("rm", "init"):
        parser.add_argument(f"--{flag}", action="store_true", required=True)
    for name in ("name", "entrypoint", "workdir", "mount"):
        parser.add_argument(f"--{name}", required=True)
    for name, allowed in (("network", "host"), ("pull", "never"), ("user", "0:0")):
        parser.add_argument(f"--{name}", choices=[allowed], required=True)
    parser.add_argument("--security-opt")
    parser.add_argument("image", choices=["copter"])
    given, rest = parser.parse_known_args(arguments)
    assert given.mount == f"type=bind,source={given.workdir},target={given.workdir}"
    program = subprocess.Popen([given.entrypoint, *rest], cwd=given.workdir, start_new_session=True)
    (HERE / given.name).write_text(str(program.pid))
    signal.signal(signal.SIGINT, lambda *_: program.send_signal(signal.SIGINT))
    return program.wait()


def main(verb: str, *rest: str) -> int:
    if verb == "run":
        return run(list(rest))
    if verb == "image" and rest != ("inspect", "copter"):
        print(f"Error: {rest[-1]}: image not known", file=sys.stderr)
        return 125
    if verb == "kill":
        os.kill(int((HERE / rest[0]).read_text()), signal.SIGKILL)
    if verb == "rm":
        (HERE / rest[-1]).unlink()
    return 0


sys.exit(main(*sys.argv[2:]))
