"""Two swarms in the air at once, in one folder: an order reaches the one that it names, and the
agents that it names."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from swarm_ctl.engine.station.run_client import RunClient
from swarm_ctl.errors import InputError
from tests.system.conftest import Typed
from tests.system.running import HELD, Running

pytestmark = [pytest.mark.lockstep, pytest.mark.timeout(300)]
QUICK = ("--lockstep", "--speedup", "3", "--headless", "--no-report")


def test_an_order_reaches_the_agents_that_it_means_alone(tmp_path: Path, typed: Typed) -> None:
    """Which swarm has to be said, in the shell and in Python; what the others do is answered at
    once, and done."""

    def called(*words: str) -> tuple[int, str]:
        code, said, errors = typed(*words)
        return code, (said + errors).strip()

    text = HELD.read_text().replace("name: held", "name: low")
    (tmp_path / "low.yaml").write_text(text)
    duo = "\n".join(line for line in text.splitlines() if "id: " not in line or line < "  - {id: 3")
    (tmp_path / "duo.yaml").write_text(duo.replace("name: low", "name: duo"))
    with (
        Running("run", "low.yaml", *QUICK, cwd=tmp_path) as low,
        Running("run", "duo.yaml", *QUICK, cwd=tmp_path) as other,
    ):
        low.wait_for(lambda: "step 3/4: hold" in low.output)
        other.wait_for(lambda: "step 3/4: hold" in other.output)
        (low_run,) = (path.relative_to(tmp_path) for path in (tmp_path / "runs").glob("*-low"))
        (duo_run,) = (path.relative_to(tmp_path) for path in (tmp_path / "runs").glob("*-duo"))
        listed = [f"low ({low_run})", f"duo ({duo_run})"]
        for words in (("send", "hold"), ("station", "--headless")):
            code, said = called(*words)
            assert code == 2
            assert said.startswith("error: 2 swarms are in the air: ")
            assert all(each in said for each in listed)
        with pytest.raises(InputError, match="2 swarms are in the air"):
            RunClient()
        assert called("send", "land", "--agents", "3", "--run", "low") == (
            0,
            (
                f"land, low ({low_run}):\n"
                "agent 3: landing; agents 1-2 go on without it (policies.left_by_order)"
            ),
        )
        low.wait_for(lambda: "agent 3: land -> ended" in low.output)
        ended = f"next, low ({low_run}):\nagents 1-2: accepted"
        assert called("send", "next", "--run", str(low_run)) == (0, ended)
        assert low.wait() == 0, low.output
        summary = json.loads((tmp_path / low_run / "summary.json").read_text())
        assert [(left["agent"], left["order"]) for left in summary["left"]] == [(3, "land")]
        assert "without agent 3 (land at " in " ".join(low.output.split())
        assert "command" not in other.output
        # the only one that flies need not be named
        assert called("send", "land") == (0, f"land, duo ({duo_run}):\nagents 1-2: accepted")
        assert other.wait() == 1, other.output
        low.assert_nothing_left()
        other.assert_nothing_left()
