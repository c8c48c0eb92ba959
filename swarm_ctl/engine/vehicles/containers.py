"""ArduCopter in a container: the engine that runs it, its command line, how it ends.

A container is no child of ours: it outlives the engine's client. So each has a lifeline: a shell in
a session of its own that kills the container, by name, once the process that holds it closes its
stdin, or dies.
"""

from __future__ import annotations

import contextlib
import os
import secrets
import shutil
import subprocess
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from swarm_ctl.errors import StartError

PREFIX: Final = "container:"
ENGINE_VARIABLE: Final = "SWARM_CTL_CONTAINER_ENGINE"
ENGINES: Final = ("podman", "docker")
_LIFELINE: Final = 'cat; "$0" kill "$1"; "$0" rm -f "$1"'
_ASKED_WALL_S: Final = 20.0
"""For an answer of the engine; podman's takes a tenth of a second."""


@dataclass(frozen=True, slots=True)
class Image:
    """A container image with `arducopter` on its PATH."""

    engine: str
    """The program that runs it."""
    name: str

    def __str__(self) -> str:
        return f"{PREFIX}{self.name}, run by {self.engine}"


def find_image(said: str) -> Image:
    """The image that `container:IMAGE` names, which the engine has; StartError otherwise."""
    name = said.removeprefix(PREFIX)
    chosen = os.environ.get(ENGINE_VARIABLE)
    found = [path for each in ([chosen] if chosen else ENGINES) if (path := shutil.which(each))]
    if not found:
        missing = f"no program {chosen} ({ENGINE_VARIABLE})" if chosen else "no podman, no docker"
        raise StartError(f"{missing}; allowed: one of them on the PATH, or in {ENGINE_VARIABLE}")
    image = Image(found[0], name)
    if trouble := _trouble(image):
        raise StartError(
            f"{image.engine} can't run the image '{name}': {trouble}; allowed: an image of"
            f" `{image.engine} images` (`{image.engine} pull` gets one); {ENGINE_VARIABLE} names"
            " another engine"
        )
    return image


def _trouble(image: Image) -> str:
    """The engine's last words about an image that it can't run; '' where it can."""
    command = [image.engine, "image", "inspect", image.name]
    try:
        asked = subprocess.run(command, capture_output=True, check=False, timeout=_ASKED_WALL_S)
    except (OSError, subprocess.TimeoutExpired) as error:
        return str(error)
    if asked.returncode == 0:
        return ""
    words = asked.stderr.decode(errors="replace").strip().splitlines()
    return words[-1] if words else f"exit code {asked.returncode}"


class Container:
    """One container, which ends with the process that made this."""

    def __init__(self, image: Image) -> None:
        self._image = image
        self.name = f"swarm-ctl-{secrets.token_hex(6)}"
        self._lifeline = subprocess.Popen(
            ["/bin/sh", "-c", _LIFELINE, image.engine, self.name],
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,  # the container has mostly ended by itself
            start_new_session=True,
        )

    def command(self, program: str, folder: Path) -> list[str]:
        """The command line that runs `program` in it, to which its arguments are to be added.

        It has the host's network, and of the host's files `folder`, where it works, as our user.
        """
        podman = Path(self._image.engine).name == "podman"
        # For podman without root, the container's root is our user.
        user = "0:0" if podman else f"{os.getuid()}:{os.getgid()}"
        # fmt: off
        return [
            self._image.engine, "run", "--rm", "--init", "--pull", "never", "--name", self.name,
            "--network", "host", "--user", user, "--security-opt", "label=disable",
            "--mount", f"type=bind,source={folder},target={folder}", "--workdir", str(folder),
            "--entrypoint", program, self._image.name,
        ]
        # fmt: on

    def end(self) -> None:
        """Kill it, if it still runs, and wait until it has gone."""
        if self._lifeline.stdin is not None:
            self._lifeline.stdin.close()
        with contextlib.suppress(subprocess.TimeoutExpired):  # the lifeline goes on trying
            self._lifeline.wait(_ASKED_WALL_S)
