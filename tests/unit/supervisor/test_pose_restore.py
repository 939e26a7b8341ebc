"""A place that outlives its localizer: by example, with a played localizer, and with the real ones."""

import asyncio
from typing import Literal

import pytest

from pointit.runtime.bus.memory_bus import LocalBroker, MemoryBus
from pointit.runtime.errors import RefusedError
from pointit.runtime.service.service import Launch, run_service
from pointit.runtime.virtual_time import VirtualClock, run_virtually
from pointit.schemas import (
    ButtonEvent,
    Done,
    Interaction,
    Localization,
    PointingRay,
    RememberedBias,
    SetPose,
    UserPose,
)
from pointit.schemas.topics import BUTTON, CURSOR, INTERACTION, POSE, RAY, SERVICE_ALIVE, SET_POSE
from pointit.services.localizer.config import LocalizerConfig
from pointit.services.localizer.service import Localizer
from pointit.services.pui.service import Pui
from pointit.services.supervisor.pose_restore import PoseRestorer
from pointit.services.supervisor.service import Supervisor
from tests.support.bench import Bench, in_virtual_time, memory_bench, until

S = 1_000_000_000
ANNA = "anna"
Method = Literal["fixed", "static_targets", "moving_target", "external"]


COVARIANCE = (0.04, 0.0, 0.0, 0.0, 0.04, 0.0, 0.0, 0.0, 0.01)
BACK = SetPose(
    position_m=(1.0, 2.0, 0.0),
    yaw_rad=0.5,
    method="static_targets",
    covariance=COVARIANCE,
    elevation_bias_rad=0.1,
    remembered_bias=RememberedBias(
        localizations=2, origin_height_m=1.6, bias_rad=0.1, slope=0.05, covariance=(0.004, 0.0, 0.0, 0.02)
    ),
)


def pose(now_s: float, method: Method = "static_targets") -> UserPose:
    fields = BACK.model_dump(exclude={"method"})
    return UserPose(stamp_ns=round(now_s * S), method=method, **fields)


def idle(now_s: float) -> tuple[Localization, int]:
    return Localization(stamp_ns=round(now_s * S), phase="idle"), round(now_s * S)


def test_new_localizer_gets_the_pose_back_once() -> None:
    place = PoseRestorer()
    place.localization(*idle(1))
    place.pose(pose(2))
    place.localization(idle(1)[0], 3 * S)  # an old word, heard again
    assert place.deadline_ns is None
    place.localization(*idle(10))
    assert place.deadline_ns == 11 * S
    assert place.due(11 * S - 1) is None
    assert place.due(11 * S) == BACK
    assert place.due(20 * S) is None
    place.renew(20 * S)
    assert place.due(21 * S) is not None


def test_localizer_gets_its_pose_back_after_a_clock_set_back() -> None:
    place = PoseRestorer()
    place.pose(pose(3600))
    place.localization(*idle(10))
    assert place.due(11 * S) == BACK


def test_fixed_pose_is_restored_as_fixed() -> None:
    place = PoseRestorer()
    remembered = BACK.remembered_bias
    fixed = UserPose(stamp_ns=2 * S, position_m=(1.0, 2.0, 0.0), yaw_rad=0.5, remembered_bias=remembered)
    place.pose(fixed)
    place.localization(*idle(10))
    assert place.due(11 * S) == SetPose(position_m=(1.0, 2.0, 0.0), yaw_rad=0.5, remembered_bias=remembered)


def test_measured_pose_outlasts_the_configured_one_of_a_new_localizer() -> None:
    place = PoseRestorer()
    place.pose(pose(2, "fixed"))
    place.localization(*idle(10))
    place.pose(UserPose(stamp_ns=10 * S, position_m=(9.0, 9.0, 0.0), yaw_rad=0.0))
    assert place.due(11 * S) == BACK.model_copy(update={"method": "fixed"})


@pytest.mark.parametrize("own_s", [9.0, 10.5])
def test_localizer_keeps_a_pose_of_its_own(own_s: float) -> None:
    place = PoseRestorer()
    place.pose(pose(2, "fixed"))
    place.localizer(4 * S, is_present=False)
    if own_s < 10:
        place.pose(pose(own_s, "fixed"))
    place.localization(*idle(own_s - 0.1))
    place.localizer(10 * S, is_present=True)
    place.pose(pose(own_s, "fixed"))
    assert place.deadline_ns is None


def test_pose_is_not_restored_from_a_tracker_or_during_sampling() -> None:
    place = PoseRestorer()
    place.pose(pose(2, "external"))
    place.localization(*idle(10))
    assert place.due(20 * S) is None
    place = PoseRestorer()
    place.pose(pose(2))
    place.localization(*idle(10))
    place.localization(Localization(stamp_ns=10 * S, phase="sampling"), 10 * S)
    assert place.due(20 * S) is None
    place.localization(Localization(stamp_ns=21 * S, phase="refused"), 21 * S)
    assert place.due(21 * S) is not None


@in_virtual_time
async def test_supervisor_restores_the_pose_and_warns_when_it_is_refused() -> None:
    clock = VirtualClock()
    async with memory_bench(clock) as bench:
        given: list[SetPose] = []

        async def set_pose(query: SetPose, _user: str) -> Done:
            given.append(query)
            if len(given) == 1:
                raise RefusedError("not yet")
            return Done()

        bench.start(Supervisor, user=ANNA)
        bench.put(POSE, pose(clock.now_ns() / S), ANNA)
        present = bench.bus.announce(SERVICE_ALIVE, "localizer.anna")
        await bench.settle()
        bench.bus.serve(SET_POSE, set_pose, ANNA)
        present.close()
        await bench.settle()
        bench.bus.announce(SERVICE_ALIVE, "localizer.ben")
        bench.bus.announce(SERVICE_ALIVE, "localizer.anna")
        await until(lambda: len(given) == 2)  # refused, and again
        assert given == [BACK] * 2


def test_pose_survives_restarts_of_localizer_and_pui() -> None:
    """The localizer by lamps, then pui: the real ones, each stopped and started again."""
    run_virtually(_two_restarts())


async def _two_restarts() -> None:
    clock = VirtualClock()
    exchange = LocalBroker()

    def start(kind: type[Localizer] | type[Pui], user: str = "") -> tuple[MemoryBus, asyncio.Task[None]]:
        config = LocalizerConfig(method="static_targets") if kind is Localizer else kind.CONFIG()
        bus = MemoryBus(exchange)
        launch = Launch(service=kind, config=config, user=user)
        return bus, asyncio.create_task(run_service(launch, bus, clock))

    async def stop(running: tuple[MemoryBus, asyncio.Task[None]]) -> None:
        bus, task = running
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)
        await bus.close()

    bench = Bench(MemoryBus(exchange), clock)
    localizer = start(Localizer, ANNA)
    pui = start(Pui)
    try:
        bench.start(Supervisor, user=ANNA)
        poses, cursors = bench.collect(POSE, ANNA), bench.collect(CURSOR, ANNA)
        states: list[Interaction] = bench.collect(INTERACTION, ANNA)
        await until(lambda: bool(states))
        await bench.bus.call(SET_POSE, SetPose(position_m=(2.0, 0.5, 0.0), yaw_rad=0.3), ANNA)
        await until(lambda: len(poses) == 1)
        bench.put(BUTTON, ButtonEvent(stamp_ns=clock.now_ns()), ANNA)
        await until(lambda: states[-1].state == "pointing")
        for restarts in (1, 2):  # what was given back is kept as well
            await stop(localizer)
            localizer = start(Localizer, ANNA)
            await until(lambda: len(poses) == 1 + restarts)  # noqa: B023 - awaited within the round
        await stop(pui)
        pui = start(Pui)
        cursors.clear()
        await bench.settle()

        def point() -> bool:
            ray = PointingRay(stamp_ns=clock.now_ns(), origin_m=(0.0, 0.0, 1.6), direction=(1.0, 0.0, 0.0))
            bench.put(RAY, ray, ANNA)
            return bool(cursors)

        await until(point)
        assert (poses[-1].position_m, poses[-1].yaw_rad) == ((2.0, 0.5, 0.0), 0.3)
    finally:
        await bench.stop()
        await stop(localizer)
        await stop(pui)
        await bench.bus.close()
