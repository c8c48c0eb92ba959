"""The recording of a run: one MCAP file with all messages on the mesh, for any tool."""

from swarm_ctl.recording.mcap_reader import RECORDING, IndexedRecording, read, recover

__all__ = ["RECORDING", "IndexedRecording", "read", "recover"]
