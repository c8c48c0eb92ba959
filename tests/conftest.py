"""Settings for all tests: hypothesis without deadlines (no timed tests), the same examples on every CI run."""

from __future__ import annotations

import os

from hypothesis import settings

settings.register_profile("here", deadline=None)
settings.register_profile("ci", deadline=None, derandomize=True)
settings.load_profile("ci" if os.environ.get("CI") else "here")

pytest_plugins = ["swarm_ctl.testing.plugin"]  # known to pytest already where the package is installed anew
