"""A selector, a carrier and a lamp on one bus in virtual time: each of the two ends, and starts again."""

import asyncio
import contextlib
from collections.abc import AsyncGenerator, Generator
from contextlib import asynccontextmanager

from pointit.runtime.bus.memory_bus import LocalBroker, MemoryBus
from pointit.runtime.errors import RefusedError
from pointit.runtime.service.carrier import Act, Carrier
from pointit.runtime.virtual_time import VirtualClock
from pointit.schemas import ClearSelection, Environment, SetThing, Thing, ThingState, topics
from pointit.services.pui.tracked_objects import TRACKER, listing
from pointit.services.selector.service import Selector
from tests.support.bench import Bench, repeated, until

ROOM = Environment(
    stamp_ns=1,
    name="shop",
    things=(
        Thing(id="lamp", mode="switch", center_m=(1.0, 2.0, 1.0), size_m=(0.2, 0.2, 0.2)),
        Thing(id="bell", center_m=(2.0, 2.0, 1.0), size_m=(0.2, 0.2, 0.2)),
    ),
)
LIST_PERIOD_S = 0.1


class Device:
    """A lamp or a bell. It outlives its carrier, and may report no state, as programs and webhooks do."""

    def __init__(self, *, reports: bool = True, takes_s: float = 0.0) -> None:
        self.is_on = False
        self.reports = reports
        self.takes_s = takes_s
        self.acts: list[bool] = []

    @property
    def state(self) -> ThingState:
        state = ThingState(id="", limit_s=5.0)
        if not self.reports:
            return state
        return state.model_copy(update={"state": "on" if self.is_on else "off"})

    async def carry_out(self, act: Act) -> None:
        await asyncio.sleep(self.takes_s)
        act.check_in_time()
        self.acts.append(act.on)
        self.is_on = act.on


@contextlib.contextmanager
def refusals_as_text() -> Generator[list[str]]:
    """Put the reason of a refused request in the list."""
    reasons: list[str] = []
    try:
        yield reasons
    except RefusedError as error:
        reasons.append(f"refused: {error}")


class Shop:
    """The devices, their carrier `home`, and a selector; all that it tells."""

    def __init__(self, broker: LocalBroker, **devices: Device) -> None:
        self.broker = broker
        self.bench = bench = Bench(MemoryBus(broker), VirtualClock())
        self.bus = bench.bus
        self.devices = devices
        self.events = bench.collect(topics.SELECTION_EVENTS)
        self.outcomes = bench.collect(topics.OUTCOMES)
        self.selections = bench.collect(topics.SELECTION)
        self._carrier: tuple[Carrier, MemoryBus] | None = None
        self._selector = bench.start(Selector)

    def list_things(self) -> None:
        """List the things as pui does."""
        self.bench.put(topics.OBJECTS, listing(ROOM, self.bench.clock.now_ns()), TRACKER)

    def start_carrier(self) -> None:
        bus = MemoryBus(self.broker)
        carrier = Carrier(bus, self.bench.clock, "home")
        carrier.use({name: [device] for name, device in self.devices.items()})
        self._carrier = carrier, bus

    async def kill_carrier(self) -> None:
        """End its session, so that it takes no leave."""
        if self._carrier is None:
            return
        carrier, bus = self._carrier
        self._carrier = None
        await bus.close()
        await carrier.close()

    async def end_selector(self) -> None:
        await self.bench.end(self._selector)

    async def start_selector(self) -> None:
        """Start a selector, and wait until it answers."""
        told = len(self.selections)
        self._selector = self.bench.start(Selector)
        await until(lambda: len(self.selections) > told)

    async def set(self, thing: str, *, on: bool | None = None, user: str = "anna") -> str:
        with refusals_as_text() as refusal:
            return (await self.bus.call(topics.SET_THING, SetThing(thing=thing, on=on), user)).message
        return refusal[0]

    async def clear(self, user: str = "anna") -> str:
        with refusals_as_text() as refusal:
            return (await self.bus.call(topics.CLEAR_SELECTION, ClearSelection(), user)).message
        return refusal[0]

    @property
    def selected(self) -> list[str]:
        return [one.id for one in self.selections[-1].objects]


@asynccontextmanager
async def shop(*, has_carrier: bool = True, **devices: Device) -> AsyncGenerator[Shop]:
    made = Shop(LocalBroker(), **devices)
    made.bench.put(topics.MAP, ROOM)
    if has_carrier:
        made.start_carrier()
    async with repeated(LIST_PERIOD_S, made.list_things):
        await asyncio.sleep(1.0)
        try:
            yield made
        finally:
            await made.kill_carrier()
            await made.bench.stop()
            await made.bus.close()
