"""The folder of a replay, where its services keep what they store."""

import asyncio
import tempfile
from collections.abc import AsyncGenerator
from concurrent.futures import ThreadPoolExecutor
from contextlib import asynccontextmanager
from pathlib import Path


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
