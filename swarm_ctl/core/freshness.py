"""How old news may be, and what is done with it then. Ages in seconds of mission time.

| age of a peer's state | what is done | why this number |
|---|---|---|
| up to `FRESH_S` 0.5 | used, its stop point carried on with its command for at most `PREDICT_S` 0.3, by the law for at most `lead_s` | ten lost states in a row at 20 Hz; beyond 0.3 s a command says little about the next one |
| up to `NEIGHBOUR_S` 1.0 | still used as it is | one re-connection of a mesh link |
| older | leaves N_i (the law no longer follows it), but stays in the avoidance region where it was last heard, or where the own autopilot's traffic sees it | the graph may be cut: reported |
| `policies.agent_lost_after_s` (5) | lost: the mission's policy | long enough for a link to reconnect twice; since 1 s nobody follows it, and its own autopilot has stopped it |

| own mesh lost | what is done | why |
|---|---|---|
| after 0.5, 1.0 s | as above, for every peer at once: nobody is followed, everybody is kept clear of where he was heard last and where the own traffic receiver sees him | each agent has only ages to go by: it cannot tell its own radio from theirs |
| `agent_lost_after_s` (5), `station_lost_after_s` (5) | the policies; `hold_before_land_s` (3) of standing still, then down in place | the others come to the same after the same time: both sides of a cut hold, then land, where they stand |
| on the way back (`return`), nobody heard for `agent_lost_after_s` | land in place | without news there is no order to cross each other's ways in |
| on the ground: `watch._PATIENCE_S` 30, before the first step | the mission ends | nobody arms without the others, so waiting costs only time |

| age of the own vehicle's position | what is done | why |
|---|---|---|
| `OWN_FIX_S` 0.5 | zero velocity is commanded, the own state is no longer published | a state that is not news must not look like news |
| `OWN_LOST_S` 5.0 | give up: land | MAVProxy and Skybrush call a vehicle lost after 4 to 5 s, MAVSDK after 3; zero velocity was commanded since 0.5 s, so patience costs nothing |
| heartbeat: `autopilots.timing.HEARTBEAT_LOST_S` 3.0 | on the ground: not ready | three in a row; MAVSDK's figure |
| heartbeat: `watch._VEHICLE_LOST_S` 5.0 | in the air: give up, land | five in a row: what its own failsafe waits for us |
| heartbeat, winding down: `descent._GONE_VEHICLE_S` 10.0 | the agent ends | nothing is left to land |

| silence of an agent (dead, frozen, a blocked disk) | who does what | why |
|---|---|---|
| `SETPOINT_TIMEOUT_S` 0.5 (ArduCopter), 1.0 (PX4) | its vehicle stops, by its own set-point time-out; a PX4 then lands | below |
| up to `SILENT_FLIES_S` 1.0 | the others keep clear of all that it may have flown on to with its last command | below |
| longer | they keep clear of where it was last heard, farther with its age for 3 s, bearing the whole burden; their traffic receivers see it move | it does not make way |
| FS_GCS_TIMEOUT 5 s (the vehicle's) | an ArduCopter lands in place | five of our heartbeats in a row; not return-to-launch, which crosses others' paths |
| back before `agent_lost_after_s` | it flies on with the next tick; a new process takes the vehicle over (`core/takeover.py`: at most `EVIDENCE_S` 5 of looking, `LEARN_S` 1 of holding) | the mission waits at its barrier, nothing was given up |
| back later | it finds the others on their way down, or its vehicle in its own landing: it lands, too, or yields | what was given up is not begun again in the air |
| `runtime.fleet._HUNG_WALL_S` 20 (wall clock) | `run` kills the process | its vehicle is down by then, and a run must end |

| age of the newest beacon of any station | what is done | why |
|---|---|---|
| `policies.station_lost_after_s` (5) | the mission's policy: go on, hold until one is heard, return, land | twenty beacons in a row |
| none was ever heard | nothing, unless `run` started the agent: then it does not arm | a mission needs no station |
"""  # noqa: E501

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

FRESH_S: Final = 0.5
PREDICT_S: Final = 0.3
CALM: Final = 0.3
"""A consensus at `rate` [1/s] carries what it was told on for at most CALM / rate seconds: where everybody adds
rate * lead of everybody else's command to his own, gains near 1 ring, and at 4 / s with news 0.15 s late swarms of 30
did for ever. A share of 0.3 leaves room for vehicles that are not as their models say."""
NEIGHBOUR_S: Final = 1.0
SETPOINT_TIMEOUT_S: Final = {"ardupilot": 0.5, "px4": 1.0}
"""What an agent sets before it arms (GUID_TIMEOUT, COM_OF_LOSS_T): a vehicle whose agent is silent flies its last
command for so long, blindly. In 1,600 missions with a dying agent one vehicle was hit with 1 s, none with 0.5 s. An
ArduCopter then stands still and goes on with the next setpoint; a PX4 leaves OFFBOARD for good, so it waits longer."""
SILENT_FLIES_S: Final = 1.0
"""For so long the others reckon with it: the longest of these, as they don't know what the silent one flies."""
OWN_FIX_S: Final = 0.5
OWN_LOST_S: Final = 5.0


def lead_s(rate: Any, least: Callable[[Any, Any], Any] = min) -> Any:
    """For how long the law carries on what it was told, at a consensus of `rate` [1/s] (`least`: for arrays)."""
    return least(PREDICT_S, CALM / rate)
