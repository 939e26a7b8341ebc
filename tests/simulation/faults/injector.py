"""Carries out faults on a world, and ends all of them."""

from collections.abc import Callable

from pointit.schemas import SetThing, topics
from pointit.schemas.requests import UndoSelection
from tests.simulation.faults.fault import Fault, FaultFormatError
from tests.simulation.kernel.process import READING_NS, Process
from tests.simulation.world.devices import Device
from tests.simulation.world.world import Unit, World

MIN_ABSENCE_S = 1.5
"""Shortest time until a person comes back, s."""
RESTART_AFTER_FAULTS_S = 1.0
RETRY_START_S = 1.0
"""Time after which a unit that still ends is started again, s."""
TEMPORARY_UNITS = ("doctor",)
"""Units that do not run while there are faults."""


class Injector:
    """Carries out faults."""

    def __init__(self, world: World) -> None:
        self._world = world
        self._after = world.simulation.after
        self._is_over = False
        self._kinds: dict[str, Callable[[Fault], object]] = {
            "kill": self._kill,
            "kill at": self._kill_at,
            "restart": self._restart,
            "stop": self._stop,
            "block": self._block,
            "cut": self._cut,
            "router": self._cut_all,
            "slow link": self._slow_link,
            "bad link": self._bad_link,
            "clock": self._set_clock,
            "drift": self._drift,
            "coarse clock": self._coarsen_clock,
            "full disk": self._fill_disk,
            "slow disk": self._slow_disk,
            "leave": self._leave,
            "device": self._break_device,
            "by hand": self._switch_by_hand,
            "burst": self._burst,
        }

    def schedule(self, fault: Fault) -> None:
        """Carry out a fault at its time.

        Raises:
            FaultFormatError: There is no such kind.
        """
        if fault.kind not in self._kinds:
            raise FaultFormatError(f"there is no fault {fault.kind!r}; there are {', '.join(self._kinds)}")
        self._after(fault.at_s - self._world.simulation.now_s, self._apply, fault)

    def _apply(self, fault: Fault) -> None:
        self._world.simulation.note("FAULT", str(fault))
        self._kinds[fault.kind](fault)

    def _unit(self, fault: Fault) -> Unit | None:
        return self._world.units.get(fault.target)

    def _process(self, fault: Fault) -> Process | None:
        unit = self._unit(fault)
        return None if unit is None else unit.process

    # Processes

    def _kill(self, fault: Fault) -> None:
        unit = self._unit(fault)
        if unit is not None:
            unit.restart_s = fault.number
            self._world.kill(unit.name)

    def _kill_at(self, fault: Fault) -> None:
        unit = self._unit(fault)
        if unit is not None and unit.process is not None:
            unit.restart_s = fault.number
            unit.process.kill_point = (fault.detail, int(fault.duration_s))

    def _restart(self, fault: Fault) -> None:
        unit = self._unit(fault)
        if unit is not None:
            self._world.end(unit.name)
            self._after(fault.number, self._start_again, unit)

    def _start_again(self, unit: Unit) -> None:
        if unit.process is None:
            self._world.start(unit.name)
        else:
            self._after(RETRY_START_S, self._start_again, unit)

    def _stop(self, fault: Fault) -> None:
        process = self._process(fault)
        if process is not None:
            process.stand_still(fault.duration_s, by_signal=True)
            self._world.network.router.watch_stopped(process)

    def _block(self, fault: Fault) -> None:
        process = self._process(fault)
        if process is not None:
            process.stand_still(fault.duration_s, by_signal=False)

    # Links

    def _cut(self, fault: Fault) -> None:
        router = self._world.network.router
        router.cut(fault.target)
        self._after(fault.duration_s, router.mend, fault.target)

    def _cut_all(self, fault: Fault) -> None:
        router = self._world.network.router
        for host in self._world.hosts:
            router.cut(host)
            self._after(fault.duration_s, router.mend, host)

    def _slow_link(self, fault: Fault) -> None:
        link = self._world.network.router.link(fault.target)
        link.delay_s = fault.number
        link.jitter_s = 0.3 * fault.number
        self._after(fault.duration_s, link.become_good)

    def _bad_link(self, fault: Fault) -> None:
        link = self._world.network.router.link(fault.target)
        link.drop = fault.number
        self._after(fault.duration_s, link.become_good)

    # Machines

    def _set_clock(self, fault: Fault) -> None:
        host = self._world.host(fault.target)
        host.offset_ns += round(fault.number * 1e9)
        self._after(fault.duration_s, self._correct_clock, fault.target)

    def _correct_clock(self, name: str) -> None:
        host = self._world.host(name)
        host.offset_ns = 0
        host.drift_ppm = 0.0

    def _drift(self, fault: Fault) -> None:
        self._world.host(fault.target).drift_ppm = fault.number

    def _coarsen_clock(self, fault: Fault) -> None:
        host = self._world.host(fault.target)
        host.reading_ns = 0
        self._after(fault.duration_s, setattr, host, "reading_ns", READING_NS)

    def _fill_disk(self, fault: Fault) -> None:
        host = self._world.host(fault.target)
        host.disk_is_full = True
        self._after(fault.duration_s, setattr, host, "disk_is_full", False)

    def _slow_disk(self, fault: Fault) -> None:
        host = self._world.host(fault.target)
        host.disk_delay_s = fault.number
        self._after(fault.duration_s, setattr, host, "disk_delay_s", 0.0)

    # People and things

    def _leave(self, fault: Fault) -> None:
        units = [unit for unit in self._world.units.values() if unit.user == fault.target]
        for unit in units:
            unit.is_wanted = False
            if fault.detail == "killed":
                self._world.kill(unit.name)
            else:
                self._world.end(unit.name)
        self._after(max(fault.number, MIN_ABSENCE_S), self._come_back, units)

    def _come_back(self, units: list[Unit]) -> None:
        if self._is_over:
            return
        for unit in units:
            unit.is_wanted = True
            self._world.start(unit.name)

    def _device(self, fault: Fault) -> Device:
        carrier, _, thing = fault.target.partition("/")
        return self._world.devices[carrier, thing]

    def _break_device(self, fault: Fault) -> None:
        device = self._device(fault)
        if fault.detail == "fails":
            device.fails = True
        elif fault.detail == "stuck":
            device.is_stuck = True
        else:
            device.latency_s = fault.number
        self._after(fault.duration_s, device.become_good)

    def _switch_by_hand(self, fault: Fault) -> None:
        device = self._device(fault)
        device.switch(is_on=not device.is_on)

    def _burst(self, fault: Fault) -> None:
        world = self._world
        unit = world.units["operator"]
        if unit.bus is None or unit.process is None:
            return
        for index in range(int(fault.number)):
            is_undo = fault.detail == "undo" or (fault.detail == "both" and index % 2 == 0)
            request = topics.UNDO_SELECTION if is_undo else topics.SET_THING
            wanted = (None, True, False)[index % 3]
            query = UndoSelection() if is_undo else SetThing(thing=fault.target, on=wanted)
            work = world.operator.ask(unit.bus, request, query, world.people[0])
            world.simulation.loop.create_task(work, context=unit.process.context)

    # The end

    def end_all(self) -> None:
        """End all faults: links, disks, clocks and devices are good, and all units run."""
        world = self._world
        self._is_over = True
        world.simulation.note("CALM", "all faults end")
        for name, host in world.hosts.items():
            world.network.router.mend(name)
            world.network.router.link(name).become_good()
            self._correct_clock(name)
            host.reading_ns = READING_NS
            host.disk_is_full = False
            host.disk_delay_s = 0.0
        for device in world.devices.values():
            device.become_good()
        for unit in world.units.values():
            unit.is_wanted = unit.name not in TEMPORARY_UNITS
            unit.restart_s = RESTART_AFTER_FAULTS_S
            if unit.process is not None:
                unit.process.kill_point = None
                unit.process.resume()
            world.start(unit.name)
