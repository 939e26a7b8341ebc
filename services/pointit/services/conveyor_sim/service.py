"""Reads the map and the selection, writes the objects on the conveyor, answers requests about it."""

import asyncio
from typing import ClassVar

from pointit.geometry.polyline import Polyline
from pointit.runtime import Context, RefusedError, Service, ticks
from pointit.runtime.service import Scope
from pointit.schemas import (
    NS_PER_S,
    AddPackage,
    AddPackageReply,
    ConveyorState,
    Done,
    Environment,
    ResetConveyor,
    Selection,
    SelectionEvent,
    SetSpeed,
    TrackedObjects,
)
from pointit.schemas.topics import (
    ADD_PACKAGE,
    CONVEYOR_STATE,
    MAP,
    OBJECTS,
    RESET_CONVEYOR,
    SELECTION,
    SELECTION_EVENTS,
    SET_SPEED,
)
from pointit.services.conveyor_sim.config import ConveyorSimConfig
from pointit.services.conveyor_sim.conveyor import Conveyor, NoRoomError, UnknownLaneError
from pointit.services.conveyor_sim.feeder import Feeder
from pointit.services.conveyor_sim.lane import Lane

TRACKER = "conveyor"
"""Under this name its objects are reported."""

STALL_S = 1.0
"""Wall time without a step after which the conveyor goes on from where it was, instead of jumping."""

STALL_PERIODS = 3
"""It is never taken for stalled before so many periods of its rate."""


class ConveyorSim(Service[ConveyorSimConfig]):
    """Moves objects along the map's belts, or along its strips taken as belts."""

    NAME: ClassVar[str] = "conveyor-sim"
    SCOPE: ClassVar[Scope] = "site"
    CONFIG = ConveyorSimConfig

    def __init__(self, config: ConveyorSimConfig, context: Context) -> None:
        super().__init__(config, context)
        self._conveyor: Conveyor | None = None
        self._has_lanes = asyncio.Event()
        self._lines: dict[str, Polyline] = {}
        self._owners: dict[str, str] = {}
        self._stepped_ns = 0
        self._seq = 0
        self._events_seq = 0
        self._state = ConveyorState(stamp_ns=self.clock.now_ns(), speed_mps=config.speed_mps)
        self._objects = self.bus.publisher(OBJECTS, TRACKER)
        self._states = self.bus.publisher(CONVEYOR_STATE)
        self._events = self.bus.publisher(SELECTION_EVENTS)
        self._states.put(self._state)
        self.bus.serve(ADD_PACKAGE, self._on_add)
        self.bus.serve(SET_SPEED, self._on_speed)
        self.bus.serve(RESET_CONVEYOR, self._on_reset)
        self.bus.subscribe(SELECTION, self._on_selection)
        self.bus.subscribe(MAP, self._on_map)

    async def run(self) -> None:
        """Step and report, once there are lanes."""
        await self._has_lanes.wait()
        async for now_ns in ticks(self.clock, self.config.rate_hz):
            self._report(self._ready(), now_ns)

    def _on_selection(self, selection: Selection, _name: str) -> None:
        self._owners = {selected.id: selected.user for selected in selection.objects}

    def _on_map(self, environment: Environment, _name: str) -> None:
        lines = self._choose(environment)
        if lines is None or _same(lines, self._lines):
            return
        config, feeder = self.config, self.config.feeder
        before = self._conveyor
        self._lines = lines
        self._stepped_ns = self.clock.now_ns()
        self._conveyor = Conveyor(
            [Lane(config.surface, lane_id, line) for lane_id, line in lines.items()],
            Feeder(
                feeder.sequence,
                interval_s=feeder.interval_s,
                length_m=feeder.length_m,
                count=feeder.count,
            ),
            speed_mps=config.speed_mps if before is None else before.speed_mps,
            initial=feeder.initial,
            prefix=f"{self._stepped_ns // 1_000_000:x}",  # unique across restarts and maps
            start_ns=self._stepped_ns,
        )
        if self._conveyor.fed < feeder.initial:
            self.bus.warn(
                "initial",
                f"feeder.initial: {feeder.initial} were asked for, {self._conveyor.fed} put on the lanes: "
                "there is no room, or no kind, for more",
            )
        self._has_lanes.set()

    def _choose(self, environment: Environment) -> dict[str, Polyline] | None:
        """Return the lines that are lanes; none, with a warning, when the map does not have them."""
        surface = self.config.surface
        there = environment.strips if surface == "strip" else environment.belts
        lines = {line.id: line.line_m for line in there}
        wanted = self.config.lanes or tuple(lines)
        missing = [lane_id for lane_id in wanted if lane_id not in lines]
        if missing or not wanted:
            what = f"no {surface} {missing[0]!r}" if missing else f"no {surface}s"
            listed = ", ".join(lines) or "none"
            self.bus.warn(
                "map",
                f"lanes: map {environment.name!r} has {what}, there are {listed}; set surface and lanes",
            )
            return None
        try:
            chosen = {lane_id: Polyline(lines[lane_id]) for lane_id in wanted}
        except ValueError as error:
            self.bus.warn("map", f"lanes: a {surface} of map {environment.name!r} is no lane: {error}")
            return None
        self.bus.clear("map")
        return chosen

    async def _on_add(self, query: AddPackage, _name: str) -> AddPackageReply:
        conveyor = self._up_to_date()
        try:
            item = conveyor.add(query.kind, query.lane, query.length_m)
        except (NoRoomError, UnknownLaneError) as error:
            raise RefusedError(str(error)) from error
        self._report(conveyor, self._stepped_ns)
        return AddPackageReply(object_id=item.id, message=f"{item.kind} {item.id} is on the conveyor")

    async def _on_speed(self, query: SetSpeed, _name: str) -> Done:
        conveyor = self._up_to_date()
        conveyor.set_speed(query.speed_mps)
        self._report(conveyor, self._stepped_ns)
        return Done(message=f"the conveyor runs at {query.speed_mps:g} m/s")

    async def _on_reset(self, _query: ResetConveyor, _name: str) -> Done:
        conveyor = self._up_to_date()
        size = conveyor.size
        conveyor.reset()
        self._report(conveyor, self._stepped_ns)
        return Done(message=f"{size} objects taken off, the feeder starts again")

    def _ready(self) -> Conveyor:
        if self._conveyor is None:
            raise RefusedError("the conveyor has no lanes yet: no map with them came; is pui running?")
        return self._conveyor

    def _up_to_date(self) -> Conveyor:
        conveyor = self._ready()
        self._advance(conveyor, self.clock.now_ns())
        return conveyor

    def _advance(self, conveyor: Conveyor, now_ns: int) -> None:
        stall_s = max(STALL_S * self.clock.speed, STALL_PERIODS / self.config.rate_hz)
        if now_ns - self._stepped_ns > stall_s * NS_PER_S:
            conveyor.stand_still(now_ns)
        self._stepped_ns = now_ns
        for item in conveyor.step(now_ns):
            self._events_seq += 1
            self._events.put(
                SelectionEvent(
                    stamp_ns=now_ns,
                    seq=self._events_seq,
                    event="left",
                    object_id=item.id,
                    kind=item.kind,
                    user=self._owners.get(item.id, ""),
                )
            )

    def _report(self, conveyor: Conveyor, now_ns: int) -> None:
        self._advance(conveyor, now_ns)
        self._seq += 1
        self._objects.put(TrackedObjects(stamp_ns=now_ns, seq=self._seq, objects=tuple(conveyor.tracked())))
        last = self._state
        if (conveyor.speed_mps, conveyor.fed, conveyor.left) != (last.speed_mps, last.fed, last.left):
            self._state = ConveyorState(
                stamp_ns=now_ns,
                seq=last.seq + 1,
                speed_mps=conveyor.speed_mps,
                fed=conveyor.fed,
                left=conveyor.left,
            )
            self._states.put(self._state)


def _same(a: dict[str, Polyline], b: dict[str, Polyline]) -> bool:
    return list(a) == list(b) and all(
        a[lane_id].vertices_m.tolist() == b[lane_id].vertices_m.tolist() for lane_id in a
    )


SERVICE = ConveyorSim
