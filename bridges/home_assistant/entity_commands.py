"""Calls to entities of one connection: the newest of each at a limited rate, and those of the hover.

No core: it waits for a server and keeps time.
"""

import asyncio
import contextlib
import logging
from collections import Counter
from collections.abc import Callable, Collection, Generator, Mapping
from typing import Any, NamedTuple

from pointit.bridges.home_assistant.config import HomeAssistantConfig
from pointit.bridges.home_assistant.connection import LOST, REPLY_TIMEOUT_S
from pointit.bridges.home_assistant.home_action import ServiceCall
from pointit.bridges.home_assistant.home_connection import (
    BROKER_CODE,
    ActionRefusedError,
    HomeConnection,
    NoHomeAssistantError,
)
from pointit.bridges.home_assistant.hover_feedback import (
    RESTORE_TIMEOUT_S,
    UNKNOWN,
    DimmedLights,
    HoverFeedback,
)
from pointit.runtime.bus.service_bus import ServiceBus
from pointit.runtime.errors import ConfigError, RefusedError
from pointit.runtime.host.state_file import StateFile, site_folder
from pointit.runtime.service.carrier import ActFailedError

log = logging.getLogger(__name__)

END_TIMEOUT_S = 1.0
"""Maximum time to restore lamps at the end, s."""
MAX_COMMAND_DELAY_S = 1.0
"""Time beyond the maximum latency for which a hover may delay the commands to its lamp, s."""
MAX_SLOW_CALLS = 2
"""Number of slow calls in a row after which a lamp shows no hover."""


class PendingCall(NamedTuple):
    """A call that is not sent yet."""

    call: ServiceCall
    result: asyncio.Future[None]
    check_in_time: Callable[[], None]
    """Raises ActFailedError if it must not be sent any more."""


class EntityCommands:
    """Sends calls to entities while a connection is open."""

    def __init__(
        self,
        config: HomeAssistantConfig,
        bus: ServiceBus,
        states: Callable[[str], Mapping[str, Any]],
        hovered: Callable[[], Collection[str]],
    ) -> None:
        """Continue with the lamps that an earlier process has not restored.

        Args:
            config: parameters of the service.
            bus: gets warnings.
            states: returns the state of an entity in Home Assistant, empty if it is not there.
            hovered: returns the entities that somebody hovers.
        """
        self._config = config
        self._bus = bus
        self._state_of = states
        self._hovered = hovered
        self._connection: HomeConnection | None = None
        self._pending: dict[str, PendingCall] = {}
        """Newest call of each entity that is not sent yet."""
        self._workers: dict[str, asyncio.Task[None]] = {}
        """Task of each entity to which calls are being sent."""

        # The hover. Without its file, lamps show none, and all else works.
        self._ended: set[str] = set()
        """Entities that show this hover no more: they were switched, or its time is over."""
        self._slow_calls: Counter[str] = Counter()
        """Number of slow calls in a row by lamp."""
        self._feedback: HoverFeedback | None = None
        with self._report_file_errors():
            file = site_folder(bus.site, "home-assistant") / "dimmed_lights.json"
            now_s = asyncio.get_running_loop().time
            self._feedback = HoverFeedback(StateFile[DimmedLights].at(file, DimmedLights), now_s)

    def open(self, connection: HomeConnection) -> None:
        """Send by `connection` from now on."""
        self._connection = connection

    def on_first_state(self, entity: str, state: Mapping[str, Any]) -> None:
        """Note the state of an entity that was not known on this connection."""
        if self._feedback is not None:
            with self._report_file_errors():
                self._feedback.on_first_state(entity, state)

    def on_state(self, entity: str, before: Mapping[str, Any], state: Mapping[str, Any]) -> None:
        """Note a change of the state of an entity."""
        if self._feedback is not None:
            with self._report_file_errors():
                self._feedback.on_state(entity, before, state)

    async def close(self, connection: HomeConnection, *, is_lost: bool) -> None:
        """Stop, and restore all lamps unless the connection is lost."""
        self._connection = None
        workers = list(self._workers.values())
        for worker in workers:
            worker.cancel()
        await asyncio.gather(*workers, return_exceptions=True)
        self._workers.clear()  # one that was cancelled before its first step is still there
        for pending in self._pending.values():
            pending.result.cancel()
        self._pending.clear()
        if not is_lost:
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(END_TIMEOUT_S):
                    await asyncio.gather(*(self._restore_at_end(connection, lamp) for lamp in self.dimmed))
        if self._feedback is not None:
            self._feedback.reset()

    async def run(self, call: ServiceCall, check_in_time: Callable[[], None]) -> None:
        """Send `call`, instead of one of the same entity that waits. Return when Home Assistant has run it.

        `check_in_time` is called before it is sent, as in `Act`.

        Raises:
            ActFailedError: If it was not run. A sentence with the remedy.
        """
        if self._connection is None:
            raise ActFailedError("unavailable", LOST)

        # Only the newest call of an entity is sent
        earlier = self._pending.get(call.entity)
        if earlier is not None and not earlier.result.done():
            earlier.result.set_exception(replaced_act(call.entity))
        result: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        pending = PendingCall(call, result, check_in_time)
        self._pending[call.entity] = pending
        self._ended.add(call.entity)
        self.wake(call.entity)

        # `close` cancels the result, which is no cancellation of the caller
        try:
            await result
        except asyncio.CancelledError:
            if not result.cancelled() or self._connection is not None:
                raise
            raise ActFailedError("unavailable", LOST) from None
        finally:
            if self._pending.get(call.entity) is pending:
                del self._pending[call.entity]

    def check(self) -> None:
        """Look at all lamps that show a hover or shall show it. Called periodically."""
        hovered = set(self._hovered())
        if self._feedback is not None:
            self._ended |= set(filter(self._feedback.is_over, hovered))
        self._ended &= hovered
        for entity in {*self.dimmed, *hovered}:
            self.wake(entity)

    def wake(self, entity: str) -> None:
        """Send what there is to send to an entity, unless that is being done."""
        if self._connection is None or entity in self._workers:
            return
        work = self._send_calls(self._connection, entity)
        self._workers[entity] = asyncio.create_task(work, name=f"calls to {entity}")

    @property
    def dimmed(self) -> tuple[str, ...]:
        """Return the lamps that are not restored yet."""
        return self._feedback.entities if self._feedback is not None else ()

    async def _send_calls(self, connection: HomeConnection, entity: str) -> None:
        """Send calls to an entity, at a limited rate, until it is as it shall be."""
        try:
            while await self._send_next(connection, entity):  # noqa: ASYNC110 - no wait, a rate
                await asyncio.sleep(1.0 / self._config.rate_hz)
        except NoHomeAssistantError:  # the connection is opened again
            return
        finally:  # at once: what is woken now needs another task
            self._workers.pop(entity, None)

    async def _send_next(self, connection: HomeConnection, entity: str) -> bool:
        """Send the next call to an entity. Return False if there is none."""
        if entity in self._pending:
            await self._send_pending(connection, entity)
            return True
        is_slow = self._slow_calls[entity] >= MAX_SLOW_CALLS
        shows_hover = entity not in self._ended and not is_slow
        if shows_hover and entity in self._hovered():
            return await self._show_hover(connection, entity)
        return await self._restore(connection, entity)

    async def _send_pending(self, connection: HomeConnection, entity: str) -> None:
        """Send the call that waits, and set its result."""
        await self._restore(connection, entity)  # first: the lamp has its brightness when it is on
        if entity not in self._pending:  # its time was over meanwhile
            return
        call, result, check_in_time = self._pending.pop(entity)

        # Its caller may have gone: the result is set only if somebody waits for it
        try:
            check_in_time()
            await connection.call(call)
        except ActFailedError as error:  # it is too late
            if not result.done():
                result.set_exception(error)
        except (RefusedError, TimeoutError, NoHomeAssistantError) as error:
            if not result.done():
                result.set_exception(_failure(call, error))
        except asyncio.CancelledError:
            result.cancel()
            raise
        if not result.done():
            result.set_result(None)

    async def _show_hover(self, connection: HomeConnection, entity: str) -> bool:
        """Show the hover on a lamp. Return False if it shows it already, or cannot."""
        call = None
        if self._feedback is not None:
            with self._report_file_errors():
                call = self._feedback.begin(entity, self._state_of(entity))
        if call is None:
            return False
        self._bus.clear("hover")
        loop = asyncio.get_running_loop()
        begin_s = loop.time()
        limit_s = self._config.max_hover_latency_s
        await self._send_brightness(connection, call, limit_s + MAX_COMMAND_DELAY_S)
        latency_s = loop.time() - begin_s
        # One that is slow several times in a row delays commands too much
        slow_calls = 0
        if latency_s > limit_s:
            slow_calls = self._slow_calls[entity] + 1
        self._slow_calls[entity] = slow_calls
        if slow_calls == MAX_SLOW_CALLS:
            log.warning(
                "%s takes %.1f s, limit %g s: it shows no hover; raise `max_hover_latency_s` to use it",
                entity,
                latency_s,
                limit_s,
            )
        return True

    async def _restore_at_end(self, connection: HomeConnection, entity: str) -> None:
        """Restore a lamp, and erase what is stored once its state shows that."""
        with contextlib.suppress(NoHomeAssistantError):
            while await self._restore(connection, entity, timeout_s=0.0):  # noqa: ASYNC110 - a rate, no wait
                await asyncio.sleep(1.0 / self._config.rate_hz)

    async def _restore(
        self, connection: HomeConnection, entity: str, *, timeout_s: float = RESTORE_TIMEOUT_S
    ) -> bool:
        """Give a lamp its brightness of before the hover. Return False if it has it, or is off now."""
        call = None
        if self._feedback is not None:
            with self._report_file_errors():
                call = self._feedback.end(entity, self._state_of(entity), timeout_s=timeout_s)
        if call is None:
            return False
        await self._send_brightness(connection, call, REPLY_TIMEOUT_S)
        return True

    async def _send_brightness(self, connection: HomeConnection, call: ServiceCall, timeout_s: float) -> None:
        """Send a call of the hover. If it fails, the state of the lamp shows the result."""
        context = UNKNOWN
        with contextlib.suppress(RefusedError, TimeoutError):
            async with asyncio.timeout(timeout_s):
                context = await connection.call(call)
        if self._feedback is not None:
            with self._report_file_errors():
                self._feedback.on_result(call, context)

    @contextlib.contextmanager
    def _report_file_errors(self) -> Generator[None]:
        """Report a file that cannot be read or written."""
        try:
            yield
        except ConfigError as error:
            self._bus.warn("hover", f"lamps show no hover: {error}")


def replaced_act(entity: str) -> ActFailedError:
    """Return the failure of an act that a newer one on the same entity has replaced."""
    return ActFailedError("replaced", f"another act on {entity} came before it was done")


def _failure(call: ServiceCall, error: Exception) -> ActFailedError:
    """Return the sentence on an action that Home Assistant has not run, with the remedy."""
    action = f"{call.domain}.{call.service}"
    if isinstance(error, NoHomeAssistantError):
        return ActFailedError("unavailable", str(error))
    if isinstance(error, TimeoutError):
        return ActFailedError("no_answer", f"Home Assistant did not answer to {action} on {call.entity}")
    code = error.code if isinstance(error, ActionRefusedError) else ""
    if code == "unauthorized":
        return ActFailedError(
            "refused",
            f"this token's user may not switch {call.entity} in Home Assistant: use another user's token",
        )
    if code == BROKER_CODE:
        return ActFailedError("refused", str(error))
    if code == "not_found":
        return ActFailedError("refused", f"Home Assistant has no action {action}: correct it in the map")
    return ActFailedError("refused", f"Home Assistant refuses {action} on {call.entity} ({error})")
