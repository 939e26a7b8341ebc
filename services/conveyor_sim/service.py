"""Reads the map and the selection, writes the objects on the conveyor, and answers requests about it."""

import asyncio
from collections.abc import Sequence
from typing import ClassVar

from pointit.runtime.clock import ticks
from pointit.runtime.config.parameters import set_option
from pointit.runtime.errors import ConfigError, RefusedError
from pointit.runtime.host.state_file import site_folder
from pointit.runtime.service.carrier import Act, ActFailedError, Carrier
from pointit.runtime.service.service import Context, Scope, Service
from pointit.schemas import (
    NS_PER_S,
    AddPackage,
    AddPackageReply,
    ConveyorState,
    Done,
    Environment,
    ResetConveyor,
    Selection,
    SetFeeding,
    SetSpeed,
    ThingState,
    topics,
)
from pointit.schemas.problems import UNWRITABLE
from pointit.services.conveyor_sim.config import ConveyorSimConfig
from pointit.services.conveyor_sim.feeding import NoRoomError, UnknownLaneError, check_schedule
from pointit.services.conveyor_sim.persistence import PlantPersistence, discard, fingerprint
from pointit.services.conveyor_sim.plant import Plant, UnusableMapError
from pointit.services.conveyor_sim.tracking import PackageTracker

TRACKER = "conveyor"
"""Name of the tracker under which objects are reported."""

STALL_S = 1.0
"""Wall time without a step after which the conveyor continues from where it was, instead of jumping."""

STALL_PERIODS = 3
"""Smallest number of periods without a step that count as a stall."""


class ConveyorSim(Service[ConveyorSimConfig]):
    """Moves objects along the map's belts, or along its strips used as belts."""

    NAME: ClassVar[str] = "conveyor-sim"
    SCOPE: ClassVar[Scope] = "site"
    CONFIG = ConveyorSimConfig
    TIME_MAY_STEP: ClassVar[bool] = True

    @classmethod
    def discard_saved_state(cls, site: str, now_ns: int) -> None:
        """Delete the saved state, so that the next conveyor of `site` starts empty."""
        discard(site_folder(site, cls.NAME), now_ns)

    def __init__(self, config: ConveyorSimConfig, context: Context) -> None:
        super().__init__(config, context)

        # The plant of the newest map, and what is known of it
        self._plant: Plant | None = None
        self._tracker: PackageTracker | None = None
        self._mark = ""
        self._persistence = PlantPersistence(config, site_folder(self.bus.site, self.NAME))
        self._is_resumed = False
        self._has_plant = asyncio.Event()
        self._owners: dict[str, str] | None = None
        self._names: Sequence[str] = ()
        """Packages whose acts are carried out."""
        self._stepped_ns = 0

        # What is published of it
        self._seq = 0
        self._state = ConveyorState(stamp_ns=self.clock.now_ns(), speed_mps=config.speed_mps)
        self._objects = self.bus.publisher(topics.OBJECTS, TRACKER)
        self._states = self.bus.publisher(topics.CONVEYOR_STATE)
        self._events = self.bus.publisher(topics.SELECTION_EVENTS)
        self._carrier = Carrier(self.bus, self.clock, self.NAME)
        self._states.put(self._state)
        self.bus.set_metric("default speed", config.speed_mps, "m/s")

        # Requests and messages: from here on the methods below may be called
        self.bus.serve(topics.ADD_PACKAGE, self._on_add)
        self.bus.serve(topics.SET_SPEED, self._on_speed)
        self.bus.serve(topics.SET_FEEDING, self._on_feeding)
        self.bus.serve(topics.RESET_CONVEYOR, self._on_reset)
        self.bus.subscribe(topics.SELECTION, self._on_selection)
        self.bus.subscribe(topics.MAP, self._on_map)

    @classmethod
    def validate_config(cls, config: ConveyorSimConfig) -> None:
        """Check that the schedule can be read.

        Raises:
            ConfigError: If it cannot; names the file and the problem.
        """
        check_schedule(config)

    @classmethod
    def validate_map(cls, config: ConveyorSimConfig, room: Environment) -> None:
        """Check that the map has the lanes and bays. A map with fewer than two bays sorts nothing.

        Raises:
            ConfigError: If one is missing.
        """
        try:
            Plant(room, config, seed=0, start_ns=0)
        except UnusableMapError as error:
            raise ConfigError(
                f"{error}, or choose another map: {set_option('pui', 'map', 'NAME')}"
            ) from error
        bays = [bay.id for bay in room.bays]
        for name, bay in (("bay_selected", config.bay_selected), ("bay_rest", config.bay_rest)):
            if len(bays) > 1 and bay not in bays:
                option = set_option("conveyor-sim", name, bays[0])
                raise ConfigError(
                    f"{name}: map {room.name!r} has no bay {bay!r}, there are {', '.join(bays)}; {option}"
                )

    async def run(self) -> None:
        """Step and report once there are lanes; save the state at the end."""
        await self._has_plant.wait()
        try:
            self._resume()
            async for now_ns in ticks(self.clock, self.config.rate_hz):
                self._report(self._ready(), now_ns)
        finally:
            await self._carrier.close()
            if self._plant is not None:
                self._persistence.save(self._plant, self._mark, self.clock.now_ns())
            self._persistence.close()

    def _on_selection(self, selection: Selection, _name: str) -> None:
        owners = {selected.id: selected.user for selected in selection.objects}
        self._select(owners)

    def _select(self, owners: dict[str, str]) -> None:
        self._owners = owners
        if self._plant is not None and self._is_resumed:
            self._plant.select(owners)

    @property
    def state(self) -> ThingState:
        """Return the state of each package, as the target of acts on it."""
        return ThingState(id="", state="unknown")

    async def carry_out(self, act: Act, /) -> None:
        """Give a package the bay of its selection. Raises ActFailedError if it is past its last way there."""
        owners = dict(self._owners or {})
        owners.pop(act.thing, None)
        if act.on:
            owners[act.thing] = act.event.user
        self._select(owners)
        reason = self._ready().refusals.get(act.thing, "it has left")
        if reason:
            raise ActFailedError("refused", reason)

    def _on_map(self, environment: Environment, _name: str) -> None:
        mark = fingerprint(environment, self.config)
        previous = self._plant
        if previous is not None and mark == self._mark:
            return

        # A plant of other belts: if it cannot be made, the previous one goes on
        now_ns = self.clock.now_ns()
        try:
            plant = Plant(
                environment,
                self.config,
                seed=self.config.seed,
                start_ns=now_ns,
                is_feeding=previous is None or previous.is_feeding,
            )
        except (UnusableMapError, ConfigError) as error:
            self.bus.warn("map", str(error))
            return
        self.bus.clear("map")
        self._plant = plant
        self._mark = mark
        self._stepped_ns = now_ns
        self._tracker = PackageTracker(self.config.tracking)

        # It takes over the speed and the selection
        if previous is not None:
            plant.set_speed(previous.state(now_ns).speed_mps)
        if self._owners is not None:
            plant.select(self._owners)
        self._check_initial(plant)
        self._has_plant.set()

    def _check_initial(self, plant: Plant) -> None:
        initial = self.config.feeder.initial
        if self.config.feeders or self.config.schedule:
            initial = 0
        warning = ""
        if plant.fed < initial and plant.is_feeding:
            warning = (
                f"feeder.initial: {initial} configured, {plant.fed} put on the lanes: there is no room, or "
                "no kind, for more"
            )
        self.bus.warn("initial", warning)

    def _resume(self) -> None:
        """Restore the plant of a previous conveyor if it is recent and of the same map."""
        plant = self._plant
        if plant is not None:
            now_ns = self.clock.now_ns()
            unpublished = self._persistence.resume(plant, self._mark, now_ns, speed=self.clock.speed)
            for event in unpublished:
                self._events.put(event)
            if self._owners is not None:
                plant.select(self._owners)
        self._is_resumed = True

    async def _on_add(self, query: AddPackage, _name: str) -> AddPackageReply:
        plant = self._up_to_date()
        try:
            object_id = plant.add(query.kind, query.lane, query.length_m, query.position)
        except (NoRoomError, UnknownLaneError) as error:
            raise RefusedError(str(error)) from error
        self._report(plant, self._stepped_ns)
        return AddPackageReply(object_id=object_id, message=f"{query.kind} {object_id} is on the conveyor")

    async def _on_speed(self, query: SetSpeed, _name: str) -> Done:
        plant = self._up_to_date()
        try:
            plant.set_speed(query.speed_mps, query.belts)
        except UnknownLaneError as error:
            raise RefusedError(str(error)) from error
        self._report(plant, self._stepped_ns)
        subject = "the conveyor runs"
        if query.belts:
            verb = "runs" if len(query.belts) == 1 else "run"
            subject = f"{', '.join(query.belts)} {verb}"
        return Done(message=f"{subject} at {query.speed_mps:g} m/s")

    async def _on_feeding(self, query: SetFeeding, _name: str) -> Done:
        plant = self._up_to_date()
        plant.set_feeding(is_on=query.feeding)
        self._report(plant, self._stepped_ns)
        message = "the feeders give packages" if query.feeding else "the feeders rest"
        return Done(message=message)

    async def _on_reset(self, _query: ResetConveyor, _name: str) -> Done:
        plant = self._up_to_date()
        size = plant.size
        plant.reset()
        self._report(plant, self._stepped_ns)
        feeding = "the feeder starts again" if plant.is_feeding else "the feeder still rests"
        return Done(message=f"{size} objects taken off, {feeding}")

    def _ready(self) -> Plant:
        if self._plant is None or not self._is_resumed:
            raise RefusedError(
                "the conveyor has no lanes yet because no map with lanes came; is pui running?"
            )
        return self._plant

    def _up_to_date(self) -> Plant:
        plant = self._ready()
        self._advance(plant, self.clock.now_ns())
        return plant

    def _advance(self, plant: Plant, now_ns: int) -> None:
        stall_s = max(STALL_S * self.clock.speed, STALL_PERIODS / self.config.rate_hz)
        if now_ns - self._stepped_ns > stall_s * NS_PER_S:
            plant.skip_time(now_ns)
        self._stepped_ns = now_ns

        # Stored, published, marked: after a crash in between, events are published twice, and none is lost
        events = plant.step(now_ns)
        events = self._persistence.save(plant, self._mark, now_ns, events)
        for event in events:
            self._events.put(event)
        if events:
            self._persistence.mark_published(now_ns)
        self.bus.warn(UNWRITABLE, self._persistence.problem)

    def _report(self, plant: Plant, now_ns: int) -> None:
        self._advance(plant, now_ns)
        names = plant.names
        if names != self._names:
            self._names = names
            self._carrier.use({name: [self] for name in names})
        report = None
        if self._tracker is not None:
            report = self._tracker.report(plant.tracked(now_ns))
        if report is not None:
            self._seq += 1
            self._objects.put(report.model_copy(update={"seq": self._seq}))

        # The state only if more than its time has changed
        state = plant.state(now_ns)
        last = self._state
        unnumbered = state.model_copy(update={"stamp_ns": last.stamp_ns, "seq": last.seq})
        if unnumbered != last:
            self._state = state.model_copy(update={"seq": last.seq + 1})
            self._states.put(self._state)


SERVICE = ConveyorSim
