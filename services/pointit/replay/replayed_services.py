"""Services of a recording that run again, each with its recorded configuration, in a folder of their own."""

import asyncio
import json
import tempfile
from collections.abc import AsyncGenerator
from concurrent.futures import ThreadPoolExecutor
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any, cast

from pointit.replay.levels import ReplayError
from pointit.replay.room import check_map
from pointit.runtime.bus.contract import Bus
from pointit.runtime.clock import Clock
from pointit.runtime.config.config import Layers
from pointit.runtime.errors import ConfigError
from pointit.runtime.service.service import Launch, run_service
from pointit.schemas import Configuration
from pointit.schemas.system import split_instance
from pointit.services import registry
from pointit.services.pui.config import PuiConfig


class ReplayedServices:
    """Runs services as tasks, and ends and starts them as they did when they were recorded."""

    def __init__(
        self, bus: Bus, clock: Clock, group: asyncio.TaskGroup, changed: dict[str, dict[str, Any]]
    ) -> None:
        """Run none yet; a service that fails ends `group`. By service, `changed` replaces parameters."""
        self._bus = bus
        self._clock = clock
        self._group = group
        self._changed = changed
        self._running: dict[str, tuple[Configuration, asyncio.Task[None]]] = {}

    async def start(self, configuration: Configuration) -> None:
        """Start the service of `configuration`, in place of the one that runs under its name.

        The same configuration again is the same service, which goes on.

        Raises:
            ReplayError: The service is not installed, or cannot use the configuration.
        """
        running = self._running.get(configuration.instance)
        if running is not None and running[0] == configuration:
            return
        await self.end(configuration.instance)
        launch = self._launch(configuration)
        task = self._group.create_task(run_service(launch, self._bus, self._clock), name=launch.instance)
        self._running[launch.instance] = configuration, task
        await asyncio.sleep(0)  # its constructor declares what it reads before the next entry is put

    async def end(self, instance: str) -> None:
        """End the service called `instance`, if it runs."""
        running = self._running.pop(instance, None)
        if running is not None:
            running[1].cancel()
            await asyncio.wait([running[1]])

    async def end_all(self) -> None:
        """End all, the first started last."""
        for instance in reversed(list(self._running)):
            await self.end(instance)

    def _launch(self, configuration: Configuration) -> Launch:
        name, instance = configuration.service, configuration.instance
        try:
            row = registry.process(name)
            service = row.load()
            layers = Layers()
            layers.add(
                {**parameters_of(configuration), **self._changed.get(name, {})},
                f"recorded configuration of {instance}",
            )
            config = layers.build(service.CONFIG)
        except KeyError as error:
            raise ReplayError(f"{instance} cannot be replayed: {error.args[0]}") from error
        except (ConfigError, ValueError) as error:
            raise ReplayError(f"{instance} cannot be replayed with this version: {error}") from error
        if isinstance(config, PuiConfig) and config.map_to_read and "map" not in self._changed.get(name, {}):
            check_map(config.map_to_read)
        which = "" if configuration.user else split_instance(instance)[1]
        return Launch(service=service, config=config, user=configuration.user, name=which, plugin=row.label)


def parameters_of(configuration: Configuration) -> dict[str, Any]:
    """Return the recorded parameters.

    Raises:
        ValueError: They are no JSON mapping.
    """
    parameters: object = json.loads(configuration.parameters)
    if not isinstance(parameters, dict):
        raise ValueError("its parameters are no mapping")  # noqa: TRY004 - of a file, like what JSON raises
    return cast("dict[str, Any]", parameters)


@asynccontextmanager
async def scratch_folder() -> AsyncGenerator[Path]:
    """Yield an empty folder, which is removed once no thread of a service writes there any more."""
    loop, threads = asyncio.get_running_loop(), ThreadPoolExecutor()
    with tempfile.TemporaryDirectory(prefix="pointit-replay-") as folder:
        loop.set_default_executor(threads)
        try:
            yield Path(folder)
        finally:
            loop.set_default_executor(ThreadPoolExecutor())
            threads.shutdown()
