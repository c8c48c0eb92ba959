"""A ground station on a swarm's mesh, from its opening to its end: its node, its record, its
extensions, its screen."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import ExitStack, closing
from typing import Self

from swarm_ctl.engine.station.attachments import Attachments
from swarm_ctl.engine.station.ground_station import Station
from swarm_ctl.engine.station.recorders import LiveRecorder
from swarm_ctl.engine.station.screens import Show, present
from swarm_ctl.engine.station.station_loop import Control, loop
from swarm_ctl.engine.station.swarm_mesh import SwarmMesh
from swarm_ctl.engine.vehicle_memory import SwarmMemory
from swarm_ctl.recording.run_recorder import RunRecorder
from swarm_ctl.station.picture.protection import protection


class StationSession:
    """Open from now on; use it in a `with`.

    Args:
        mesh: where the swarm is, and as whom this station joins it.
        attach: extensions, each `NAME[=ARGUMENT]`.
        memory: gets what the agents say of their vehicles' own parameters.

    Raises:
        InputError, StartError: an extension can't be attached.
    """

    def __init__(
        self, mesh: SwarmMesh, attach: Sequence[str] = (), memory: SwarmMemory | None = None
    ) -> None:
        seen = protection(mesh.identity, mesh.fleet.signing, is_open=mesh.is_open)
        with ExitStack() as opened:
            node = opened.enter_context(closing(mesh.open_node()))
            self.station = Station(mesh.plan, node, mesh.clock, memory=memory, protection=seen)
            self.attached = opened.enter_context(Attachments(attach, self.station))
            self._opened = opened.pop_all()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._opened.close()

    def record(self, recorder: RunRecorder | LiveRecorder) -> None:
        """From now on, until the session ends."""
        self.station.record(self._opened.enter_context(closing(recorder)))

    def record_nothing(self, start_s: float) -> None:
        """Messages go to the extensions that want them, alone. `start_s`: about the Unix time of
        mission time 0."""
        if self.attached.sinks:
            station, start_ns = self.station, round(start_s * 1e9)
            self.record(LiveRecorder(self.attached.sinks, station.plan, start_ns, station.name))

    def show(
        self, show: Show, control: Control, interrupt: Callable[[], None] | None = None
    ) -> None:
        """Work with this screen until `control` ends it; `interrupt`: as `screens.present`."""
        present(
            show,
            self.station.plan,
            interrupt,
            lambda screen: loop(self.station, screen, control, self.attached),
        )
