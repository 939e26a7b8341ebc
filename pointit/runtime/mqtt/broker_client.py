"""A connection to an MQTT broker, whose answers are read: each refusal is an error with its remedy.

aiomqtt ignores the codes by which a broker refuses a subscription or a publication, and does not tell by whom
a connection was ended.
"""

import asyncio
import contextlib
from collections.abc import Awaitable, Collection, Sequence
from typing import TYPE_CHECKING, Any, Self, TypeVar

from pointit.schemas.text import first_of, one_line

if TYPE_CHECKING:
    import aiomqtt

T = TypeVar("T")

SOON_S = 5.0
"""Time after a connection within which its end looks like a refusal, s."""
MAX_SHOWN_TOPICS = 3
"""Maximum number of topics in a sentence."""
MAX_REASON = 100
"""Maximum number of characters of a broker's reason in a sentence."""
TAKEN_OVER = 142
"""Reason code of MQTT 5: another client has connected with the same identifier."""
NO_WILDCARDS = (143, 162)
"""Reason codes of MQTT 5 for filters with wildcards that a broker does not support."""
QUOTA = 151
"""Reason code of MQTT 5: a limit of the broker is reached."""


class BrokerError(OSError):
    """A broker cannot be connected to, or refuses something. The text has the cause and the remedy."""


class RefusedTopicsError(BrokerError):
    """The broker refuses subscriptions, or a publication. The connection stays."""

    def __init__(self, text: str, topics: Sequence[str]) -> None:
        """`topics`: filters or topics that are refused."""
        super().__init__(text)
        self.topics = tuple(topics)


class ClosedByBrokerError(BrokerError):
    """The broker has ended the connection, or it was lost."""


class BrokerMessages:
    """Messages of the topics that are subscribed to, without end."""

    def __init__(self, connection: "BrokerClient", messages: "aiomqtt.client.MessagesIterator") -> None:
        self._connection = connection
        self._messages = messages

    def __aiter__(self) -> Self:
        """Return the iterator itself."""
        return self

    async def __anext__(self) -> "aiomqtt.Message":
        """Return the next message.

        Raises:
            ClosedByBrokerError: If the connection is lost.
        """
        from aiomqtt import MqttError  # noqa: PLC0415 - an extra

        try:
            return await anext(self._messages)
        except MqttError as error:
            self._connection.check(error)
            raise


class BrokerClient:
    """A connection to a broker, on which calls raise what the broker answers."""

    def __init__(self, client: "aiomqtt.Client", user: str, session_hint: str = "") -> None:
        """Listen to what ends the connection of `client`, which is not connected yet.

        Args:
            client: the client of the library.
            user: name by which it logs in, or `""`.
            session_hint: remedy if the broker permits one connection for each user or identifier only.
        """
        self._library = client
        self._client: Any = client._client  # noqa: SLF001 - aiomqtt has no other way
        self._user = f"user {user}" if user else "clients without a user name"
        self._session_hint = session_hint or "give PointIt a user name of its own there"
        self._loop = asyncio.get_running_loop()
        self._begin_s = self._loop.time()
        self._last_action = ""
        """Words for the newest request to the broker, for the sentence of a connection that ends."""
        self._closed: asyncio.Future[None] = self._loop.create_future()
        self._end_reason: Any = None
        """Reason code by which the broker has ended the connection, or None."""
        self._published: dict[int, str] = {}
        """Topics of the messages that wait for an acknowledgement, by their numbers."""
        self._refusals: dict[str, Any] = {}
        """Reason codes of refused publications, by topic."""
        self._listen()

    @property
    def messages(self) -> BrokerMessages:
        """Return the messages that arrive from now on."""
        return BrokerMessages(self, self._library.messages)

    def check(self, cause: BaseException | None = None) -> None:
        """Check that the connection is still there.

        Args:
            cause: the error by which aiomqtt reports that it is not, if any.

        Raises:
            ClosedByBrokerError: If the broker has ended it, or it was lost.
        """
        if self._closed.done():
            raise self._closed_error() from cause

    async def subscribe(self, topics: str | Sequence[tuple[str, int]], optional: Collection[str] = ()) -> str:
        """Subscribe to `topics`: one filter, or several, each with its quality of service.

        Return an error message if the broker refuses some of `optional`, filters that the caller can do
        without, else `""`.

        Raises:
            RefusedTopicsError: If the broker refuses others. Those that it permits are subscribed to.
            ClosedByBrokerError: If the connection is lost.
        """
        if isinstance(topics, str):
            topics = [(topics, 0)]
        filters = [topic_filter for topic_filter, _qos in topics]
        self._last_action = f"subscribed to {first_of(filters, MAX_SHOWN_TOPICS)}"
        subscribing = self._library.subscribe([*topics])
        codes: Sequence[Any] = await self.answer(subscribing)
        results = zip(filters, codes, strict=False)
        refused = {topic_filter: code for topic_filter, code in results if code.is_failure}
        if not refused:
            return ""
        error = self._subscription_error(refused)
        if any(topic_filter not in optional for topic_filter in refused):
            raise error
        return str(error)

    async def unsubscribe(self, filters: Sequence[str]) -> None:
        """Unsubscribe from `filters`. Raises ClosedByBrokerError if the connection is lost."""
        await self.answer(self._library.unsubscribe([*filters]))

    async def publish(
        self,
        topic: str,
        payload: bytes | str,
        *,
        qos: int = 1,
        retain: bool = False,
        timeout: float | None = None,  # noqa: ASYNC109 - as aiomqtt has it
    ) -> None:
        """Publish, and wait for the broker's acknowledgement.

        A broker of MQTT 3.1.1 cannot refuse: it drops what it does not permit.

        Raises:
            RefusedTopicsError: If the broker refuses it.
            ClosedByBrokerError: If the connection is lost.
            aiomqtt.MqttError: If no acknowledgement comes within `timeout` s.
        """
        self._last_action = f"published to {topic}"
        await self.answer(self._library.publish(topic, payload, qos=qos, retain=retain, timeout=timeout))
        # aiomqtt ignores the code of the acknowledgement: `_listen` has read it
        code = self._refusals.pop(topic, None)
        if code is not None:
            problem = f"the broker does not let {self._user} publish to {topic} ({code})"
            raise RefusedTopicsError(f"{problem}: permit it in the broker's access list", [topic])

    async def answer(self, call: Awaitable[T]) -> T:
        """Return the result of a call of aiomqtt, unless the connection ends first.

        aiomqtt waits by `asyncio.wait_for`, which loses a cancellation before Python 3.12. So the call is a
        task of its own.

        Raises:
            ClosedByBrokerError: If the connection is lost.
            aiomqtt.MqttError: If no answer comes.
        """
        from aiomqtt import MqttError  # noqa: PLC0415 - an extra

        task = asyncio.ensure_future(call)
        try:
            await asyncio.wait((task, self._closed), return_when=asyncio.FIRST_COMPLETED)
        finally:
            is_answered = task.done()
            if not is_answered:
                task.cancel()
        # Cancelled by the caller: that error goes on. Otherwise the connection has ended.
        if not is_answered:
            raise self._closed_error()
        try:
            return task.result()
        except MqttError as error:
            self.check(error)
            raise

    def _listen(self) -> None:
        """Read the codes that aiomqtt ignores, before it gets them."""
        paho = self._client
        on_disconnect = paho.on_disconnect
        on_publish = paho.on_publish
        publish = paho.publish

        def listen_to_end(client: Any, data: Any, flags: Any, code: Any, properties: Any) -> None:
            if flags.is_disconnect_packet_from_server:
                self._end_reason = code
            on_disconnect(client, data, flags, code, properties)
            with contextlib.suppress(asyncio.InvalidStateError):
                self._library._disconnected.exception()  # noqa: SLF001 - else asyncio logs it if nobody waits
            if not self._closed.done():
                self._closed.set_result(None)

        def number_message(topic: str, *arguments: Any, **options: Any) -> Any:
            info = publish(topic, *arguments, **options)
            self._published[info.mid] = topic
            return info

        def listen_to_refusal(client: Any, data: Any, number: int, code: Any, properties: Any) -> None:
            topic = self._published.pop(number, "")
            if code.is_failure:
                self._refusals[topic] = code
            on_publish(client, data, number, code, properties)

        # paho looks them up at each call, so aiomqtt's own ones are wrapped on the object
        paho.on_disconnect = listen_to_end
        paho.publish = number_message
        paho.on_publish = listen_to_refusal

    def _subscription_error(self, refused: dict[str, Any]) -> RefusedTopicsError:
        names = first_of(refused, MAX_SHOWN_TOPICS)
        code = next(iter(refused.values()))
        remedy = "permit it in the broker's access list"
        if code.value in NO_WILDCARDS:
            remedy = "permit wildcards in topics at the broker"
        elif code.value == QUOTA:
            remedy = "raise the broker's limit of subscriptions"
        # of MQTT 3.1.1 there is one code, for which paho's words say nothing
        reason = "" if code.value == 128 else f" ({code})"
        problem = f"the broker does not let {self._user} subscribe to {names}{reason}"
        text = f"{problem}: {remedy}"
        return RefusedTopicsError(text, [*refused])

    def _closed_error(self) -> ClosedByBrokerError:
        """Return the reason for which the connection has ended, with the remedy."""
        code = self._end_reason
        if code is not None and code.value == TAKEN_OVER:
            return ClosedByBrokerError(
                "another client has taken over the session at the broker, which permits one connection for "
                f"each user name or client identifier: {self._session_hint}"
            )
        after_s = self._loop.time() - self._begin_s
        action = f", after PointIt had {self._last_action}" if self._last_action else ""
        if code is not None:
            reason = one_line(str(code), MAX_REASON)
            return ClosedByBrokerError(
                f"the broker has ended the connection ({reason}){action}: look into the broker's log"
            )
        if after_s < SOON_S:
            permit = "permit that in the broker's access list; " if action else ""
            duration = f"{after_s:.1f} s"
            return ClosedByBrokerError(
                f"the broker has closed the connection {duration} after it had accepted it{action}: "
                f"{permit}if it permits one connection for each user name or client identifier, "
                f"{self._session_hint}"
            )
        return ClosedByBrokerError(
            "the connection to the broker was lost: look at the broker, and at the network to it"
        )
