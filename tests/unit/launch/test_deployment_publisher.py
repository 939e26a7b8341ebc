"""Deployment that a run publishes, and withdraws when it is asked to end."""

import time

from pointit.launch.plan.plan import Plan
from pointit.launch.run.deployment_publisher import DeploymentPublisher
from pointit.runtime.bus.local_broker import LocalBroker
from pointit.runtime.bus.memory_bus import MemoryBus
from pointit.runtime.link.link import Link
from pointit.runtime.service.service import Launch
from pointit.schemas import Deployment, ExpectedService
from pointit.schemas.topics import DEPLOYMENT
from pointit.services.pointing.service import Pointing
from tests.support.bench import until

PLAN = Plan(name="anna", person="anna", launches=(), link=Link())
LINES = [(Launch(service=Pointing, config=Pointing.CONFIG(), user="anna"), ("pointit", "user", "anna"))]
AWAY_NS = 10**9


def posted(bus: MemoryBus) -> tuple[DeploymentPublisher, list[Deployment]]:
    """Tell of anna's run; return what tells it, and all that is told under her name."""
    told: list[Deployment] = []
    bus.subscribe(DEPLOYMENT, lambda deployment, _name: told.append(deployment), "anna")
    notice = DeploymentPublisher(bus)
    notice.post(PLAN, LINES)
    return notice, told


def other(stamp_ns: int) -> Deployment:
    services = (ExpectedService(service="pointing", user="anna", command=("elsewhere",)),)
    return Deployment(stamp_ns=stamp_ns, name="anna", services=services)


async def test_who_is_asked_to_end_takes_it_back() -> None:
    bus = MemoryBus(LocalBroker())
    notice, told = posted(bus)
    await until(lambda: len(told) == 1, what="the run")
    notice.retract()
    await until(lambda: len(told) == 2, what="its end")
    assert [len(each.services) for each in told] == [1, 0]
    notice.retract()
    await bus.close()


async def test_what_another_has_told_since_is_not_taken_back() -> None:
    bus = MemoryBus(LocalBroker())
    notice, told = posted(bus)
    bus.publisher(DEPLOYMENT, "anna").put(other(time.time_ns() + AWAY_NS))
    await until(lambda: bool(told) and told[-1].services[0].command == ("elsewhere",), what="the other one")
    later: list[str] = []
    bus.subscribe(DEPLOYMENT, lambda _deployment, name: later.append(name), "ben")
    notice.retract()
    bus.publisher(DEPLOYMENT, "ben").put(other(0))
    await until(lambda: bool(later), what="what is told after it")
    assert all(each.services for each in told)
    await bus.close()


async def test_what_one_that_began_earlier_tells_changes_nothing() -> None:
    bus = MemoryBus(LocalBroker())
    notice, told = posted(bus)
    bus.publisher(DEPLOYMENT, "anna").put(other(0))
    await until(lambda: told[-1:] == [other(0)], what="the other one")
    notice.retract()
    await until(lambda: not told[-1].services, what="its end")
    await bus.close()
