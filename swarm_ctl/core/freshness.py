"""How old news may be, and what is done with it then. Ages in seconds of mission time.

| age of a peer's state | what is done | why this number |
|---|---|---|
| up to `FRESH_S` 0.5 | used, its stop point carried on with its command for at most `PREDICT_S` 0.3 | ten lost states in a row at 20 Hz; beyond 0.3 s a command says little about the next one |
| up to `NEIGHBOUR_S` 1.0 | still used as it is | one re-connection of a mesh link |
| older | leaves N_i (the law no longer follows it), but stays in the avoidance region where it was last heard, or where the own autopilot's traffic sees it | the graph may be cut: reported |
| `policies.agent_lost_after_s` (5) | lost: the mission's policy | long enough for a link to reconnect twice; since 1 s nobody follows it, and its own autopilot has stopped it |

| age of the own vehicle's position | what is done | why |
|---|---|---|
| `OWN_FIX_S` 0.5 | zero velocity is commanded, the own state is no longer published | a state that is not news must not look like news |
| `OWN_LOST_S` 5.0 | give up: land | MAVProxy and Skybrush call a vehicle lost after 4 to 5 s, MAVSDK after 3; zero velocity was commanded since 0.5 s, so patience costs nothing |
"""  # noqa: E501

from __future__ import annotations

from typing import Final

FRESH_S: Final = 0.5
PREDICT_S: Final = 0.3
NEIGHBOUR_S: Final = 1.0
SETPOINT_TIMEOUT_S: Final = {"ardupilot": 0.5, "px4": 1.0}
"""What an agent sets before it arms (GUID_TIMEOUT, COM_OF_LOSS_T): a vehicle whose agent is silent flies its last
command for so long, blindly. In 1,600 missions with a dying agent one vehicle was hit with 1 s, none with 0.5 s. An
ArduCopter then stands still and goes on with the next setpoint; a PX4 leaves OFFBOARD for good, so it waits longer."""
SILENT_FLIES_S: Final = 1.0
"""For so long the others reckon with it: the longest of these, as they don't know what the silent one flies."""
OWN_FIX_S: Final = 0.5
OWN_LOST_S: Final = 5.0
