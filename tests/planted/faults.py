"""The faults: each one slip that a change could make, by the text that it changes."""

from __future__ import annotations

from typing import Final, NamedTuple


class Fault(NamedTuple):
    """One slip."""

    name: str
    """Its first word is the part that it is in."""
    says: str
    """What it makes of the swarm."""
    path: str
    was: str
    """Stands in the file exactly once."""
    becomes: str
    meets: str = ""
    """Part of a scenario's file, as a regular expression, without which the fault changes no
    flight."""
    lockstep: bool = False
    """It is in the processes alone: these fly the scenarios, too (`fuzz --lockstep`)."""


_AGENT: Final = "swarm_ctl/core/agent"
_KERNEL: Final = "swarm_ctl/core/kernel"

FAULTS: Final = (
    Fault(
        "barrier-begun",
        "goes on when the others have begun the step, not when they are done",
        "swarm_ctl/core/model/route.py",
        "if progress < (waits[other], True)]",
        "if progress < (waits[other], False)]",
    ),
    Fault(
        "barrier-pause",
        "a step's time-out goes on while a command holds it up",
        f"{_AGENT}/progress.py",
        "self.paused_s += tick_s",
        "self.paused_s = tick_s",
        r"order: (hold|expel|form|move|follow)|(lost|low|fast|wind|estimate|fence): hold",
    ),
    Fault(
        "landing-unbraked",
        "lands before it stands",
        f"{_AGENT}/landing.py",
        "            braked = slow or now",
        "            braked = True or now",
    ),
    Fault(
        "landing-room",
        "makes room only where a vehicle stands below and another one flies beside",
        f"{_AGENT}/landing.py",
        "aside = (over or crowded)",
        "aside = (over and crowded)",
    ),
    Fault(
        "filter-half",
        "does all of keeping apart, as if the other one did nothing: both do, and overshoot",
        f"{_KERNEL}/constraints.py",
        "share = 0.5 if other.yields else 1.0",
        "share = 1.0",
    ),
    Fault(
        "filter-silent",
        "forgets that a silent agent's vehicle flies on for a second",
        f"{_KERNEL}/constraints.py",
        "return SILENT_FLIES_S + FAR_LATE_S if rare else SILENT_FLIES_S",
        "return 0.0",
        r"kill|stop|part|station|mesh",
    ),
    Fault(
        "filter-along",
        "counts on one of the own formation that is held up",
        "swarm_ctl/core/safety/safety_filter.py",
        "along = other.formation == key and flies_with(setpoint, formation.velocity)",
        "along = other.formation == key",
        r"move:|rotate:|scale:|follow:|order: (move|follow)",
    ),
    Fault(
        "filter-caution",
        "slows for the last of those that are near, not for the nearest",
        f"{_KERNEL}/decide.py",
        "most = min(most, cap(room,",
        "most = min(speed, cap(room,",
    ),
    Fault(
        "heights-goal",
        "counts a vehicle at its height, not on its way to another",
        f"{_KERNEL}/heights.py",
        "return Span(min(height_m, goal_m), max(height_m, goal_m), doubt_m)",
        "return Span(height_m, height_m, doubt_m)",
        r"layers: |up_m: ",
    ),
    Fault(
        "zones-new",
        "keeps out of the plan's zones, and not out of new ones",
        "swarm_ctl/core/safety/safety_filter.py",
        "self._surroundings = Surroundings(zones, self._plan.fence",
        "self._surroundings = Surroundings(self._plan.zones, self._plan.fence",
        r"order: zone add",
    ),
    Fault(
        "failsafe-lightest",
        "the lightest trigger decides",
        f"{_AGENT}/failsafes.py",
        "return max(found, key=lambda trigger",
        "return min(found, key=lambda trigger",
    ),
    Fault(
        "failsafe-fence",
        "minds the fence only before the vehicle follows setpoints",
        f"{_AGENT}/failsafes.py",
        "if not s.had_control or s.tick.newest_fix is None or s.progress.lands_in_place:",
        "if s.had_control or s.tick.newest_fix is None or s.progress.lands_in_place:",
    ),
    Fault(
        "failsafe-patience",
        "waits for a lost agent in the air as long as on the ground",
        f"{_AGENT}/failsafes.py",
        "    if s.progress.step == 0:\n        after = max(after, _PATIENCE_S)",
        "    if s.progress.step >= 0:\n        after = max(after, _PATIENCE_S)",
        r"kill|stop|part",
    ),
    Fault(
        "failsafe-resume",
        "takes a vehicle again that a pilot still flies",
        f"{_AGENT}/takeover.py",
        "if not view.controlled or view.mode_doubt:\n            wanted",
        "if view.mode_doubt:\n            wanted",
        r"order: resume",
    ),
    Fault(
        "failsafe-position",
        "flies on by a position that is a minute old",
        "swarm_ctl/core/model/timeouts.py",
        "OWN_FIX_S: Final = 0.5",
        "OWN_FIX_S: Final = 60.0",
        r"GPS_OFF|LOSS|DELAY|REBOOT",
    ),
    Fault(
        "verdict-unit",
        "takes r_in in units for metres",
        "swarm_ctl/report/judge/findings.py",
        "    r_in_m = plan.law.r_in * plan.unit_m\n    for pair in pairs:",
        "    r_in_m = plan.law.r_in\n    for pair in pairs:",
        r"GPS|pilot|MOTOR|kill|LOSS|DELAY|says|WIND",
    ),
    Fault(
        "verdict-order",
        "an order excuses an agent that failed before it",
        "swarm_ctl/report/judge/verdict.py",
        "and _broken_s(s) < order_s - _HEARD_S]",
        "and _broken_s(s) > order_s - _HEARD_S]",
        r"order: (land|return|kill)",
    ),
    Fault(
        "link-clock",
        "dates a peer's words to the wrong side of its clock",
        "swarm_ctl/core/swarm/peers.py",
        "self.true_s = min(told_s - 0.5 * (low + high), received_s)",
        "self.true_s = min(told_s + 0.5 * (low + high), received_s)",
        r"clocks?:",
    ),
    Fault(
        "link-setpoints",
        "a vehicle flies its silent agent's last setpoint for five seconds",
        "swarm_ctl/core/model/autopilots.py",
        "setpoint_timeout_s=0.5,",
        "setpoint_timeout_s=5.0,",
        r"kill|stop",
    ),
    Fault(
        "keeper-agents",
        "grants what comes after a tick without waiting for the agents",
        "swarm_ctl/engine/lockstep/keeper.py",
        "agents = [m for m in running if m.port]",
        "agents = [m for m in running if not m.port]",
        lockstep=True,
    ),
    Fault(
        "barrier-any",
        "goes on when one of the others is done",
        "swarm_ctl/core/model/route.py",
        "return [other for other, progress in told.items() if progress < (waits[other], True)]",
        "late = [i for i, progress in told.items() if progress < (waits[i], True)]; "
        "return late if len(late) == len(told) else []",
    ),
    Fault(
        "barrier-own",
        "waits at a barrier of several groups for its own one",
        "swarm_ctl/core/model/route.py",
        "waits |= {i: k for i, k in there if k is not None and i not in waits}",
        "waits |= {i: k for i, k in there if k is None and i not in waits}",
        r"split:",
    ),
    Fault(
        "landing-armed",
        "is done with its landing before its vehicle is disarmed",
        f"{_AGENT}/landing.py",
        "if view.on_ground and not view.armed and self._interruption.trigger is None:",
        "if view.on_ground and self._interruption.trigger is None:",
    ),
    Fault(
        "landing-hold",
        "does not stand first, as policies.hold_before_land_s has it",
        f"{_AGENT}/landing.py",
        "if waited < brake_s or not braked or aside or zone:",
        "if not braked or aside or zone:",
        r"kill|stop|station|part|BATT|GPS|WIND",
    ),
    Fault(
        "failsafe-light",
        "holds, whatever the policy says",
        f"{_AGENT}/failsafes.py",
        "return failed(FailsafeAction(policy.value), reason, about=about)",
        "return failed(FailsafeAction.HOLD, reason, about=about)",
        r"kill|stop|station|part|BATT|GPS|WIND",
    ),
    Fault(
        "failsafe-late",
        "waits three times as long for a silent agent",
        f"{_AGENT}/failsafes.py",
        "and peer.silent_s > after",
        "and peer.silent_s > 3.0 * after",
        r"kill|stop",
    ),
    Fault(
        "verdict-pair",
        "finds a pair only under half of r_in",
        "swarm_ctl/report/judge/findings.py",
        "if pair.distance_m < r_in_m:",
        "if pair.distance_m < 0.5 * r_in_m:",
        r"GPS|pilot|MOTOR|kill|LOSS|DELAY|says|WIND",
    ),
    Fault(
        "link-age",
        "says that it hears a silent agent",
        "swarm_ctl/core/swarm/peers.py",
        "age_s=None if math.isinf(age) or self.expelled else age,",
        "age_s=None if math.isinf(age) or self.expelled else 0.0,",
        r"kill|stop",
    ),
    Fault(
        "link-lost",
        "counts no states that are lost",
        "swarm_ctl/core/swarm/peers.py",
        "self.lost += state.seq - self._counted - 1",
        "self.lost += 0",
        r"loss:",
    ),
)
