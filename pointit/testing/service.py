"""The contract of services."""

import asyncio
from types import TracebackType
from typing import Any

from pydantic import ValidationError

from pointit.plugins import ConfigError, Message, Query, RefusedError, Request, Topic
from pointit.runtime.bus.memory_bus import LocalBroker, MemoryBus
from pointit.runtime.service.service import Launch, run_service
from pointit.schemas import Health
from pointit.schemas.topics import ACCOUNTS, CLOCK, HEALTH, SERVICE_ALIVE
from pointit.testing.contract import CheckFailedError, promise, require
from pointit.testing.trial import DeviceContract, Trial

LIVES_S = 0.3
"""Time for a service to process what it gets, s."""
MESSAGES = 50
HEALTH_S = 1.1
"""Time in which a service reports its health once, s."""
SYSTEM = {CLOCK.key, *(topic.key for topic in ACCOUNTS)}
"""Topics that every service uses."""


class NotedBus(MemoryBus):
    """A bus that notes the rows that are used by its service."""

    def __init__(self, broker: LocalBroker) -> None:
        super().__init__(broker)
        fields = ("reads", "writes", "serves", "asks")
        self.used: dict[str, set[str]] = {field: set() for field in fields}
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

    def __init__(self, contract: "ServiceContract") -> None:
        super().__init__(contract)
        self.contract = contract
        broker = LocalBroker()
        self.own_bus = NotedBus(broker)
        self.bus = MemoryBus(broker)
        """Bus of the check, to which the service's messages come."""
        plugin = contract.plugin
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
        self.contract.plugin.make.validate_config(config)

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
        for request in self.contract.plugin.serves:
            await self.ask(request)
        await asyncio.sleep(LIVES_S)

    def put_messages(self) -> None:
        """Put a message of each topic that it reads, those of the contract instead where there are some."""
        given = {topic.key for topic, _ in self.contract.messages}
        now_ns = self.clock.now_ns()
        others: list[tuple[Any, Any]] = []
        for topic in self.contract.plugin.reads:
            if topic.key not in given:
                others.append((topic, _default(topic.message, stamp_ns=now_ns, seq=1)))
        for topic, message in (*self.contract.messages, *others):
            if message is not None:
                self.bus.publisher(topic, self._name(topic)).put(message)

    async def ask(self, request: Request[Any, Any]) -> None:
        """Send `request` if there is a query for it. A reply and a refusal are both answers.

        Raises:
            CheckFailedError: If there is none, or the service fails on it.
        """
        queries = [query for row, query in self.contract.queries if row.key == request.key]
        query = queries[0] if queries else _default(request.query)
        if query is None:
            return
        try:
            await self.bus.call(request, query, self._name(request), timeout_s=self.timeout_s)
        except RefusedError as refusal:
            fault = refusal.__cause__
            if fault is not None:
                problem = f"{type(fault).__name__}: {fault}"
                raise CheckFailedError(f"{request.key} raised {problem}") from fault
        except Exception as error:
            raise CheckFailedError(f"{request.key}: {error}") from error

    def _name(self, row: Any) -> str:
        if not row.placeholder:
            return ""
        return self.user or "anna"

    def _on_service(self, instance: str, *, present: bool) -> None:
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


class ServiceContract(DeviceContract):
    """Promises of a service, on a bus within the process."""

    messages: tuple[tuple[Topic[Any], Message], ...] = ()
    """Messages that it reads, where those with default values do not exist or say too little."""
    queries: tuple[tuple[Request[Any, Any], Query], ...] = ()
    """Requests that it answers, where those with default values do not exist or say too little."""

    async def works(self, trial: ServiceTrial) -> None:
        """Test the running service: put messages on `trial.bus`, and wait `until`. Its author's own test."""

    def trial(self) -> ServiceTrial:
        """Return a trial of the service, which has not begun."""
        return ServiceTrial(self)

    @promise()
    async def test_works(self) -> None:
        """Answers the requests that it serves, takes many messages, and passes its author's own test."""
        async with self.trial() as trial:
            await trial.begin()
            for request in self.plugin.serves:
                await trial.ask(request)
            for _ in range(MESSAGES):
                trial.put_messages()
                await asyncio.sleep(0)
            # errors of handlers are known by the next health report
            await asyncio.sleep(HEALTH_S)
            remedy = "Handle every message that its type allows; what a handler raises is logged"
            require(not trial.errors, f"{trial.errors} of its handlers or timers raised", remedy)
        async with self.trial() as trial:
            await trial.begin()
            await self.works(trial)

    @promise()
    async def test_uses_declared_rows(self) -> None:
        """Uses only topics and requests that it declares, and that it may declare."""
        try:
            self.plugin.check(self.plugin.make.NAME)
        except ConfigError as error:
            raise CheckFailedError(str(error)) from error
        async with self.trial() as trial:
            await trial.begin()
            await trial.live()
            await self.works(trial)
            for field, keys in trial.own_bus.used.items():
                declared = {row.key for row in getattr(self.plugin, field)}
                extra = ", ".join(sorted(keys - declared - SYSTEM))
                problem = f"`{field}` does not name {extra}, which it uses"
                require(not extra, problem, "A secured site allows only what the plug-in names")
