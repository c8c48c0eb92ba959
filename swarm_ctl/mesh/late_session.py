"""A session that opens in a thread of its own: zenoh's client waits for its router, and an agent
that starts while the router is down has a vehicle to look after.

That thread is a daemon, so that the process can end. What it starts would be daemons, too, and
zenoh starts a thread for each callback: one that wakes while the interpreter ends aborts the
process (PyEval_RestoreThread cuts it off inside Rust). So another thread declares.
"""

from __future__ import annotations

import sys
import threading
from collections.abc import Callable
from typing import Any, Final

_WAIT_WALL_S: Final = 1.0
"""For a router that is there; it answers within 20 ms."""


class LateSession:
    """Stands for the session that `open_session` opens. What is declared before is declared when it
    is open; until then publishers drop, and subscribers hear nothing.

    `open_session` tries for some seconds and gives None where no router was there: then it is
    called again, until this session is closed.

    Raises what `open_session` raises within its first second.
    """

    def __init__(self, open_session: Callable[[], Any]) -> None:
        self._lock = threading.Lock()
        self._waiting: list[_Late] = []
        self._session: Any = None
        self._closed = False
        self._failure: Exception | None = None
        self._waited = False
        thread = threading.Thread(target=self._open, args=(open_session,), daemon=True)
        thread.start()
        thread.join(_WAIT_WALL_S)
        self._waited = True
        if self._failure is not None:
            raise self._failure

    def _open(self, open_session: Callable[[], Any]) -> None:
        session = None
        try:
            while session is None and not self._closed:
                session = open_session()
        except Exception as error:
            self._fail(error)
        if session is None:
            return
        declaring = threading.Thread(target=self._begin, args=(session,), daemon=False)
        declaring.start()
        declaring.join()

    def _fail(self, error: Exception) -> None:
        self._failure = error
        if self._waited:  # its caller flies on, as on a cut mesh
            sys.stderr.write(f"the mesh does not open: {error}\n")

    def _begin(self, session: Any) -> None:
        with self._lock:
            if not self._closed and self._all_declared(session):
                self._session = session
                self._waiting.clear()
                return
        session.close()  # which may take seconds: no control loop waits for the lock meanwhile

    def _all_declared(self, session: Any) -> bool:
        try:
            for late in self._waiting:
                late.declare(session)
        except Exception as error:
            # an agent that states reach and commands do not is worse off than on a cut mesh
            for late in self._waiting:
                late.forget()
            self._fail(error)
            return False
        return True

    def declare_publisher(self, *arguments: Any, **settings: Any) -> Any:
        """As the session's."""
        return self._declare(lambda session: session.declare_publisher(*arguments, **settings))

    def declare_subscriber(self, *arguments: Any, **settings: Any) -> Any:
        """As the session's."""
        return self._declare(lambda session: session.declare_subscriber(*arguments, **settings))

    def declare_queryable(self, *arguments: Any) -> Any:
        """As the session's."""
        return self._declare(lambda session: session.declare_queryable(*arguments))

    def get(self, *arguments: Any, **settings: Any) -> None:
        """As the session's; no answer comes before it is open."""
        if self._session is not None:
            self._session.get(*arguments, **settings)

    def liveliness(self) -> _LateLiveliness:
        """As the session's."""
        return _LateLiveliness(self._declare)

    @property
    def info(self) -> _LateInfo:
        """As the session's."""
        return _LateInfo(self._declare)

    def _declare(self, make: Callable[[Any], Any]) -> Any:
        with self._lock:
            if self._session is not None:
                return make(self._session)
            late = _Late(make)
            self._waiting.append(late)
            return late

    def close(self) -> None:
        """Close it, if it is open, or as soon as it is."""
        with self._lock:
            self._closed = True
            if self._session is not None:
                self._session.close()


class _LateLiveliness:
    """Declares tokens as soon as the session is open."""

    def __init__(self, declare: Callable[[Callable[[Any], Any]], Any]) -> None:
        self._declare = declare

    def declare_token(self, key: str) -> Any:
        """As a session's liveliness."""
        return self._declare(lambda session: session.liveliness().declare_token(key))


class _LateInfo:
    """Declares listeners as soon as the session is open."""

    def __init__(self, declare: Callable[[Callable[[Any], Any]], Any]) -> None:
        self._declare = declare

    def declare_link_events_listener(self, *arguments: Any, **settings: Any) -> Any:
        """As a session's info."""
        return self._declare(
            lambda session: session.info.declare_link_events_listener(*arguments, **settings)
        )


class _Late:
    """What is still to be declared, or has been meanwhile: a publisher, subscriber or listener."""

    def __init__(self, make: Callable[[Any], Any]) -> None:
        self._make = make
        self._made: Any = None
        self._undeclared = False

    def declare(self, session: Any) -> None:
        """The session is open."""
        if not self._undeclared:
            self._made = self._make(session)

    def forget(self) -> None:
        """The session is none: publish and hear nothing."""
        self._made = None

    def put(self, *arguments: Any, **settings: Any) -> None:
        """Publish, or drop."""
        if (made := self._made) is not None:
            made.put(*arguments, **settings)

    def try_recv(self) -> Any:
        """The next sample; None: there is none."""
        made = self._made
        return None if made is None else made.try_recv()

    def undeclare(self) -> None:
        """It is not needed any more."""
        self._undeclared = True
        if self._made is not None:
            self._made.undeclare()
