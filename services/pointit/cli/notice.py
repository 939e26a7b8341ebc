"""What a run tells the site of itself: which scenario, which services, what starts them again."""

import time
from collections.abc import Sequence

from pointit.cli.plan import Plan
from pointit.runtime import Bus, Launch
from pointit.runtime.bus import Publisher
from pointit.schemas import Deployment, ExpectedService
from pointit.schemas.topics import DEPLOYMENT

Line = tuple[Launch, tuple[str, ...]]
"""A service, and the command that starts it again."""


class Notice:
    """The deployment of what runs now; there is one at a time."""

    def __init__(self, bus: Bus) -> None:
        self._bus = bus
        self._name = ""
        self._publisher: Publisher[Deployment] | None = None

    def post(self, plan: Plan, lines: Sequence[Line]) -> None:
        """Tell what `plan` runs, in place of what was told before."""
        if self._publisher is None or self._name != plan.name:
            self.take_down()
            self._publisher, self._name = self._bus.publisher(DEPLOYMENT, plan.name), plan.name
        services = tuple(
            ExpectedService(service=launch.service.NAME, user=launch.user, command=command)
            for launch, command in lines
        )
        self._publisher.put(
            Deployment(
                stamp_ns=time.time_ns(),
                name=plan.name,
                services=services,
                scenario=plan.scenario,
                scenarios=tuple(plan.scenarios),
                localizes=plan.localizes,
            )
        )

    def take_down(self) -> None:
        """Tell nobody any more who comes from now on."""
        publisher, self._publisher = self._publisher, None
        if publisher is not None:
            publisher.retire()
