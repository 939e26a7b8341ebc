"""Progress of a participant: the next trial and the number of its attempt, from the plan and the table."""

from collections import Counter
from collections.abc import Sequence

from pointit.study.data import Row, done_trials
from pointit.study.plan import Plan
from pointit.study.tasks.scene import Trial


class Progress:
    """The trials that are left. A crash at any time loses at most the attempt that was going on."""

    def __init__(self, plan: Plan, rows: Sequence[Row]) -> None:
        """Go on after the attempts in `rows`."""
        self._trials = {trial.number: trial for trial in plan.trials}
        self._left = sorted(self._trials.keys() - done_trials(rows))
        self._attempts = Counter(int(row["trial"]) for row in rows)
        self._last = int(rows[-1]["trial"]) if rows else None

    @property
    def left(self) -> int:
        """Return the number of trials to do."""
        return len(self._left)

    @property
    def current(self) -> Trial | None:
        """Return the next trial, or None if all are done."""
        return self._trials[self._left[0]] if self._left else None

    @property
    def attempt(self) -> int:
        """Return the number of the next attempt at the current trial, from 1."""
        return self._attempts[self._left[0]] + 1

    def end(self, *, is_done: bool) -> None:
        """Note that an attempt at the current trial has ended."""
        self._last = self._left[0]
        self._attempts[self._last] += 1
        if is_done:
            self._left.pop(0)

    def repeat(self) -> int | None:
        """Do the last trial again; return its number, or None if there is none."""
        if self._last is not None and self._last not in self._left:
            self._left.insert(0, self._last)
        return self._last
