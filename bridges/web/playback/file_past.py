"""Playback of a recording file, which is read once for its lanes and an index of states.

No core: it reads a file.
"""

import asyncio
import bisect
from collections.abc import Iterator

from pointit.bridges.web.playback.recent import Key, Lanes, Moment, in_order, is_shown, moment
from pointit.bridges.web.wire import Timeline
from pointit.recording.entries import Entry
from pointit.recording.reader import Recording
from pointit.schemas import NS_PER_S

CHECKPOINT_S = 2.0
"""Distance of checkpoints at first, s. A seek reads at most that much of the file."""

MAX_CHECKPOINTS = 1024
MAX_BYTES = 128 * 1024 * 1024
"""Limits of checkpoints and of the bytes in them. Beyond either, every second checkpoint is dropped."""

MAX_KEYS = 4096
"""Maximum number of keys in a checkpoint."""

SLICE = 100
"""Entries read at a time, between which pages are served."""


class FilePast:
    """A recording file as the source of playbacks."""

    def __init__(self, recording: Recording, title: str) -> None:
        self._recording = recording
        self._title = title
        self.site = recording.head.site
        self.began_ns = recording.began_ns
        self.ended_ns = recording.ended_ns
        self.read_ns = self.began_ns
        self._lanes = Lanes()
        self._times: list[int] = []
        self._checkpoints: list[dict[Key, Moment]] = []
        """Newest of every key, for each of `_times`."""
        self._distance_ns = round(CHECKPOINT_S * NS_PER_S)
        self._bytes = 0

    async def read(self) -> None:
        """Build the lanes and the index. Pages are served meanwhile."""
        changed: dict[Key, Entry] = {}
        due_ns = self.began_ns
        for number, entry in enumerate(self._recording.entries(is_shown), 1):
            # A checkpoint holds what came until its time, so it is added before the first later entry
            if entry.time_ns > due_ns:
                self._add_checkpoint(due_ns, changed)
                due_ns = max(due_ns + self._distance_ns, entry.time_ns)
            self._lanes.add(entry.time_ns, entry.row, entry.name, entry.body)
            changed[entry.row.key, entry.name] = entry
            self.read_ns = max(self.read_ns, entry.time_ns)
            if not number % SLICE:
                await asyncio.sleep(0)
        self.read_ns = self.ended_ns = max(self.ended_ns, self.read_ns)

    def states_at(self, at_ns: int) -> list[Entry]:
        """Return the newest entry of every key that is not later than `at_ns`, in order of time."""
        # From the last checkpoint on, or from the beginning of the file before the first one
        states: dict[Key, Moment] = {}
        since_ns: int | None = None
        index = bisect.bisect_right(self._times, at_ns) - 1
        if index >= 0:
            states = self._checkpoints[index]
            since_ns = self._times[index]
        entries = self._recording.entries(is_shown, since_ns=since_ns, until_ns=at_ns + 1)
        newer = {(entry.row.key, entry.name): entry for entry in entries}
        return in_order(states, newer)

    def entries(self, after_ns: int) -> Iterator[Entry]:
        """Return the entries later than `after_ns`, in order of time."""
        return self._recording.entries(is_shown, since_ns=after_ns + 1)

    def timeline(self) -> Timeline:
        """Return the lanes as far as they are read."""
        return Timeline(
            title=self._title,
            began_ns=self.began_ns,
            length_s=(self.ended_ns - self.began_ns) / NS_PER_S,
            read_s=(self.read_ns - self.began_ns) / NS_PER_S,
            problem=self._recording.problem,
            lanes=self._lanes.lanes(self.began_ns, self.read_ns),
        )

    def _add_checkpoint(self, at_ns: int, changed: dict[Key, Entry]) -> None:
        """Add the checkpoint of `at_ns`, and clear `changed`, the entries since the checkpoint before."""
        states: dict[Key, Moment] = {}
        if self._checkpoints:
            states.update(self._checkpoints[-1])
        for key, entry in changed.items():
            if key in states or len(states) < MAX_KEYS:
                states[key] = moment(entry)
                self._bytes += len(states[key].payload)
        changed.clear()
        self._times.append(at_ns)
        self._checkpoints.append(states)
        if len(self._times) > MAX_CHECKPOINTS or self._bytes > MAX_BYTES:
            self._drop_every_second_checkpoint()

    def _drop_every_second_checkpoint(self) -> None:
        # The newest is always kept: the next one contains the changes since then only
        self._times = self._times[::-2][::-1]
        self._checkpoints = self._checkpoints[::-2][::-1]
        self._distance_ns *= 2

        # Checkpoints share their moments, each of which counts once
        shared: dict[int, Moment] = {}
        for states in self._checkpoints:
            for state in states.values():
                shared[id(state)] = state
        self._bytes = sum(len(state.payload) for state in shared.values())
