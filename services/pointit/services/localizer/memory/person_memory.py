"""Memory of one person's pointing with each kind of their devices and mountings; pure."""

from collections.abc import Iterable
from dataclasses import dataclass

from pointit.schemas import LearntPointing
from pointit.services.localizer.estimation.solution import Solution, SolverSettings
from pointit.services.localizer.memory.learning import learn
from pointit.services.localizer.memory.recall import recall

MAX_MOUNTINGS = 8
"""Number of kinds of devices and mountings that are remembered; those learnt last are kept."""


@dataclass(frozen=True)
class Remember:
    """Store what is known of the person's pointing."""

    learnt: tuple[LearntPointing, ...]


class PersonMemory:
    """Recalls and learns for the mounting in use.

    Neither for an unknown one (`""`), nor for a calibrated person, whose rays are already corrected. During
    one localization the same is recalled, since its poses share rays.
    """

    def __init__(self, learnt: Iterable[LearntPointing] = (), *, is_used: bool = True) -> None:
        """Start with `learnt`, that learnt last at the end. If not `is_used`, it is only shown and erased."""
        self._learnt = {each.mounting: each for each in learnt}
        self._before = dict(self._learnt)
        """Memory when the localization began."""
        self._began_ns = 0
        self._is_used = is_used
        self._is_erased = False
        """True if it was erased during the localization, which has rays of before and teaches nothing."""
        self.mounting = ""
        """Device and mounting in use, as in `ImuSample`."""
        self.is_calibrated = False

    @property
    def learnt(self) -> tuple[LearntPointing, ...]:
        """Return all that is remembered, that learnt last at the end."""
        return tuple(self._learnt.values())

    def begin(self, now_ns: int) -> None:
        """Begin a localization."""
        self._before, self._began_ns, self._is_erased = dict(self._learnt), now_ns, False

    def recall(self, trust: SolverSettings) -> SolverSettings:
        """Return `trust` with what was remembered when the localization began as its priors."""
        return recall(trust, self._before.get(self._mounting), self._began_ns)

    def learn(self, found: Solution, trust: SolverSettings, now_ns: int) -> list[Remember]:
        """Learn from an accepted localization; return what is to be stored, if it changed."""
        mounting = self._mounting
        if not mounting or self._is_erased:
            return []
        after = learn(self._before.get(mounting), found, trust, mounting, now_ns)
        if after == self._learnt.get(mounting):
            return []
        self._learnt.pop(mounting, None)
        if after is not None:
            self._learnt[mounting] = after
        while len(self._learnt) > MAX_MOUNTINGS:
            del self._learnt[next(iter(self._learnt))]
        return [Remember(self.learnt)]

    def erase(self) -> None:
        """Forget everything, also what the running localization recalls, and what it would still teach."""
        self._learnt, self._before, self._is_erased = {}, {}, True

    @property
    def _mounting(self) -> str:
        """Return the mounting in use, or `""` if nothing is recalled or learnt."""
        return self.mounting if self._is_used and not self.is_calibrated else ""
