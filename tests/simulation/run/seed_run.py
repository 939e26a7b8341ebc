"""One seed from its birth to its verdict.

5 s of start, 20 s in which faults begin, then all faults end. People leave after 8 s. 40 s after the end of
the faults everything must be at rest. Then an operator switches and takes back, and all services are asked to
end.
"""

import asyncio
import logging
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

from pointit.schemas import SetThing, topics
from pointit.schemas.requests import UndoSelection
from tests.simulation.faults.drawing import CLOCK_KINDS, FIRST_FAULT_S, draw_faults, draw_plan
from tests.simulation.faults.fault import Fault
from tests.simulation.faults.injector import Injector
from tests.simulation.kernel.simulation import Simulation
from tests.simulation.network.network import Network
from tests.simulation.network.simulated_bus import SimulatedBus
from tests.simulation.promises import promise
from tests.simulation.promises.act_promises import ActPromises
from tests.simulation.promises.breaches import Breaches
from tests.simulation.promises.event_promises import EventPromises
from tests.simulation.promises.history import History
from tests.simulation.promises.log_promises import LogPromises
from tests.simulation.promises.rest_promises import RestPromises
from tests.simulation.run.onlooker import Onlooker
from tests.simulation.run.result import Result
from tests.simulation.world.world import Plan, Unit, World

MAX_START_S = 1.5
"""Time within which all units start, s."""
LAST_FAULTS_S = 3.0
"""Time from the last begin of a fault until all end, s."""
PEOPLE_LEAVE_S = 8.0
"""Time from the end of all faults until all people leave, s."""
DOCTOR_LOOKS_S = 10.0
"""Time in which `pointit doctor` observes, s."""
SETTLE_S = 4.0
"""Time after which an act on the quiet site is over, s."""
END_S = 3.0
"""Time within which all services end, s."""
SWITCHED_AT_REST = ("heater", "radio")


class SeedRun:
    """A world with its faults and promises."""

    def __init__(
        self,
        simulation: Simulation,
        folder: Path,
        plan: Plan | None = None,
        faults: Sequence[Fault] | None = None,
    ) -> None:
        """Create without starting; `plan` and `faults`: instead of those that the seed decides."""
        self.simulation = simulation
        self.plan = plan or draw_plan(simulation.seed)
        self.network = Network(simulation)
        self.world = World(simulation, self.network, self.plan, folder)
        if faults is None:
            faults = draw_faults(self.plan, list(self.world.units), list(self.world.hosts))
        self.faults = list(faults)
        self.breaches = Breaches(simulation)
        self.history = History(simulation)
        are_clocks_right = all(fault.kind not in CLOCK_KINDS for fault in self.faults)
        events = EventPromises(self.world, self.history, self.breaches)
        self._acts = ActPromises(self.world, self.history, self.breaches, are_clocks_right=are_clocks_right)
        self._rest = RestPromises(self.world, self.history, self.breaches)
        self.network.put_observers += [self.history.on_put, events.on_put, self._acts.on_put]
        self.world.on_end.append(self._on_end)
        self.world.on_tasks_left.append(self._on_tasks_left)
        self._early = Onlooker(self.world, "observer", "far")
        self._late = Onlooker(self.world, "doctor", "hub")
        self.world.units["doctor"].is_wanted = False

    def _on_end(self, unit: Unit, error: BaseException | None) -> None:
        cause = error
        while isinstance(cause, BaseExceptionGroup):
            cause = cause.exceptions[0]
        self.breaches.add(promise.NONE_ENDS, f"{unit.name} ended: {cause!r}", cause)

    def _on_tasks_left(self, unit: Unit, tasks: list[str]) -> None:
        self.breaches.add(promise.NO_TASK_LEFT, f"{unit.name}: {tasks[:5]}")

    async def run(self) -> None:
        """Run it to its end."""
        world = self.world
        log = LogPromises(self.simulation, self.breaches)
        logging.getLogger().handlers[:] = [log]
        logging.getLogger().setLevel(logging.WARNING)
        self.simulation.loop.set_exception_handler(log.on_loop_error)
        random = self.simulation.random("start")
        for name in list(world.units):
            self.simulation.after(random.uniform(0.0, MAX_START_S), world.start, name)
        injector = Injector(world)
        for fault in self.faults:
            injector.schedule(fault)
        await asyncio.sleep(FIRST_FAULT_S + self.plan.faults_s + LAST_FAULTS_S)
        world.operator.is_active = False
        injector.end_all()
        await self._come_to_rest()
        await self._use_quiet_site()
        await self._end_all()

    async def _come_to_rest(self) -> None:
        await asyncio.sleep(PEOPLE_LEAVE_S)
        for unit in self.world.units.values():
            if unit.user:
                unit.is_wanted = False
                self.world.end(unit.name)
        await asyncio.sleep(self.plan.calm_s - PEOPLE_LEAVE_S - DOCTOR_LOOKS_S)
        self.world.units["doctor"].is_wanted = True
        self.world.start("doctor")
        await asyncio.sleep(DOCTOR_LOOKS_S)
        self.simulation.note("REST", "checked")
        self._acts.check_at_rest()
        observers = {"early": self._early.state, "late": self._late.state}
        self._rest.check(observers, self._late.findings())

    async def _use_quiet_site(self) -> None:
        """Have the operator switch and take back."""
        unit = self.world.units["operator"]
        if unit.bus is None or unit.process is None:
            return
        work = self._switch_and_undo(unit.bus)
        await self.simulation.loop.create_task(work, context=unit.process.context)

    async def _switch_and_undo(self, bus: SimulatedBus) -> None:
        user = self.world.people[0]
        for thing in SWITCHED_AT_REST:
            before = self.history.owner(thing)
            query = SetThing(thing=thing, on=not before)
            text = await self.world.operator.ask(bus, topics.SET_THING, query, user)
            await asyncio.sleep(SETTLE_S)
            if not text.startswith("ok") or bool(self.history.owner(thing)) is bool(before):
                self.breaches.add(promise.CAN_SWITCH, f"{thing}: {text}, of {self.history.owner(thing)!r}")
                continue
            for device in self.world.devices.values():
                if device.thing == thing and device.is_on is bool(before):
                    self.breaches.add(promise.CAN_SWITCH, f"{device} did not follow: {text}")
            text = await self.world.operator.ask(bus, topics.UNDO_SELECTION, UndoSelection(), user)
            await asyncio.sleep(SETTLE_S)
            after = self.history.owner(thing)
            if after != before:
                self.breaches.add(promise.UNDO_IS_EXACT, f"{thing}: of {before!r}, now of {after!r}: {text}")

    async def _end_all(self) -> None:
        for unit in self.world.units.values():
            unit.is_wanted = False
            self.world.end(unit.name)
        await asyncio.sleep(END_S)
        self._check_exceptions()
        for unit in self.world.units.values():
            if unit.process is not None:
                self.breaches.add(promise.ENDS_WHEN_ASKED, unit.name)

    def _check_exceptions(self) -> None:
        """Check that each exception of a task was looked at. Kept tasks are not logged by asyncio."""
        for process in self.simulation.processes:
            for task in process.tasks:
                if task.done() and not task.cancelled() and getattr(task, "_log_traceback", False):
                    error = task.exception()
                    text = f"{process.name}: {task.get_name()} ended with {error!r}"
                    self.breaches.add(promise.NO_EXCEPTION, text, error)

    def result(self) -> Result:
        """Return the result so far."""
        messages = self.history.messages
        counts = {
            "messages": messages.total(),
            "events": messages[topics.SELECTION_EVENTS.key],
            "acts": messages[topics.ACT_RESULTS.key],
            "lost events": self.network.messages.lost_events,
            "dropped messages": self.network.messages.dropped,
        }
        return Result(
            seed=self.simulation.seed,
            breaches=list(self.breaches.first.values()),
            faults=[fault.line() for fault in self.faults],
            plan=asdict(self.plan),
            digest=self.simulation.digest,
            simulated_s=self.simulation.now_s,
            counts=counts,
        )
