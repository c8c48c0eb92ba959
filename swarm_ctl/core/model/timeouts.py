"""How old news may be, and what is done with it then: all timings in one table. Ages in seconds of
mission time.

The age of a peer's state is the best guess, by its clock as far as that is known
(`core/swarm/clocks.py`); it is off by half the round trip at most, so never more than twice as
much: what counts as fresh is at most 1 s old, whatever the ways are like. What the safety filter
reckons that somebody has flown since is counted with all that doubt (`age_at_most`).

| news | age, for how long | what is done | why this number |
|---|---|---|---|
| a peer's state | up to `FRESH_S` 0.5 | used, its stop point carried on with its command for at most `PREDICT_S` 0.3, by the law for `CALM` 0.3 / (kappa h) at most | ten lost states in a row at 20 Hz; beyond 0.3 s a command says little about the next one; further than that a fast law rings |
| | up to `NEIGHBOUR_S` 1.0 | still followed and carried on for 0.3 s; the shape is not judged by it, the filter expects no help of its sender any more and reckons with all that it may have flown in `SILENT_FLIES_S` 1.0 | one re-connection of a mesh link |
| | older | leaves N_i (the law no longer follows it, the guard no longer pulls), but stays in the avoidance region where it was last heard, or where the own autopilot's traffic sees it | the graph may be cut: reported |
| | inflated from 0 on, for `constraints._GROWS_S` 3.0 | its keep-out distance grows by `constraints._GROWTH` 0.1 of r_out - r_in a second, besides what it may have flown with its last command at that age | a model is never quite right, and less so the longer it runs on; 3 s is the set-point time-out of an ArduCopter as delivered, and what stands still for good must not block ever more room |
| | `policies.agent_lost_after_s` 5.0 | lost: the mission's policy; the barrier waits for it, unless that is `continue` | long enough for a link to reconnect twice; since 1 s nobody follows it, and its own autopilot has stopped it |
| | seen by a follower of the frame: up to `PREDICT_S` 0.3 | the frame moves on with the leader's rate; older: it stands; over `NEIGHBOUR_S` 1.0: the next agent leads | as above |
| a peer's clock | a word each `clocks.EVERY_S` 1.0, each `clocks.ASK_EVERY_S` 0.2 while somebody asks | bounds on how far it is ahead | a round trip is fresh for seconds, as clocks drift by `clocks.DRIFT` 0.001 at most: 1 ms a second |
| | not known, or contradicted | its news counts as over `NEIGHBOUR_S` 1.0 old, and older from then on: nobody follows it, nobody loses it before 4 s | a first answer takes half a second, with half of all lost mostly a second |
| | `clocks._ECHOED_S` 5.0 | its words are not given back any more | five words in a row: it is gone |
| own mesh lost | after `FRESH_S` 0.5, `NEIGHBOUR_S` 1.0 | as above, for every peer at once: nobody is followed, everybody is kept clear of where he was heard last and where the own traffic receiver sees him | each agent has only ages to go by: it cannot tell its own radio from theirs |
| | `zenoh_transport._LEASE_S` 3.0 | zenoh drops the silent link and connects again | it decides nothing: ages do; shorter ones cut links at every hiccup |
| | `policies.agent_lost_after_s` 5.0, `policies.station_lost_after_s` 5.0 | the policies; `policies.hold_before_land_s` 3.0 of standing still, then down in place | the others come to the same after the same time: both sides of a cut hold, then land, where they stand |
| | on the way back (`return`), nobody heard for `policies.agent_lost_after_s` 5.0 | land in place | without news there is no order to cross each other's ways in |
| | on the ground, before the first step: `failsafes._PATIENCE_S` 30.0 | the mission ends | nobody arms without the others, so waiting costs only time |
| the traffic sensor | up to `peers._CONTACT_S` 3.0 | carried on with its velocity to now, all of the burden on us; one within 2.5 m of a peer heard in the last `NEIGHBOUR_S` 1.0 is that peer | ADSB_VEHICLE comes at 1 Hz from some receivers, 5 Hz is asked for: three in a row |
| | `incoming.CONTACT_KEPT_S` 10.0 | forgotten | only to bound what is kept |
| the own vehicle's position | `OWN_FIX_S` 0.5 | carried on with its velocity until then; now zero velocity is commanded, the own state is no longer published | a state that is not news must not look like news |
| | `timing.FIX_MAX_AGE_S` 1.0 | on the ground: not ready | 20 missing in a row |
| | `OWN_LOST_S` 5.0 | give up: land | MAVProxy and Skybrush call a vehicle lost after 4 to 5 s, MAVSDK after 3; zero velocity was commanded since 0.5 s, so patience costs nothing |
| the own vehicle's heartbeat | `timing.HEARTBEAT_LOST_S` 3.0 | on the ground: not ready | three in a row; MAVSDK's figure |
| | `failsafes._VEHICLE_LOST_S` 5.0 | in the air: give up, land | five in a row: what its own failsafe waits for us |
| | winding down: `landing._GONE_VEHICLE_S` 10.0 | the agent ends | nothing is left to land |
| an agent is silent (dead, frozen, a blocked disk) | `SETPOINT_TIMEOUT_S`: 0.5 (ArduCopter), 1.0 (PX4) | its vehicle stops, by its own set-point time-out; a PX4 then lands | below |
| | up to `SILENT_FLIES_S` 1.0 | the others keep clear of all that it may have flown on to with its last command | below |
| | longer | they keep clear of where it was last heard, bearing the whole burden; their traffic receivers see it move | it does not make way |
| | FS_GCS_TIMEOUT 5 s (the vehicle's) | an ArduCopter lands in place | five of our heartbeats in a row; not return-to-launch, which crosses others' paths |
| | back before `policies.agent_lost_after_s` 5.0 | it flies on with the next tick, and takes what waited in its queue for as old as it is; a new process takes the vehicle over (at most `takeover.EVIDENCE_S` 5.0 of looking, `takeover.LEARN_S` 1.0 of holding) | the mission waits at its barrier, nothing was given up |
| | back later | it finds the others on their way down, or its vehicle in its own landing: it lands, too, or yields | what was given up is not begun again in the air |
| | its way back is blocked: `return_to_launch._BLOCKED_S` 8.0 | who returns lands beside a lost vehicle | who stands still so long on the way has something in it for good |
| | `supervisor._HUNG_WALL_S` 20.0 (wall clock) | `run` kills the process | its vehicle is down by then, and a run must end |
| the newest beacon of any station | `policies.station_lost_after_s` 5.0 | the mission's policy: go on, hold until one is heard, return, land | twenty beacons in a row |
| | none was ever heard | nothing, unless `run` started the agent: then it does not arm | a mission needs no station |
"""  # noqa: E501

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

FRESH_S: Final = 0.5
PREDICT_S: Final = 0.3
CALM: Final = 0.3
"""A consensus at `rate` [1/s] carries what it was told on for at most CALM / rate seconds: where
everybody adds rate * lead of everybody else's command to his own, gains near 1 ring, and at 4 / s
with news 0.15 s late swarms of 30 did for ever. A share of 0.3 leaves room for vehicles that are
not as their models say."""
NEIGHBOUR_S: Final = 1.0
SETPOINT_TIMEOUT_S: Final = {"ardupilot": 0.5, "px4": 1.0}
"""What an agent sets before it arms (GUID_TIMEOUT, COM_OF_LOSS_T): a vehicle whose agent is silent
flies its last command for so long, blindly. In 1,600 missions with a dying agent one vehicle was
hit with 1 s, none with 0.5 s. An ArduCopter then stands still and goes on with the next setpoint; a
PX4 leaves OFFBOARD for good, so it waits longer."""
SILENT_FLIES_S: Final = 1.0
"""For so long the others reckon with it: the longest of these, as they don't know what the silent
one flies."""
OWN_FIX_S: Final = 0.5
OWN_LOST_S: Final = 5.0


def lead_s(rate: Any, least: Callable[[Any, Any], Any] = min) -> Any:
    """For how long the law carries on what it was told, at a consensus of `rate` [1/s] (`least`:
    for arrays)."""
    return least(PREDICT_S, CALM / rate)
