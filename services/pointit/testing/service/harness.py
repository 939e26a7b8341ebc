"""Harness of a service, given by its author, and one run of the service on a bus of its own."""

import asyncio
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from types import TracebackType
from typing import Any

from pydantic import ValidationError

from pointit.plugins import Message, Query, RefusedError, Request, ServicePlugin, Topic
from pointit.runtime.bus.local_broker import LocalBroker
from pointit.runtime.bus.memory_bus import MemoryBus
from pointit.runtime.service.service import Launch, run_service
from pointit.schemas import Health
from pointit.schemas.topics import HEALTH, SERVICE_ALIVE
from pointit.testing.check import CheckFailedError, Suite
from pointit.testing.trial import DeviceHarness, Trial

LIVES_S = 0.3
"""Time for a service to process what it gets, s."""


@dataclass(frozen=True, kw_only=True)
class ServiceHarness(DeviceHarness[ServicePlugin]):
    """A service, checked on a bus within the process."""

    messages: tuple[tuple[Topic[Any], Message], ...] = ()
    """Messages that it reads, where those with default values do not exist or say too little."""
    queries: tuple[tuple[Request[Any, Any], Query], ...] = ()
    """Requests that it answers, where those with default values do not exist or say too little."""
    works: "Callable[[ServiceTrial], Awaitable[None]] | None" = None
    """Its author's own test of the running service: puts messages on `trial.bus`, and waits `until`."""

    def trial(self) -> "ServiceTrial":
        """Return a trial of the service, which has not begun."""
        return ServiceTrial(self)


SERVICE_SUITE: Suite[ServiceHarness] = Suite()


class NotedBus(MemoryBus):
    """A bus that notes the rows that are used by its service."""

    def __init__(self, broker: LocalBroker) -> None:
        super().__init__(broker)
        self.used: dict[str, set[str]] = {"reads": set(), "writes": set(), "serves": set(), "asks": set()}
        """Keys of rows by the field of `ServicePlugin` that must declare them."""

    def publisher(self, topic: Any, name: str = "") -> Any:
        """Declare a writer."""
        self.used["writes"].add(topic.key)
        return super().publisher(topic, name)

    def subscribe(self, topic: Any, *arguments: Any, **options: Any) -> Any:
        """Subscribe."""
        self.used["reads"].add(topic.key)
        return super().subscribe(topic, *arguments, **options)

    def handler(self, request: Any, server: Any, name: str) -> Any:
        """Answer a request."""
        self.used["serves"].add(request.key)
        return super().handler(request, server, name)

    async def call(self, request: Any, *arguments: Any, **options: Any) -> Any:
        """Send a request."""
        self.used["asks"].add(request.key)
        return await super().call(request, *arguments, **options)


class ServiceTrial(Trial):
    """One run of a service."""

    def __init__(self, harness: ServiceHarness) -> None:
        super().__init__(harness)
        self.harness = harness
        broker = LocalBroker()
        self.own_bus = NotedBus(broker)
        self.bus = MemoryBus(broker)
        """Bus of the check, to which the service's messages come."""
        plugin = harness.plugin
        self.user = "anna" if plugin.make.SCOPE == "user" else ""
        """Person of the service, or `""` for one of the site."""
        self._launch = Launch(service=plugin.make, config=self.config, user=self.user)
        self.present = False
        """True while the service is present, which means that it is ready."""
        self.errors = 0
        """Number of its handlers and timers that raised."""

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """End the service, and close both buses."""
        try:
            await super().__aexit__(kind, error, trace)
        finally:
            await self.own_bus.close()
            await self.bus.close()

    def make(self, config: Any) -> None:
        """Validate the parameters, which is all that may refuse them."""
        self.harness.plugin.make.validate_config(config)

    async def start(self) -> None:
        """Run the service in the background, and wait until it is ready."""
        self.bus.watch(SERVICE_ALIVE, self._on_service)
        self.bus.subscribe(HEALTH, self._on_health, self._launch.instance)
        self.task = asyncio.create_task(run_service(self._launch, self.own_bus, self.clock))
        await self.until(lambda: self.present, "it did not get ready")

    async def exchange(self, situation: str = "") -> None:
        """Do nothing: no service promises anything about its device."""

    async def live(self) -> None:
        """Put messages, send requests, and give the service some time."""
        self.put_messages()
        for request in self.harness.plugin.serves:
            await self.ask(request)
        await asyncio.sleep(LIVES_S)

    def put_messages(self) -> None:
        """Put a message of each topic that it reads, those of the harness instead where there are some."""
        given = {topic.key for topic, _ in self.harness.messages}
        now_ns = self.clock.now_ns()
        others = [
            (topic, _default(topic.message, stamp_ns=now_ns, seq=1))
            for topic in self.harness.plugin.reads
            if topic.key not in given
        ]
        for topic, message in (*self.harness.messages, *others):
            if message is not None:
                self.bus.publisher(topic, self._name(topic)).put(message)

    async def ask(self, request: Request[Any, Any]) -> None:
        """Send `request` if there is a query for it. A reply and a refusal are both answers.

        Raises:
            CheckFailedError: If there is none, or the service fails on it.
        """
        given = [query for each, query in self.harness.queries if each.key == request.key]
        query = given[0] if given else _default(request.query)
        if query is None:
            return
        try:
            await self.bus.call(request, query, self._name(request), timeout_s=self.timeout_s)
        except RefusedError as refusal:
            fault = refusal.__cause__
            if fault is not None:
                raise CheckFailedError(f"{request.key} raised {type(fault).__name__}: {fault}") from fault
        except Exception as error:
            raise CheckFailedError(f"{request.key}: {error}") from error

    def _name(self, row: Any) -> str:
        return (self.user or "anna") if row.placeholder else ""

    def _on_service(self, instance: str, present: bool) -> None:  # noqa: FBT001 - the bus's signature
        if instance == self._launch.instance:
            self.present = present

    def _on_health(self, health: Health, _instance: str) -> None:
        self.errors = health.errors


def _default(kind: Any, **fields: object) -> Any:
    """Return a message or query with default values, or None if it has none."""
    try:
        return kind(**fields)
    except ValidationError:
        return None
