"""What hatchling calls when it builds this package: it writes down the commit that is built."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path
from typing import Any, Final

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

_FILE: Final = "commit.txt"


class CommitHook(BuildHookInterface[Any]):
    """Puts `swarm_ctl/commit.txt` into wheel and sdist: of the checkout, or of the variable
    SWARM_CTL_COMMIT where there is no git (a container's build)."""

    PLUGIN_NAME = "custom"

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Called before each build; an unpacked sdist has the file already."""
        kept, written = Path(self.root, "swarm_ctl", _FILE), Path(self.directory, _FILE)
        if version == "editable":
            return
        if not kept.exists():
            commit = os.environ.get("SWARM_CTL_COMMIT") or _of_checkout(self.root)
            if not commit:
                return
            written.parent.mkdir(parents=True, exist_ok=True)
            written.write_text(commit)
            kept = written
        # the same way in both cases: so an sdist makes the same wheel as its checkout
        build_data["force_include"][str(kept)] = f"swarm_ctl/{_FILE}"

    def finalize(self, *_: Any) -> None:
        """The built archive has it."""
        Path(self.directory, _FILE).unlink(missing_ok=True)


def _of_checkout(root: str) -> str:
    if not Path(root, ".git").exists():
        return ""
    words = ["git", "-C", root, "describe", "--always", "--abbrev=40", "--exclude=*", "--dirty=+"]
    try:
        return subprocess.run(words, capture_output=True, text=True, check=False).stdout.strip()
    except FileNotFoundError:  # a machine without git builds a package that knows no commit
        return ""
