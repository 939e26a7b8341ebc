"""Publishes the deployment of a run: scenario, services and the commands that restart them.

A run that ends on purpose publishes that nothing is expected to run any more. The deployment of a run that
dies is retained, and `doctor` reports what is missing.
"""

import time
from collections.abc import Sequence

from pointit.launch.plan.plan import Plan
from pointit.runtime.bus.contract import Bus, Closable, Publisher
from pointit.runtime.service.service import Launch
from pointit.schemas import Deployment, ExpectedService
from pointit.schemas.system import RUN
from pointit.schemas.topics import DEPLOYMENT

Line = tuple[Launch, tuple[str, ...]]
"""A service, and the command that restarts it."""


class DeploymentPublisher:
    """Publishes the deployment of the current run; there is one at a time."""

    def __init__(self, bus: Bus) -> None:
        self._bus = bus
        self._name = ""
        self._publisher: Publisher[Deployment] | None = None
        self._subscription: Closable | None = None
        self._stamp_ns = 0
        """Stamp of the last published deployment."""
        self._is_anothers = False
        """Another process has published under the same name since then."""

    def post(self, plan: Plan, lines: Sequence[Line]) -> None:
        """Publish the services of `plan`, which replaces the last deployment."""
        name = plan.name if plan.person else f"{RUN}{plan.name}"
        if self._publisher is None or self._name != name:
            self.retract()
            self._publisher, self._name = self._bus.publisher(DEPLOYMENT, name), name
            self._subscription = self._bus.subscribe(DEPLOYMENT, self._on_deployment, name, kept=False)
        self._stamp_ns, self._is_anothers = time.time_ns(), False
        services = tuple(
            ExpectedService(service=launch.service.NAME, user=launch.user, name=launch.name, command=command)
            for launch, command in lines
        )
        self._publisher.put(
            Deployment(
                stamp_ns=self._stamp_ns,
                name=plan.name,
                services=services,
                scenario=plan.scenario,
                scenarios=tuple(plan.scenarios),
                localizes=plan.localizes,
                target_kinds=tuple(plan.target_kinds),
            )
        )

    def retract(self) -> None:
        """Publish that nothing should run any more, unless another process has taken over the name."""
        publisher, self._publisher = self._publisher, None
        if publisher is not None:
            if not self._is_anothers:
                publisher.put(Deployment(stamp_ns=time.time_ns(), name=self._name))
            publisher.close_nowait()
        if self._subscription is not None:
            self._subscription.close()
            self._subscription = None

    def _on_deployment(self, deployment: Deployment, _name: str) -> None:
        self._is_anothers |= deployment.stamp_ns > self._stamp_ns
