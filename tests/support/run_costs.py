"""Wall time and CPU of the tests of a run, and how much of the run its cores and its processes waited."""

from collections import defaultdict
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

FILES = 10
"""Number of the slowest files that are listed, and of those with most CPU."""
WAITING_TESTS = 20
"""Number of tests that are listed as those that wait longest."""
HEAVY_TESTS = 40
"""Number of tests with most CPU that are listed."""


@dataclass(frozen=True, kw_only=True)
class Cost:
    """Wall time and CPU of one test with its fixtures."""

    process: str
    """Name of the process of pytest-xdist that ran it, or `""` if there is only one."""
    began_s: float
    """Monotonic time of the machine, s."""
    ended_s: float
    cpu_s: float
    """CPU of the process and of those that it started and waited for, s."""

    @property
    def wall_s(self) -> float:
        return self.ended_s - self.began_s

    @property
    def waiting_s(self) -> float:
        """Wall time without CPU, s: waiting for an event, for a clock, or for a core that others use."""
        return max(0.0, self.wall_s - self.cpu_s)


@dataclass(frozen=True, kw_only=True)
class RunCosts:
    """A whole run."""

    tests: Mapping[str, Cost]
    """By node ID."""
    began_s: float
    """Monotonic time of the machine at the start of the session, s."""
    ended_s: float
    cpu_s: float
    """CPU of all processes, with collection and start, s."""
    cores: int

    @property
    def wall_s(self) -> float:
        return self.ended_s - self.began_s

    def idle_share(self) -> float:
        """Return the share of the cores' time in which nothing of this run computed.

        On a machine with other work it counts the cores that the others used.
        """
        return max(0.0, 1.0 - self.cpu_s / (self.cores * self.wall_s))

    def process_shares(self) -> dict[str, float]:
        """Return the share of the processes' time for each use of it."""
        of_process = defaultdict[str, list[Cost]](list)
        for cost in self.tests.values():
            of_process[cost.process].append(cost)
        total_s = self.wall_s * len(of_process)

        first_s = 0.0
        last_s = 0.0
        for costs in of_process.values():
            first_s += min(cost.began_s for cost in costs) - self.began_s
            last_s += self.ended_s - max(cost.ended_s for cost in costs)
        tests_s = sum(cost.wall_s for cost in self.tests.values())
        waiting_s = sum(cost.waiting_s for cost in self.tests.values())

        shares = {
            "in tests that compute": tests_s - waiting_s,
            "in tests that wait": waiting_s,
            "before their first test": first_s,
            "after their last test": last_s,
            "between tests": total_s - tests_s - first_s - last_s,
        }
        return {name: spent_s / total_s for name, spent_s in shares.items()}

    def lines(self) -> Iterator[str]:
        """Yield the lines of a report: shares of time, then the files and tests that took most."""
        yield (
            f"{len(self.tests)} tests in {self.wall_s:.0f} s with {self.cpu_s:.0f} s of CPU: "
            f"{self.idle_share():.0%} of the time of {self.cores} cores was left to others or to nobody"
        )
        shares = ", ".join(f"{share:.0%} {name}" for name, share in self.process_shares().items())
        processes = {cost.process for cost in self.tests.values()}
        yield f"time of {len(processes)} processes: {shares}"

        files = defaultdict[str, list[Cost]](list)
        for test, cost in self.tests.items():
            files[test.partition("::")[0]].append(cost)
        wall_s = {file: sum(cost.wall_s for cost in costs) for file, costs in files.items()}
        cpu_s = {file: sum(cost.cpu_s for cost in costs) for file, costs in files.items()}

        yield "slowest files by wall time:"
        for file in _largest(wall_s, FILES):
            yield f"{wall_s[file]:7.2f} s {file} ({cpu_s[file]:.2f} s of CPU)"
        yield "files with most CPU:"
        for file in _largest(cpu_s, FILES):
            yield f"{cpu_s[file]:7.2f} s {file} ({wall_s[file]:.2f} s of wall time)"

        test_waits_s = {test: cost.waiting_s for test, cost in self.tests.items()}
        test_cpu_s = {test: cost.cpu_s for test, cost in self.tests.items()}
        yield "tests that wait longest:"
        for test in _largest(test_waits_s, WAITING_TESTS):
            yield f"{test_waits_s[test]:7.2f} s {test}"
        yield "tests with most CPU:"
        for test in _largest(test_cpu_s, HEAVY_TESTS):
            yield f"{test_cpu_s[test]:7.2f} s {test}"


def _largest(of_name_s: Mapping[str, float], count: int) -> list[str]:
    return sorted(of_name_s, key=lambda name: -of_name_s[name])[:count]
