"""A recording played on a site, so that its lights and viewers show the past."""

import asyncio
import contextlib
import json
from dataclasses import replace
from typing import cast

from pointit.replay.clock import RecordingClock
from pointit.replay.levels import OBSERVERS, ReplayError
from pointit.replay.playing import Buses, ReplayListener, ReplayPlan, ReplaySource, play
from pointit.replay.replayed_services import parameters_of, scratch_folder
from pointit.runtime.bus.contract import Bus, list_present
from pointit.runtime.bus.site_clock import publish_time
from pointit.runtime.service.instance_takeover import LISTEN_S
from pointit.schemas import Configuration
from pointit.schemas.system import split_instance
from pointit.schemas.topics import CONFIGURATION, SERVICE_ALIVE


def recorded_outputs(source: ReplaySource) -> list[str]:
    """Return the outputs that led-driver has in `source`, now or later, each as JSON."""
    found: dict[str, None] = {}
    for entry in source.entries(lambda key: key == CONFIGURATION.at("led-driver")):
        if isinstance(entry.body, Configuration):
            with contextlib.suppress(ValueError):  # the replay tells of it
                outputs: object = parameters_of(entry.body).get("outputs")
                if isinstance(outputs, list):
                    found |= dict.fromkeys(json.dumps(each) for each in cast("list[object]", outputs))
    return list(found)


async def play_live(
    plan: ReplayPlan, bus: Bus, listener: ReplayListener, speed: float, *, lights: bool = False
) -> None:
    """Play a recording on the site of `bus`, and publish its time there.

    Raises:
        ReplayError: Services of the recording run on the site already, or cannot be replayed.
    """
    present = await list_present(bus, SERVICE_ALIVE, LISTEN_S)
    own = {each for each in present if split_instance(each)[0] in OBSERVERS}
    if twice := sorted((present - own) & plan.beginning.instances):
        raise ReplayError(
            f"site {bus.site} runs {', '.join(twice)}, as the recording does: end them, or name another site"
        )
    clock = RecordingClock(plan.source.began_ns, speed)
    async with scratch_folder() as folder:
        time = asyncio.create_task(publish_time(clock, bus), name="time of the replay")
        try:
            await play(replace(plan, live=True, lights=lights), Buses(bus, bus, bus), clock, folder, listener)
        finally:
            time.cancel()
            await asyncio.gather(time, return_exceptions=True)
