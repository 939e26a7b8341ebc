"""Bus of a process on a secured site: the rights of its identity, and a self-test of them.

Rules that grant a key grant `KEY/@may/NAME/VERB` too. The process writes test messages there. A second
session of the same identity, which lives as long as the test, reports those that arrive: delivery within one
session is never filtered. Keys of services are not touched.
"""

import asyncio
import contextlib
import logging
import secrets
from collections.abc import AsyncGenerator, Callable, Collection, Iterable
from typing import TypeVar

import zenoh
from zenoh.handlers import Callback

from pointit.runtime.bus.contract import REQUEST_TIMEOUT_S, AnyTopic
from pointit.runtime.clock import wait_up_to
from pointit.runtime.errors import AccessDeniedError, NoAnswerError, PointItError
from pointit.runtime.host.advised_commands import advised_commands
from pointit.runtime.link.link import JOIN, ROOM, VERBS, Credentials, Link
from pointit.runtime.zenoh.queries import ReplyLimit, query_replies
from pointit.runtime.zenoh.session import close_session, open_session
from pointit.runtime.zenoh.zenoh_bus import ZenohBus
from pointit.schemas import Query, Reply
from pointit.schemas.problems import DENIED, Problem
from pointit.schemas.text import first_of
from pointit.schemas.topics import ANY, REQUESTS, Request, topic_of

log = logging.getLogger(__name__)

Right = tuple[str, str]
"""A verb (`reads` or `writes`) and a key relative to the site."""

Second = Callable[[], contextlib.AbstractAsyncContextManager[zenoh.Session]]
"""Opens a session of the same identity, and closes it."""

Q = TypeVar("Q", bound=Query)
R = TypeVar("R", bound=Reply)

WORDS = {"writes": "write", "reads": "read", "serves": "answer", "asks": "ask"}

SETTLE_S = 0.25
"""Rights declared within this time are tested together."""
WAITS_S = (0.05, 0.1, 0.2, 0.4, 0.8, 1.6)
"""Delays before the messages of a round are written again, s."""
MIN_COMPLETE_ROUNDS = 3
"""Complete rounds in which a message must be missing to count as denied. A round is complete when its last
message, which all may write, has arrived. Sessions deliver in order."""
ANSWER_TIMEOUT_S = 2.0
"""Maximum time of the router for the end of a question, s. It takes milliseconds."""
RETRY_S = (2.0, 5.0, 15.0, 60.0)
"""Delays before denied rights are tested again, s. The last one repeats. A restarted router answers late
while all its clients reconnect, and rules may change."""
MAX_KEYS = 3
"""Maximum number of keys in a message."""


class PermissionProbe:
    """Tests rights when they are first wanted, and all of them when the router is back."""

    def __init__(
        self, session: zenoh.Session, credentials: Credentials, second: Second, is_up: Callable[[], bool]
    ) -> None:
        """Test the rights of `session`.

        Args:
            session: The session that writes.
            credentials: The credentials of both sessions.
            second: Opens and closes the session that listens.
            is_up: Returns True if there is a router. Without one, no right is known.
        """
        self._session = session
        self._credentials = credentials
        self._second = second
        self._is_up = is_up
        self._loop = asyncio.get_running_loop()
        self._rights: set[Right] = set()
        self._untested: set[Right] = set()
        self._testing: set[Right] = set()
        self._tested = asyncio.Event()
        """Set at the end of each test, then replaced by a new event."""
        self._denied: set[Right] = set()
        self._is_unknown_identity = False
        self._denials = 0
        """Number of consecutive tests in which a right was denied."""
        self._is_due = asyncio.Event()
        self._task = self._loop.create_task(self._run(), name="self-test")
        # The first test starts when a right is added

    @property
    def problems(self) -> tuple[Problem, ...]:
        """Return one problem for each kind of right that is known to be denied."""
        name = self._credentials.link.name
        sentences = self._sentences()
        return tuple(Problem(code=DENIED, sentence=sentence, subject=name) for sentence in sentences)

    def add(self, verb: str, key: str) -> None:
        """Schedule a test of a right, unless it was tested already."""
        right = (verb, key)
        if right not in self._rights:
            self._rights.add(right)
            self._untested.add(right)
            self._is_due.set()

    def retest(self) -> None:
        """Schedule a new test of all rights. A router that is back may have other rules."""
        self._denials = 0
        self._untested |= self._rights
        self._is_due.set()

    async def denial_reason(self, verb: str, key: str) -> str:
        """Return the reason if this right is denied, or `""` if it is granted or unknown.

        An added right is tested together with others, and not again while it is granted.
        """
        right = (verb, key)
        was_pending = self._is_pending(right)
        for _ in range(2):  # it may have been added during a test
            if self._is_pending(right) and self._is_up():
                await self._tested.wait()

        # A denial that was known before may be over, so only a new one is believed
        if right in self._rights and not self._is_pending(right):
            if right not in self._denied:
                return ""
            if was_pending:
                return self._denial(right, is_unknown=self._is_unknown_identity)

        # Otherwise test this right alone. If nothing arrives, not even the right to join does.
        arrived = await self._granted_rights({right})
        if arrived is None or right in arrived:
            return ""
        return self._denial(right, is_unknown=not arrived)

    def _denial(self, right: Right, *, is_unknown: bool) -> str:
        """Return the reason why `right` is denied. `is_unknown`: the router does not know this identity."""
        if is_unknown:
            return _unknown_identity_error(self._credentials)
        verb, key = right
        return _sentence(self._credentials, verb, [key])

    async def close(self) -> None:
        """Stop testing."""
        self._task.cancel()
        await asyncio.gather(self._task, return_exceptions=True)

    async def _run(self) -> None:
        while True:
            wait_s: float | None = None
            if self._denied:
                attempt = min(max(self._denials, 1), len(RETRY_S))
                wait_s = RETRY_S[attempt - 1]
            if not await wait_up_to(self._is_due, wait_s):
                self._untested |= self._denied
            await asyncio.sleep(SETTLE_S)
            self._is_due.clear()
            if self._untested and self._is_up():
                await self._test_rights()

    def _is_pending(self, right: Right) -> bool:
        return right in self._untested or right in self._testing

    async def _test_rights(self) -> None:
        rights = self._untested
        self._untested = set[Right]()
        self._testing = rights
        try:
            self._store_result(rights, await self._granted_rights(rights))
        finally:
            self._testing = set()
            tested = self._tested
            self._tested = asyncio.Event()
            tested.set()

    def _store_result(self, rights: set[Right], arrived: set[Right] | None) -> None:
        if arrived is None:
            self._untested |= rights
            if self._is_up():  # otherwise `retest` follows when it is back
                self._is_due.set()
            return
        previous = self._sentences()
        self._is_unknown_identity = not arrived
        self._denied = (self._denied - rights) | (rights - arrived)
        self._denials = self._denials + 1 if self._denied else 0
        for sentence in self._sentences():
            if sentence not in previous:
                log.warning("%s", sentence)
        if previous and not self._sentences():
            log.info("%s may do now what it needs", self._credentials.description)

    async def _granted_rights(self, rights: Iterable[Right]) -> set[Right] | None:
        """Return the granted `rights` and the right to join, or None if the router did not answer all."""
        name = self._credentials.link.name
        prefix = f"{ROOM}/{name}"
        keys = {f"{key}/{prefix}/{verb}": (verb, key) for verb, key in rights}
        join = f"{prefix}/{JOIN}"
        keys[join] = (JOIN, "")
        arrivals = _Arrivals(keys, join)

        def on_sample(sample: zenoh.Sample) -> None:  # on Zenoh's thread
            with contextlib.suppress(RuntimeError):  # the loop is closed
                key = str(sample.key_expr)
                self._loop.call_soon_threadsafe(arrivals.record, key, sample.payload.to_bytes())

        # Several rounds, since messages may be lost. In each, the key that all may write comes last.
        try:
            async with self._second() as second:
                callback = Callback(on_sample, indirect=False)
                second.declare_subscriber(f"**/{prefix}/**", callback)
                for number, wait_s in enumerate(WAITS_S):
                    for key in (*(keys.keys() - arrivals.keys - {join}), join):
                        self._session.put(key, arrivals.token + bytes([number]))
                    await wait_up_to(arrivals.all_arrived, wait_s)
                    if arrivals.is_complete:
                        break
                is_answered = bool(arrivals.keys) or await self._router_answers(second)
        except (PointItError, zenoh.ZError):
            return None

        # Nothing arrives of an identity without rights, and nothing from a router that is busy with others
        if not is_answered:
            return None

        # A missing message shows no denial if others were lost, too, or if the router is gone
        if arrivals.keys and not arrivals.is_complete:
            return None
        if not self._is_up():
            return None
        return {keys[key] for key in arrivals.keys & keys.keys()}

    async def _router_answers(self, second: zenoh.Session) -> bool:
        """Return True if the router has dealt with all that both sessions have sent.

        It ends each question, also one that it denies, and reads those of a session behind its messages.
        """
        name = self._credentials.link.name
        for session in (self._session, second):
            replies = await query_replies(
                session, f"{ROOM}/{name}/{JOIN}", limit=ReplyLimit(1), timeout=ANSWER_TIMEOUT_S
            )
            if any(reply.err is not None for reply in replies):  # Zenoh's own: it has timed out
                return False
        return True

    def _sentences(self) -> list[str]:
        if self._is_unknown_identity:
            return [_unknown_identity_error(self._credentials)]
        sentences: list[str] = []
        for verb in VERBS:
            denied_keys = [key for right_verb, key in self._denied if right_verb == verb]
            by_person: dict[str, list[str]] = {}
            for key in sorted(denied_keys):
                by_person.setdefault(_person(key), []).append(key)
            sentences += [_sentence(self._credentials, verb, keys) for keys in by_person.values()]
        return sentences


class _Arrivals:
    """Messages of one test of rights that came through."""

    def __init__(self, sent_keys: Collection[str], join: str) -> None:
        self.keys: set[str] = set()
        self.all_arrived = asyncio.Event()
        self.token = secrets.token_bytes(8)  # other processes of this identity test the same keys
        self._sent_keys = frozenset(sent_keys)
        self._join = join
        self._complete_rounds: set[bytes] = set()

    @property
    def is_complete(self) -> bool:
        """Return True if all arrived, or if the others are missing in enough complete rounds."""
        return self.all_arrived.is_set() or len(self._complete_rounds) >= MIN_COMPLETE_ROUNDS

    def record(self, key: str, payload: bytes) -> None:
        """Record a message that arrived."""
        if not payload.startswith(self.token):
            return
        self.keys.add(key)
        if key == self._join:
            self._complete_rounds.add(payload)
        if self.keys >= self._sent_keys:
            self.all_arrived.set()


def _unknown_identity_error(credentials: Credentials) -> str:
    name = credentials.link.name
    return (
        f"{credentials.description} may do nothing here: it was revoked or its certificate replaced; copy "
        f"the folder here again, or make one with {advised_commands().site(f'renew {name}')}"
    )


def _sentence(credentials: Credentials, verb: str, keys: list[str]) -> str:
    named = first_of(keys, MAX_KEYS)
    person = _person(keys[0])
    if person and person != credentials.link.name:
        added = advised_commands().site(f"user add {person}")
        remedy = f"use credentials of {person}, or have them added with {added}"
    else:
        remedy = "use credentials of that role, or those of the site's supervisor"
    action = f"{WORDS[verb]} {named}"
    return f"{credentials.description} may not {action}: {remedy}"


def _person(key: str) -> str:
    """Return the user in a per-user key, or `""` for other keys."""
    topic = topic_of(key)
    rows = REQUESTS if topic is None else (topic,)
    names = set[str]()
    for row in rows:
        if row.placeholder == "user":
            names.add(row.name_in(key))
    return min(names - {"", ANY}, default="")


class RestrictedBus(ZenohBus):
    """A bus that tests each right that it uses, and says which are denied: the router says nothing."""

    def __init__(self, session: zenoh.Session, link: Link, credentials: Credentials) -> None:
        """Create a bus on `session`, which the bus closes."""
        super().__init__(session, link)
        self._probe = PermissionProbe(session, credentials, self._second, lambda: self.connected)

    @property
    def problems(self) -> tuple[Problem, ...]:
        """Return that the router is lost, rights are denied or queries are rejected."""
        if self.connected:
            denials = self._probe.problems
            if denials:
                return denials
        return super().problems

    @property
    def is_restricted(self) -> bool:
        """Return True: access rules of a router apply."""
        return True

    async def denial_reason(self, verb: str, topic: AnyTopic, name: str) -> str:
        """Return the reason if a right of this identity is denied, else `""`. The test takes 2 s.

        `verb`: `writes` or `reads`. `name`: the placeholder, or `*` for any.

        Returns:
            `""` also without a router.
        """
        return await self._probe.denial_reason(verb, topic.at(name))

    async def call(
        self, request: Request[Q, R], query: Q, name: str = "", *, timeout_s: float = REQUEST_TIMEOUT_S
    ) -> R:
        """Return the reply of the server of `request`, in this process or another."""
        try:
            return await super().call(request, query, name, timeout_s=timeout_s)
        except NoAnswerError as error:
            may_be_denied = self.connected and self.exchange.handler_for(request, name) is None
            if not may_be_denied:
                raise
            denied = await self._probe.denial_reason("asks", request.at(name))
            if denied:
                raise AccessDeniedError(denied) from error
            raise

    async def close(self) -> None:
        """Close everything that was declared here, and the session."""
        await self._probe.close()
        await super().close()

    def _add_right(self, verb: str, key: str) -> None:
        self._probe.add(verb, key)

    def _on_back(self) -> None:
        self._probe.retest()

    @contextlib.asynccontextmanager
    async def _second(self) -> AsyncGenerator[zenoh.Session]:
        session = await open_session(self.link, patience_s=0.0)
        try:
            yield session
        finally:
            await close_session(session)
