"""Presence on the network: tokens of living sessions, told to each process in order."""

from collections.abc import Callable

from tests.simulation.kernel.process import Process
from tests.simulation.network.router import Router, Session

Token = tuple[str, str]
"""Presence key and name."""
_STEP_S = 1e-9


class PresenceNetwork:
    """Tokens, who holds them, and what each process knows of them."""

    def __init__(self, router: Router) -> None:
        self._router = router
        self._owners: dict[Token, dict[Process, int]] = {}
        """Number of announcements by process."""
        self._told_s: dict[Session, float] = {}
        """Time at which the newest change arrives at each process, s."""
        router.on_connected.append(self._on_connected)
        router.on_left.append(self._on_left)

    def announce(self, session: Session, token: Token) -> None:
        """Add a token, which is told to all if it is the first of its name."""
        if not session.is_connected:
            return
        owners = self._owners.setdefault(token, {})
        is_new = not owners
        owners[session.process] = owners.get(session.process, 0) + 1
        if is_new:
            self._tell(token, is_present=True)

    def withdraw(self, session: Session, token: Token) -> None:
        """Remove a token, which is told to all if it was the last of its name."""
        owners = self._owners.get(token)
        if owners is None or session.process not in owners:
            return
        owners[session.process] -= 1
        if owners[session.process] <= 0:
            self._remove_owner(token, session)

    def _remove_owner(self, token: Token, session: Session) -> None:
        owners = self._owners[token]
        del owners[session.process]
        if not owners:
            del self._owners[token]
            self._tell(token, is_present=False)

    def _on_connected(self, session: Session) -> None:
        for token in session.bus.own_tokens:
            self.announce(session, token)
        self._call_soon(session, self._show_all)

    def _on_left(self, session: Session) -> None:
        for token, owners in list(self._owners.items()):
            if session.process in owners:
                self._remove_owner(token, session)

    def _show_all(self, session: Session) -> None:
        if session.is_connected and session.is_open:
            session.tokens = set(self._owners)
            session.bus.update_tokens()

    def _call_soon(self, session: Session, callback: Callable[..., object], *args: object) -> None:
        """Call back in the process when what the router sends now has arrived there, in order."""
        at_s = self._router.timeline.now_s + 2 * self._router.delay_s(session)
        at_s = max(at_s, self._told_s.get(session, 0.0) + _STEP_S)
        self._told_s[session] = at_s
        self._router.call_at(at_s, session, callback, session, *args)

    def _tell(self, token: Token, *, is_present: bool) -> None:
        for session in list(self._router.sessions.values()):
            if session.is_connected:
                self._call_soon(session, self._receive, token, is_present, session.number)

    def _receive(self, session: Session, token: Token, is_present: bool, number: int) -> None:
        if not session.is_connected or session.number != number:
            return
        if session.link.is_cut:
            # When the cut ends in time, all are shown. Else the process sees nobody.
            session.held.append(lambda: self._call_soon(session, self._show_all))
            return
        if is_present:
            session.tokens.add(token)
        else:
            session.tokens.discard(token)
        if session.is_open:
            session.bus.update_tokens()
