"""What zenoh's log says of refused links, whatever parts it is read in."""

from __future__ import annotations

import itertools

from hypothesis import given
from hypothesis import strategies as st

from swarm_ctl.core.model.messages import RefusalReason
from swarm_ctl.engine.refused_links import RefusedLinks
from swarm_ctl.mesh.gate import RECENT_S

_WARN = b"2026-11-22T18:31:39Z \x1b[33m WARN\x1b[0m app-0 ThreadId(02) zenoh_link_tls::unicast: "
LOG = (
    b"hello\n" + _WARN + b"peer sent no certificates. Hint: increase the system open file limit.\n"
    b"an agent's own line\n" + _WARN + b"received corrupt message of type InvalidContentType.\n"
    + _WARN + b"peer sent no certificates. Hint: increase the system open file limit.\n"
    + _WARN + b"something that a later zenoh may say\n"
)  # fmt: skip


@given(st.lists(st.integers(0, len(LOG)), max_size=8))
def test_lines_are_counted_by_reason_and_others_copied(cuts: list[int]) -> None:
    links = RefusedLinks()
    places = [0, *sorted(cuts), len(LOG)]
    copied = b"".join(links.read(LOG[a:b]) for a, b in itertools.pairwise(places))
    assert copied == b"hello\nan agent's own line\n"
    found = {refusal.words: refusal.count for refusal in links.refused(1.0)}
    assert found == {
        "a link: the other end has no certificate": 2,
        "a link: the other end speaks no TLS: it flies without trust, or is no agent": 1,
        "a link: the TLS handshake failed": 1,
    }
    assert {refusal.reason for refusal in links.refused(1.0)} == {RefusalReason.LINK}
    assert links.refused(1.1 + RECENT_S) == ()


def test_a_line_without_end_is_not_kept() -> None:
    links = RefusedLinks()
    assert len(b"".join(links.read(bytes(1 << 16)) for _ in range(10))) >= 9 << 16
