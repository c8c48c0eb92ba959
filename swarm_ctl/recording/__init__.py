"""What a run leaves for other people's tools: an MCAP file of everything on the mesh, and a `.tlog`
per vehicle."""

from swarm_ctl.recording.mcap_index import Tape
from swarm_ctl.recording.mcap_reader import RECORDING, Recorded, read, recover
from swarm_ctl.recording.mcap_writer import McapWriter
from swarm_ctl.recording.recorder import Recorder

__all__ = ["RECORDING", "McapWriter", "Recorded", "Recorder", "Tape", "read", "recover"]
