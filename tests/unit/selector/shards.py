"""A site of shards and one arbiter for tests, with links between them that are cut, slow and forgetful."""

import tempfile
from collections import Counter, deque
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path

from pointit.schemas import Claim, Feedback, Hover, Selection, SelectionEvent, TrackedObject
from pointit.services.selector.config import SelectorConfig
from pointit.services.selector.journal import Journal
from pointit.services.selector.selection_engine import SelectionEngine, ShardEngine
from pointit.services.selector.selection_publisher import OutgoingMessage, Record, event_of
from tests.unit.selector.room import MAP, at, packages, pointing

CONFIG: dict[str, object] = {"gauge": {"full_s": 0.3, "sparse_full_s": 0.3}, "reserve_s": 0.4, "lead_s": 0.0}

OPEN_FILES = ExitStack()
"""Files and folders of sites. They are closed in the test's thread: SQLite refuses any other."""


@dataclass
class Link:
    """Messages on their way between a shard and the arbiter, each way in order."""

    up: deque[tuple[str, Claim]] = field(default_factory=deque[tuple[str, Claim]])
    down: deque[Selection | SelectionEvent] = field(default_factory=deque[Selection | SelectionEvent])
    is_cut: bool = False


class ShardedSite:
    """Shards of one person each, and an arbiter that can be restarted."""

    def __init__(self, users: Sequence[str], *objects: TrackedObject, **config: object) -> None:
        self.config = SelectorConfig.model_validate({**CONFIG, **config})
        self.records: list[Record] = []
        self._folder = Path(OPEN_FILES.enter_context(tempfile.TemporaryDirectory()))
        self._journal = self._open_journal()
        self._journal.begin(at(0.0))
        self.arbiter = SelectionEngine(self.config, self._record)
        self.is_running = True
        self.shards = {user: ShardEngine(self.config) for user in users}
        self.links = {user: Link() for user in users}
        self.objects = objects
        self.time_s = 0.0
        self.claims: list[tuple[str, Claim]] = []
        """Claims to toggle, as sent first."""
        self.hovers: dict[str, Hover] = {}
        self.cues: Counter[str] = Counter()
        """Number of cues that shards gave, by person."""
        self.given_up: Counter[str] = Counter()
        """Number of those for claims that were never decided."""
        self.events: list[SelectionEvent] = []
        self.arbiter.on_map(MAP)
        for shard in self.shards.values():
            shard.on_map(MAP)
        for user in users:
            self.arbiter.set_present(user, True, at(0.0))
            for shard in self.shards.values():
                shard.set_present(user, True, at(0.0))
        self.meet()

    def _open_journal(self) -> Journal:
        journal = Journal(self._folder, restore_within_s=1e6)
        OPEN_FILES.callback(journal.close)
        return journal

    @property
    def now_ns(self) -> int:
        return at(self.time_s)

    @property
    def owners(self) -> dict[str, str]:
        return {one.id: one.user for one in self.arbiter.selection(self.now_ns).objects}

    def answers(self, user: str, claim: Claim) -> list[SelectionEvent]:
        return [event for event in self.events if (event.user, event.stamp_ns) == (user, claim.stamp_ns)]

    def meet(self) -> None:
        for user, link in self.links.items():
            self.shards[user].has_arbiter = self.is_running and not link.is_cut

    def step(self, duration_s: float, places: dict[str, float | None]) -> None:
        """Let time pass, with everybody pointing at a place on the belt, m. None: not at all.

        Shard `anna.2` is another one of anna.
        """
        self.time_s += duration_s
        listed = packages(self.time_s, *self.objects)
        self.take(self.arbiter.on_objects("conveyor", listed))
        for shard in self.shards.values():
            shard.on_objects("conveyor", listed)
        for name, x_m in places.items():
            if x_m is not None:
                user = name.partition(".")[0]
                self._from_shard(name, self.shards[name].on_cursor(user, pointing(self.time_s, x_m)))

    def point(self, user: str, x_m: float) -> None:
        """Have the site's selector get a cursor of `user`, and their shard none."""
        self.take(self.arbiter.on_cursor(user, pointing(self.time_s, x_m)))

    def tick(self) -> None:
        """Do what services do every half second."""
        for user, shard in self.shards.items():
            outputs = shard.tick(self.now_ns)
            self.given_up[user] += sum(isinstance(one.message, Feedback) for one in outputs)
            self._from_shard(user, outputs)
        if self.is_running:
            self.take(self.arbiter.tick(self.now_ns))

    def deliver(self, user: str, *, up: int = 1000, down: int = 1000, twice: bool = False) -> None:
        """Deliver the next messages of a link that is not cut. A claim that finds no arbiter is lost."""
        link = self.links[user]
        if link.is_cut:
            return
        for _ in range(min(up, len(link.up))):
            name, claim = link.up.popleft()
            for _ in range(1 + twice):
                if self.is_running:
                    self.take(self.arbiter.on_claim(name, claim, self.now_ns))
        for _ in range(min(down, len(link.down))):
            message = link.down.popleft()
            if isinstance(message, Selection):
                self.shards[user].on_selection(message)
            else:
                self._from_shard(user, self.shards[user].on_event(message))

    def end_arbiter(self) -> None:
        """Kill the arbiter, and all that is on its way to it or from it."""
        self.is_running = False
        self._journal.close()
        for link in self.links.values():
            link.up.clear()
            link.down.clear()
        self.meet()

    def start_arbiter(self) -> None:
        """Start another arbiter with the journal of the one before."""
        self._journal = self._open_journal()
        kept = self._journal.begin(self.now_ns)
        assert self._journal.problem == ""
        self.arbiter = SelectionEngine(self.config, self._record)
        self.arbiter.on_map(MAP)
        self.arbiter.restore(kept.entries, kept.events, self.now_ns, decided=kept.decided)
        self.arbiter.on_objects("conveyor", packages(self.time_s, *self.objects))
        self.is_running = True
        self.take([OutgoingMessage("", self.arbiter.selection(self.now_ns))])
        for record in kept.unpublished:
            event = event_of(record, record.seq or 0, again=True)
            self.take([] if event is None else [OutgoingMessage("", event)])
        self.meet()

    def settle(self) -> None:
        """Mend everything, and let all that is open be decided. Nobody points."""
        for link in self.links.values():
            link.is_cut = False
        if not self.is_running:
            self.start_arbiter()
        self.meet()
        for _ in range(30):
            self.step(0.5, {})
            self.tick()
            for user in self.shards:
                self.deliver(user)

    def _record(self, record: Record) -> None:
        self.records.append(record)
        self._journal.add(record)

    def _from_shard(self, user: str, outputs: list[OutgoingMessage]) -> None:
        for output in outputs:
            message = output.message
            if isinstance(message, Claim):
                assert self.shards[user].has_arbiter
                is_first = (output.user, message) not in self.claims
                if message.wish == "toggle" and is_first:
                    self.claims.append((output.user, message))
                self.links[user].up.append((output.user, message))
            elif isinstance(message, Hover):
                self.hovers[user] = message
            else:
                assert isinstance(message, Feedback)
                self.cues[user] += 1

    def take(self, outputs: list[OutgoingMessage]) -> None:
        """Send what the arbiter returned, when the journal has it."""
        self._journal.commit(self.now_ns)
        for output in outputs:
            message = output.message
            if isinstance(message, SelectionEvent):
                self._journal.mark_published(message.seq)
                if all(one.seq != message.seq for one in self.events):
                    self.events.append(message)
            if isinstance(message, Selection | SelectionEvent):
                for link in self.links.values():
                    link.down.append(message)
