"""The world of a simulated site: machines, devices, and units of services that start, die and end."""

import asyncio
import functools
from collections.abc import Awaitable, Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from random import Random

from pointit.launch.plan.launches import Choices, shard_launches, site_launches, user_launches
from pointit.launch.plan.plan import read_scenario
from pointit.runtime.host.state_file import using_state_directory
from pointit.runtime.service.service import Launch, run_services
from pointit.services.reactions import service as reactions_service
from tests.simulation.kernel.process import Host, Process
from tests.simulation.kernel.simulation import Simulation
from tests.simulation.network.network import Network
from tests.simulation.network.simulated_bus import SimulatedBus
from tests.simulation.world.carriers import SimulatedReaction, home_launch, run_program
from tests.simulation.world.devices import DEVICES, Device
from tests.simulation.world.operator import Operator
from tests.simulation.world.room import MAP, PEOPLE, SCENARIO

RESTART_S = 2.0
TASKS_LEFT_S = 1.0
"""Time after the end of a process at which none of its tasks may be left, s."""
FAR_SERVICES = ("reactions", "led-driver")
"""Services that run on the machine `far`, as does `home-assistant`. Others of the site run on `hub`."""
PROGRAM_THINGS = ("radio", "kettle", "bolts")
PROGRAM_PREFIX = "switch-"
"""Begin of the carrier's name of the program: that of its function."""

Run = Callable[[Process, SimulatedBus], Awaitable[object]]


@dataclass
class Plan:
    """All that a seed decides, but its faults."""

    seed: int
    people: int
    layout: str
    """`one` process for all services of the site, one for each of `persons`, or one for `each` service."""
    method: str
    """The selector's method."""
    rate_hz: float
    """Rate of the people's wrists, Hz."""
    has_shard: bool
    faults_s: float
    """Time in which faults begin, s."""
    calm_s: float
    """Time from the end of all faults to the checks at rest, s."""
    home_latency_s: float
    operator_period_s: float
    fail_share: float = 0.0
    """Share of acts at which a device fails, also without a fault."""
    late_share: float = 0.0
    """Share of acts for which a device takes longer than their limit."""
    by_hand_period_s: float = 0.0
    """Mean time from one switching by hand to the next, s. 0: nobody does."""


@dataclass(eq=False)
class Unit:
    """Services that share a process, and that process while it runs."""

    name: str
    host: Host
    run: Run
    user: str = ""
    """The person whose services these are, or `""`."""
    is_wanted: bool = True
    process: Process | None = None
    bus: SimulatedBus | None = None
    is_told_to_end: bool = False
    restart_s: float = RESTART_S
    """Time after which it is started again when it was killed, s."""


EndObserver = Callable[[Unit, BaseException | None], object]
"""Called with a unit that ended by itself, and the error."""
TasksObserver = Callable[[Unit, list[str]], object]
"""Called with a unit that has ended, and the names of tasks that it has left."""


class World:
    """A whole site on simulated machines."""

    def __init__(self, simulation: Simulation, network: Network, plan: Plan, folder: Path) -> None:
        """Create without starting. `folder` gets the map and the machines' states."""
        self.simulation = simulation
        self.network = network
        self.plan = plan
        self.people = PEOPLE[: plan.people]
        self.hosts: dict[str, Host] = {}
        self.units: dict[str, Unit] = {}
        self.devices: dict[tuple[str, str], Device] = {}
        """By carrier and thing."""
        self.operator = Operator(simulation, self.people, plan.operator_period_s)
        self.on_end: list[EndObserver] = []
        self.on_tasks_left: list[TasksObserver] = []
        self._folder = folder
        for carrier, thing, kind in DEVICES:
            self.devices[carrier, thing] = Device(simulation, carrier, thing, kind)
        for device in self._devices_of("home-assistant"):
            device.usual_latency_s = plan.home_latency_s
            device.latency_s = plan.home_latency_s
        for device in self.devices.values():
            device.fail_share = plan.fail_share
            device.late_share = plan.late_share
        if plan.by_hand_period_s > 0.0:
            self._switch_by_hand_later(simulation.random("by hand"))
        self._add_units()

    def host(self, name: str) -> Host:
        """Return the machine `name`."""
        if name not in self.hosts:
            self.hosts[name] = Host(name, self.simulation)
        return self.hosts[name]

    def device(self, carrier: str, thing: str) -> Device | None:
        """Return the device of a carrier, by the name that the carrier has on the bus."""
        if carrier.startswith(PROGRAM_PREFIX):
            carrier = "function"
        return self.devices.get((carrier, thing))

    def _devices_of(self, carrier: str) -> list[Device]:
        return [device for device in self.devices.values() if device.carrier == carrier]

    def _switch_by_hand_later(self, random: Random) -> None:
        """Let somebody switch a device by hand, again and again while the operator is active."""
        wait_s = random.expovariate(1.0 / self.plan.by_hand_period_s)
        self.simulation.after(wait_s, self._switch_by_hand, random)

    def _switch_by_hand(self, random: Random) -> None:
        if self.operator.is_active:
            device = random.choice(self._devices_of("home-assistant"))
            device.switch(is_on=not device.is_on)
            self._switch_by_hand_later(random)

    # Units

    def _add_units(self) -> None:
        plan = self.plan
        map_file = self._folder / "sim.yaml"
        map_file.write_text(MAP)
        scenario_file = self._folder / "scenario.yaml"
        text = SCENARIO.format(map=map_file, method=plan.method, rate_hz=plan.rate_hz)
        scenario_file.write_text(text)
        scenario = read_scenario(str(scenario_file))
        choices = Choices(seed=plan.seed)

        def reactions_in(_text: str, _room: object = None) -> list[SimulatedReaction]:
            return [SimulatedReaction(device) for device in self._devices_of("reactions")]

        vars(reactions_service)["reactions_in"] = reactions_in
        hub = self.host("hub")
        far = self.host("far")
        site = site_launches(scenario, choices)
        if plan.layout == "one":
            self._add_services("site", hub, site)
        else:
            for launch in site:
                host = far if launch.instance in FAR_SERVICES else hub
                self._add_services(launch.instance, host, [launch])
        self._add_services("home-assistant", far, [home_launch(self._devices_of("home-assistant"))])
        for index, user in enumerate(self.people):
            self._add_person(user, user_launches(scenario, choices, user, index))
        if plan.has_shard:
            user = self.people[0]
            for launch in shard_launches(scenario, choices, user):
                self._add_services(launch.instance, self.host(f"pc-{user}"), [launch], user)
        self.add_unit("function", far, self._run_program)
        self.add_unit("operator", hub, self._run_operator)

    def _add_person(self, user: str, launches: Sequence[Launch]) -> None:
        host = self.host(f"pc-{user}")
        if self.plan.layout != "each":
            self._add_services(user, host, launches, user)
            return
        for launch in launches:
            self._add_services(launch.instance, host, [launch], user)

    def _add_services(self, name: str, host: Host, launches: Sequence[Launch], user: str = "") -> None:
        async def run(process: Process, bus: SimulatedBus) -> None:
            await run_services(launches, bus, process)

        self.add_unit(name, host, run, user)

    def add_unit(self, name: str, host: Host, run: Run, user: str = "") -> Unit:
        """Add a unit that runs `run`."""
        unit = Unit(name, host, run, user)
        self.units[name] = unit
        return unit

    async def _run_program(self, process: Process, bus: SimulatedBus) -> None:
        devices = {thing: self.devices["function", thing] for thing in PROGRAM_THINGS}
        await run_program(process, bus, devices)

    async def _run_operator(self, _process: Process, bus: SimulatedBus) -> None:
        await self.operator.run(bus)

    # Life and death of processes

    def start(self, name: str) -> None:
        """Start a unit in a new process, unless it runs or is not wanted."""
        unit = self.units[name]
        if unit.process is not None or not unit.is_wanted:
            return
        unit.is_told_to_end = False
        process = self.simulation.start_process(name, unit.host)
        unit.process = process
        self.simulation.note("start", name)
        process.on_death.append(functools.partial(self._on_killed, unit, process))
        main = process.begin(functools.partial(self._live, unit, process))
        main.add_done_callback(functools.partial(self._on_main_end, unit, process))

    async def _live(self, unit: Unit, process: Process) -> None:
        with using_state_directory(self._folder / "state" / unit.host.name):
            bus = SimulatedBus(self.network, process)
            unit.bus = bus
            try:
                await unit.run(process, bus)
            finally:
                await bus.close()

    def _on_main_end(self, unit: Unit, process: Process, main: "asyncio.Task[object]") -> None:
        if process.is_dead:
            return
        error = None if main.cancelled() else main.exception()
        self.simulation.note("end", unit.name if error is None else f"{unit.name} {error!r}"[:200])
        self._forget(unit, process)
        if error is not None or not unit.is_told_to_end:
            for observe in self.on_end:
                observe(unit, error)
            self.simulation.after(unit.restart_s, self.start, unit.name)
        self.simulation.after(TASKS_LEFT_S, self._check_tasks, unit, process)

    def _check_tasks(self, unit: Unit, process: Process) -> None:
        left = [task.get_name() for task in process.tasks if not task.done()]
        if left and not process.is_dead and not process.is_still:
            for observe in self.on_tasks_left:
                observe(unit, left)
        process.is_dead = True  # nothing of it runs any more

    def kill(self, name: str) -> None:
        """Kill the process of a unit, as by SIGKILL. It is started again later."""
        process = self.units[name].process
        if process is not None:
            process.kill("fault")

    def _on_killed(self, unit: Unit, process: Process) -> None:
        if unit.process is process:
            self._forget(unit, process)
            self.simulation.after(unit.restart_s, self.start, unit.name)

    @staticmethod
    def _forget(unit: Unit, process: Process) -> None:
        if unit.process is process:
            unit.process = None
            unit.bus = None

    def end(self, name: str) -> None:
        """Ask a unit to end, as by SIGTERM."""
        unit = self.units[name]
        if unit.process is not None and unit.process.main is not None:
            unit.is_told_to_end = True
            unit.process.main.cancel()
