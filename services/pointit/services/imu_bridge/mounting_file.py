"""The file that keeps a person's measured mountings: trouble with it is a warning, never an end."""

import asyncio

from pointit.runtime.errors import ConfigError
from pointit.runtime.health import Warnings
from pointit.runtime.state import StateFile
from pointit.services.imu_bridge.kept_mounting import PURPOSE, KeptMountings

TOPIC = "state"
"""Of its warnings."""


class MountingFile:
    """Reads and writes what outlives the process."""

    def __init__(self, user: str, warnings: Warnings) -> None:
        self._file = StateFile(KeptMountings, user, PURPOSE)
        self._warnings = warnings

    def read(self) -> KeptMountings | None:
        """Return what is kept; none where nothing is, or it cannot be used."""
        try:
            return self._file.read()
        except ConfigError as error:
            self._warnings.warn(TOPIC, f"the person's measured mounting is not used: {error}")
            return None

    async def keep(self, kept: KeptMountings) -> str:
        """Write what is to be kept, or erase the file where that is nothing; return what went wrong."""
        try:
            if kept.by_source:
                await asyncio.to_thread(self._file.write, kept)
            else:
                await asyncio.to_thread(self._file.erase)
        except ConfigError as error:
            self._warnings.warn(TOPIC, f"the person's mounting is used, but will be lost at the end: {error}")
            return str(error)
        self._warnings.clear(TOPIC)
        return ""
