"""The dashboard over a picture that stands still, in this terminal: `python -m tests.system.still
ORDERS STEP`. Each order that it gives becomes a line of the file ORDERS."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

from swarm_ctl.commands.parse import Order
from swarm_ctl.core.model.targets import TargetPlan
from swarm_ctl.station.dashboard.app import Dashboard
from swarm_ctl.station.dashboard.driver import TtyDriver
from tests.unit.station.pictures import PICTURES


def main() -> None:
    """Until it is left with `q` and Enter."""
    orders, well = Path(sys.argv[1]), PICTURES["well"]()
    plan = replace(well.plan, targets=(TargetPlan("boat"),))
    view = replace(well, plan=plan, step=int(sys.argv[2]))

    def give(order: Order) -> None:
        with orders.open("a") as file:
            agents = ",".join(map(str, order.agents)) or "all"
            file.write(f"{order.text} @{agents}\n")

    app = Dashboard(view.plan, give, None, driver_class=TtyDriver)
    app.offer(view)
    app.run()


if __name__ == "__main__":
    main()
