"""The router, and the sessions and links of the processes that are its clients.

A session ends at once where its process dies or closes it, and after a lease where it is cut off or stopped.
What was on its way over a session that has ended does not arrive.
"""

import asyncio
import functools
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Protocol

from pointit.runtime.bus.contract import AnyTopic
from pointit.runtime.bus.memory_bus import LocalBroker
from tests.simulation.kernel.process import Process
from tests.simulation.kernel.timeline import Timeline

LEASE_S = 3.0
MAX_LEASE_DELAY_S = 0.5
"""Longest time from the end of a lease until the router sees it, s."""
MIN_RECONNECT_S = 0.2
MAX_RECONNECT_S = 2.0
GOOD_DELAY_S = 0.0003
"""Delay of a good link, s, and its largest jitter."""
MAX_GOOD_DELAY_S = 0.01
_STEP_S = 1e-9
"""Distance of two messages that would arrive at the same time, s."""

Retained = tuple[frozenset[str], Callable[[AnyTopic], Any]]
"""Keys of a keeper's topics, and the function that returns the retained states of one."""


class ClientBus(Protocol):
    """The bus of a process, as the network knows it."""

    process: Process
    exchange: LocalBroker
    is_connected: bool
    own_tokens: list[tuple[str, str]]
    served_retained: list[Retained]

    def update_tokens(self) -> None:
        """Report each presence that has changed."""
        ...


@dataclass
class Link:
    """Quality of the link between a machine and the router."""

    delay_s: float = GOOD_DELAY_S
    jitter_s: float = GOOD_DELAY_S
    drop: float = 0.0
    """Share of messages that a full queue drops."""
    is_cut: bool = False
    cut_at_s: float = 0.0

    @property
    def is_good(self) -> bool:
        """Return True if it has no fault."""
        return not self.is_cut and self.delay_s < MAX_GOOD_DELAY_S and not self.drop

    def become_good(self) -> None:
        """End all faults but a cut."""
        self.delay_s = GOOD_DELAY_S
        self.jitter_s = GOOD_DELAY_S
        self.drop = 0.0


@dataclass(eq=False)
class Session:
    """A process as a client of the router."""

    process: Process
    bus: ClientBus
    link: Link
    is_open: bool = True
    """False when its process has closed the bus or died."""
    is_connected: bool = False
    number: int = 0
    """Number of the connection: what was on its way in an earlier one does not arrive."""
    connected_at_s: float = 0.0
    held: list[Callable[[], object]] = field(default_factory=list[Callable[[], object]])
    """Sends what a cut link holds back."""
    answers: set["asyncio.Future[Any]"] = field(default_factory=set["asyncio.Future[Any]"])
    """Answers that this process owes, or waits for. They fail when the connection ends."""
    sent_s: dict[str, float] = field(default_factory=dict[str, float])
    """Time of the newest message of each kind at the router, s. A connection keeps the order of a kind."""
    arrived_s: dict[str, float] = field(default_factory=dict[str, float])
    """Time at which the newest message of each kind arrives here, s."""
    tokens: set[tuple[str, str]] = field(default_factory=set[tuple[str, str]])
    """Presence keys and names of others, as this process sees them."""


class Router:
    """Sessions, links, and the way of a message over both."""

    def __init__(self, timeline: Timeline) -> None:
        self.timeline = timeline
        self.random = timeline.random("network")
        self.links: dict[str, Link] = {}
        """By the name of the machine."""
        self.sessions: dict[Process, Session] = {}
        """Those whose buses are open."""
        self.on_connected: list[Callable[[Session], object]] = []
        self.on_left: list[Callable[[Session], object]] = []
        """Called when the router has ended a session."""
        self.on_closed: list[Callable[[Session], object]] = []
        """Called when a process has closed its bus or died."""

    # Sessions

    def attach(self, bus: ClientBus) -> Session:
        """Open the session of a process."""
        process = bus.process
        session = Session(process, bus, self.link(process.host.name))
        self.sessions[process] = session
        process.on_death.append(functools.partial(self._on_death, session))
        process.on_resumed.append(functools.partial(self._on_resumed, session))
        if session.link.is_cut:
            self._connect_later(session)
        else:
            self._connect(session)
        return session

    def detach(self, session: Session) -> None:
        """Close the session of a process whose bus was closed."""
        self._close(session)
        self._leave(session)

    def _close(self, session: Session) -> None:
        if not session.is_open:
            return
        session.is_open = False
        self.sessions.pop(session.process, None)
        for callback in self.on_closed:
            callback(session)

    def _on_death(self, session: Session) -> None:
        self._close(session)
        if not session.link.is_cut:
            self._leave(session)
            return
        # Nobody hears of the death before the lease of the cut link has ended
        left_s = session.link.cut_at_s + LEASE_S - self.timeline.now_s
        self.timeline.after(max(0.0, left_s) + 0.1, self._leave, session)

    def _leave(self, session: Session) -> None:
        """End the session at the router."""
        if not session.is_connected:
            return
        session.is_connected = False
        session.held = []
        for callback in self.on_left:
            callback(session)
        for answer in list(session.answers):
            if not answer.done():
                answer.set_result(("none", None))

    def _connect(self, session: Session) -> None:
        if not session.is_open or session.is_connected:
            return
        session.is_connected = True
        session.number += 1
        session.connected_at_s = self.timeline.now_s
        session.bus.is_connected = True
        for callback in self.on_connected:
            callback(session)

    def _connect_later(self, session: Session) -> None:
        self.timeline.after(self.random.uniform(MIN_RECONNECT_S, MAX_RECONNECT_S), self._try_connect, session)

    def _try_connect(self, session: Session) -> None:
        if not session.is_open or session.is_connected:
            return
        if session.link.is_cut or not session.process.zenoh_is_alive:
            self._connect_later(session)
        else:
            self._connect(session)

    def _notice_end(self, session: Session) -> None:
        """The process sees that its session has ended."""
        if not session.is_open:
            return
        session.bus.is_connected = False
        session.tokens = set()
        self.timeline.loop.call_soon(session.bus.update_tokens, context=session.process.context)
        self._connect_later(session)

    def _on_resumed(self, session: Session) -> None:
        if session.is_open and not session.is_connected:
            self._notice_end(session)

    def watch_stopped(self, process: Process) -> None:
        """End the lease of a process that was stopped by a signal, unless it goes on in time."""
        session = self.sessions.get(process)
        if session is not None:
            self.timeline.after(self._lease_s(), self._end_lease_of_stopped, session)

    def _end_lease_of_stopped(self, session: Session) -> None:
        if session.process.zenoh_is_alive or session.process.is_dead:
            return
        self.timeline.note("lease", f"of {session.process.name} has ended: it stands still")
        self._leave(session)

    def _lease_s(self) -> float:
        return LEASE_S + self.random.uniform(0.0, MAX_LEASE_DELAY_S)

    # Links

    def link(self, host: str) -> Link:
        """Return the link of the machine `host`."""
        return self.links.setdefault(host, Link())

    def cut(self, host: str) -> None:
        """Let nothing pass over the link of `host` until it is mended."""
        link = self.link(host)
        if link.is_cut:
            return
        link.is_cut = True
        link.cut_at_s = self.timeline.now_s
        self.timeline.after(self._lease_s(), self._end_lease_of_cut, host, link.cut_at_s)

    def _end_lease_of_cut(self, host: str, cut_at_s: float) -> None:
        link = self.link(host)
        if not link.is_cut or link.cut_at_s != cut_at_s:
            return
        self.timeline.note("lease", f"of the link of {host} has ended")
        for session in list(self.sessions.values()):
            if session.link is link:
                self._leave(session)
                self._notice_end(session)

    def mend(self, host: str) -> None:
        """End a cut. What it held back goes on if the lease has not ended."""
        link = self.link(host)
        if not link.is_cut:
            return
        link.is_cut = False
        for session in list(self.sessions.values()):
            if session.link is link:
                held = session.held
                session.held = []
                for send in held:
                    send()

    def delay_s(self, session: Session) -> float:
        """Return the duration of one way between a process and the router, s."""
        link = session.link
        return link.delay_s + link.jitter_s * self.random.random()

    def is_dropped(self, source: Session, target: Session) -> bool:
        """Return True if a full queue between the two drops a message."""
        drop = max(source.link.drop, target.link.drop)
        return drop > 0.0 and self.random.random() < drop

    # Messages

    def carry(self, source: Session, target: Session, kind: str, deliver: Callable[[], object]) -> None:
        """Carry something from `source` to `target`, in the order of its `kind` on each connection.

        A cut holds it back. It goes on if the cut ends in time, and is lost otherwise.
        """
        if not source.is_connected or not target.is_connected:
            return
        if source.link.is_cut:
            source.held.append(functools.partial(self.carry, source, target, kind, deliver))
            return
        now_s = self.timeline.now_s
        at_router_s = now_s + self.delay_s(source)
        at_router_s = max(at_router_s, source.sent_s.get(kind, 0.0) + _STEP_S)
        source.sent_s[kind] = at_router_s
        if at_router_s - now_s < MAX_GOOD_DELAY_S:
            self._pass_on(at_router_s, target, kind, deliver)
        else:
            self.timeline.after(at_router_s - now_s, self._pass_on, at_router_s, target, kind, deliver)

    def _pass_on(self, at_router_s: float, target: Session, kind: str, deliver: Callable[[], object]) -> None:
        if not target.is_open or not target.is_connected:
            return
        arrives_s = at_router_s + self.delay_s(target)
        arrives_s = max(arrives_s, target.arrived_s.get(kind, 0.0) + _STEP_S)
        target.arrived_s[kind] = arrives_s
        self.call_at(arrives_s, target, self._arrive, target, target.number, kind, deliver)

    def _arrive(self, target: Session, number: int, kind: str, deliver: Callable[[], object]) -> None:
        if not target.is_open or target.number != number:
            return
        if not target.link.is_cut:
            deliver()
        elif target.is_connected:
            target.held.append(functools.partial(self._pass_on_now, target, kind, deliver))

    def _pass_on_now(self, target: Session, kind: str, deliver: Callable[[], object]) -> None:
        self._pass_on(self.timeline.now_s, target, kind, deliver)

    def call_at(self, at_s: float, session: Session, callback: Callable[..., object], *args: object) -> None:
        """Call back in the process of `session` at the true time `at_s`."""
        self.timeline.call_at(at_s, callback, *args, context=session.process.context)
