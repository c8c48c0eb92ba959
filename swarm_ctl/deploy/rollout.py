"""The ground's side: bundles go to all hosts at once, and start when every host has its own.

A swarm takes off when all of its agents are heard. So none is started while a host is missing: a
computer that comes back an hour later must not be what lets the others take off.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import IO, Final, TypeAlias, TypeVar

from pydantic import ValidationError

from swarm_ctl.deploy.bundle import Bundle
from swarm_ctl.deploy.logs import MOST_BYTES
from swarm_ctl.deploy.report import HostReport, ReportedState
from swarm_ctl.deploy.ssh import Reach, Ssh, SshResult
from swarm_ctl.engine.clock import pause, wall_s
from swarm_ctl.installed import version

_ASK_S: Final = 30.0
"""For an answer: a small computer takes some seconds to start Python."""
_SEND_S: Final = 120.0
"""For a bundle of some hundred KB over a slow radio."""
_AGAIN_S: Final = 2.0
"""Between two looks at a host that is offline."""
_AT_ONCE: Final = 16
"""Connections: each is a process of ssh."""
_MOST_TAR: Final = MOST_BYTES + (MOST_BYTES >> 4)
"""Bytes of a host's logs with the headers of their files."""
_T = TypeVar("_T")
Tell: TypeAlias = Callable[[str, str], None]
"""A host, and what happens there."""


@dataclass(frozen=True, slots=True)
class HostState:
    """One host, as far as the ground knows."""

    host: str
    reach: Reach
    words: str = ""
    """Why there is no report, or what keeps it from flying the wanted plan."""
    report: HostReport | None = None

    @property
    def running(self) -> bool:
        """A process of the swarm runs there."""
        return self.report is not None and bool(self.report.running)

    @property
    def agents(self) -> dict[str, ReportedState]:
        """How its agents stand."""
        services = self.report.services if self.report else ()
        return {s.name: s.state for s in services if s.name.startswith("agent-")}


def parted(states: Mapping[str, HostState], bundles: Mapping[str, Bundle]) -> str:
    """Why these hosts can't be started together, or ''. An agent that starts while others fly takes
    off below them."""
    flies, stands = [], []
    for host, state in states.items():
        runs = [name for name, how in state.agents.items() if how is ReportedState.RUNNING]
        flies += [f"{host}: {name}" for name in runs]
        agents = {f"agent-{i}" for i in bundles[host].manifest.agents}
        stands += [f"{host}: {name}" for name in sorted(agents - set(runs))]
    if not (flies and stands):
        return ""
    return (
        f"{', '.join(stands)} would start while others may fly ({', '.join(flies)});"
        " --restart lands them, and starts all together"
    )


class Hosts:
    """The hosts of a swarm, asked in parallel.

    Args:
        ssh: how they are reached.
        names: of the fleet.
    """

    def __init__(self, ssh: Ssh, names: Iterable[str]) -> None:
        self._ssh = ssh
        self.names = tuple(names)

    def report(self) -> dict[str, HostState]:
        """How they stand."""
        return self._states(self.names, ["state"], _ASK_S)

    def stop(self, within_s: float) -> dict[str, HostState]:
        """Land all agents and wait for their end."""
        words = ["stop", "--within", f"{within_s:g}"]
        return self._states(self.names, words, within_s + _ASK_S)

    def logs(self, out: Mapping[str, IO[bytes]], *, every: bool) -> dict[str, SshResult]:
        """Write a tar of each host's logs to its file in `out`."""
        words = ["logs", "--all"] if every else ["logs"]

        def one(host: str) -> SshResult:
            return self._ssh.ask(host, words, _SEND_S * 5, out=out[host], most=_MOST_TAR)

        return self._each(self.names, one)

    def bring(
        self, bundles: Mapping[str, Bundle], wait_s: float, tell: Tell, *, restart: bool
    ) -> dict[str, HostState]:
        """Bring each host its bundle, and wait for hosts that are offline. It ends early where one
        can't fly it: its state has words, then. `tell` is told what happens at a host. Nothing is
        started or stopped."""
        end = wall_s() + wait_s
        states: dict[str, HostState] = {}
        waiting, told = list(self.names), dict[str, str]()
        while True:
            found = self._states(waiting, ["state"], _ASK_S)
            states |= {h: _judged(found[h], bundles[h], restart=restart) for h in waiting}
            states |= self._send(
                bundles, tell, {h: states[h] for h in waiting if not states[h].words}
            )
            for host in waiting:
                if states[host].words and told.get(host) != states[host].words:
                    tell(host, states[host].words)
                    told[host] = states[host].words
            waiting = [host for host in waiting if states[host].reach is Reach.OFFLINE]
            hopeless = any(s.words and s.reach is not Reach.OFFLINE for s in states.values())
            if not waiting or hopeless or wall_s() > end:
                return {host: states[host] for host in self.names}
            pause(_AGAIN_S)

    def start(self, bundles: Mapping[str, Bundle]) -> dict[str, HostState]:
        """Start each host's bundle, which is there."""

        def one(host: str) -> HostState:
            words = ["start", "--bundle", bundles[host].digest]
            return _state(self._ssh.ask(host, words, _ASK_S), host)

        return self._each(self.names, one)

    def _send(
        self, bundles: Mapping[str, Bundle], tell: Tell, states: Mapping[str, HostState]
    ) -> dict[str, HostState]:
        """Send those their bundle that have another one, or none; how they stand then."""

        def one(host: str) -> HostState:
            bundle, before = bundles[host], states[host].report
            if before is not None and before.next == bundle.digest:
                tell(host, f"has bundle {bundle.digest} already")
                return states[host]
            state = _state(self._ssh.ask(host, ["install", "-"], _SEND_S, bundle.packed()), host)
            if not state.words:
                tell(host, f"got bundle {bundle.digest}")
            return state

        return {host: _fit(state) for host, state in self._each(list(states), one).items()}

    def _states(
        self, hosts: Sequence[str], words: Sequence[str], within_s: float
    ) -> dict[str, HostState]:
        answers = self._ask(hosts, words, within_s)
        return {host: _state(answer, host) for host, answer in answers.items()}

    def _ask(
        self, hosts: Sequence[str], words: Sequence[str], within_s: float
    ) -> dict[str, SshResult]:
        return self._each(hosts, lambda host: self._ssh.ask(host, words, within_s))

    def _each(self, hosts: Sequence[str], act: Callable[[str], _T]) -> dict[str, _T]:
        with ThreadPoolExecutor(_AT_ONCE) as pool:
            return dict(zip(hosts, pool.map(act, hosts), strict=True))


def _state(answer: SshResult, host: str) -> HostState:
    """What a host's answer to a call says."""
    if answer.reach is Reach.MISSING:
        words = f"has no swarm-ctl in its PATH: ssh {host} pip install swarm-ctl=={version()}"
        return HostState(host, answer.reach, words)
    if answer.reach is not Reach.ANSWERED:
        return HostState(host, answer.reach, answer.words or "no answer")
    try:
        return HostState(host, answer.reach, "", HostReport.model_validate_json(answer.out))
    except ValidationError:
        words = "its swarm-ctl answers what this one does not understand: is it another version?"
        return HostState(host, Reach.FAILED, words)


def _judged(state: HostState, bundle: Bundle, *, restart: bool) -> HostState:
    """With words where the host can't take this bundle."""
    report = state.report
    if report is None:
        return state
    if report.version != version():
        words = f"has swarm-ctl {report.version}: pip install swarm-ctl=={version()} there"
        return replace(state, words=words)
    if report.running and report.current != bundle.digest and not restart:
        what = "the same plan in another bundle"
        if report.whole_hash != bundle.manifest.whole_hash:
            what = f"plan {report.whole_hash}"
        words = f"{', '.join(report.running)}: runs with {what}; --restart lands it first"
        return replace(state, words=words)
    return state


def _fit(state: HostState) -> HostState:
    """With words where something is missing that the bundle needs."""
    attention = state.report.attention if state.report else ()
    return replace(state, words="; ".join(attention)) if attention else state
