"""Carriers of acts: one that reports states, targets for the service `reactions`, a program by the API."""

import asyncio
import contextlib
from collections.abc import Sequence
from typing import Any, ClassVar

from pointit.api.site import Site
from pointit.runtime.config.config import Config
from pointit.runtime.errors import PointItError
from pointit.runtime.service.carrier import Act, Carrier
from pointit.runtime.service.service import Launch, Service
from tests.simulation.kernel.process import PROCESS, Process
from tests.simulation.network.simulated_bus import SimulatedBus
from tests.simulation.world.devices import LIMIT_S, Device, SimulatedTarget

REPORT_DELAY_S = 0.02
"""Time from the change of a device until its carrier knows, s."""


class SimulatedReaction:
    """A row of `--on`: a thing and its target."""

    def __init__(self, device: Device) -> None:
        self.thing = device.thing
        self.target = SimulatedTarget(device)

    def check(self, room: Any) -> None:
        """Accept any map."""


class HomeConfig(Config):
    """No parameters."""


class Home(Service[HomeConfig]):
    """A carrier whose targets report their states, as the Home Assistant bridge does."""

    NAME = "home-assistant"
    SCOPE = "site"
    CONFIG = HomeConfig
    TIME_MAY_STEP = True
    devices: ClassVar[list[Device]] = []

    def __init__(self, config: HomeConfig, context: Any) -> None:
        """Begin to carry acts on `devices`."""
        super().__init__(config, context)
        self._carrier = Carrier(self.bus, self.clock, self.NAME)
        self._process = PROCESS.get()
        self._loop = asyncio.get_running_loop()
        self._carrier.use({each.thing: [SimulatedTarget(each)] for each in self.devices})

    async def run(self) -> None:
        """Report each change until it is cancelled."""
        for device in self.devices:
            device.on_change.append(self._on_change)
        try:
            await asyncio.Event().wait()
        finally:
            for device in self.devices:
                device.on_change.remove(self._on_change)
            await self._carrier.close()

    def _on_change(self) -> None:
        process = self._process
        if process is not None and not process.is_dead:
            self._loop.call_later(REPORT_DELAY_S, self._report, context=process.context)

    def _report(self) -> None:
        if not self.bus.is_closed:
            with contextlib.suppress(PointItError):
                self._carrier.tell()


def home_launch(devices: Sequence[Device]) -> Launch:
    """Return the launch of a carrier of `devices`."""
    Home.devices = list(devices)
    return Launch(service=Home, config=HomeConfig())


async def run_program(process: Process, bus: SimulatedBus, devices: dict[str, Device]) -> None:
    """Run a program of a user that carries acts on `devices` through the public API."""
    async with Site.on(bus, process) as site:

        async def switch(event: Any) -> None:
            await SimulatedTarget(devices[event.object_id]).carry_out(Act(event))

        site.carries(*devices, limit_s=LIMIT_S)(switch)
        await site.wait()
