"""The solver in a process of its own, so that the site and its pages go on meanwhile."""

import asyncio
import multiprocessing
import signal
from concurrent.futures import BrokenExecutor, ProcessPoolExecutor

from pointit.bridges.web.scan.session import Solution
from pointit.bridges.web.scan.solving import solution_of, solve_survey
from pointit.runtime.errors import ConfigError
from pointit.scan.views import Survey


class SolverProcess:
    """Solves surveys one after the other. The process begins with the first one."""

    def __init__(self) -> None:
        self._pool: ProcessPoolExecutor | None = None

    async def solve(self, survey: Survey) -> Solution:
        """Solve `survey`.

        Raises:
            PointItError: If its views determine nothing yet, or the process has ended.
        """
        if self._pool is None:
            self._pool = ProcessPoolExecutor(
                1,
                mp_context=multiprocessing.get_context("spawn"),  # threads of this process hold locks
                initializer=signal.signal,
                initargs=(signal.SIGINT, signal.SIG_IGN),
            )
        try:
            scan = await asyncio.get_running_loop().run_in_executor(self._pool, solve_survey, survey)
        except BrokenExecutor as error:
            self.close()
            raise ConfigError("the solver's process has ended; take the next view") from error
        return solution_of(scan, (survey.views[0].width, survey.views[0].height))

    def close(self) -> None:
        """End the process."""
        pool, self._pool = self._pool, None
        if pool is not None:
            pool.shutdown(wait=False, cancel_futures=True)
