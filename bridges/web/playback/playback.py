"""Playback into a model of the site: position, speed, steps and seeks; pure.

Times in seconds are of any monotonic clock; those in nanoseconds are the site's, as recorded.
"""

from collections.abc import Iterator

from pointit.bridges.web.model.site_model import SiteModel
from pointit.bridges.web.playback.recent import GRACE_NS, Past
from pointit.bridges.web.wire import PersonLine, Status
from pointit.recording.entries import Entry
from pointit.schemas import NS_PER_S, Message
from pointit.schemas.topics import SERVICE_ALIVE, USER_ALIVE, Delivery, Topic

OWN = "web"
"""Name of the service that owns the model."""

MAX_AT_ONCE = 400
"""Maximum number of entries played at once. A machine that is too slow plays more slowly."""


class Playback:
    """Position of one page in the past, and the model of the site at that position."""

    def __init__(self, past: Past, now_s: float) -> None:
        self._past = past
        self.model = SiteModel(OWN, 0.0)
        self.speed = 1.0
        self._at_ns = past.began_ns
        self._since_s = now_s
        """When the position was `_at_ns`."""
        self.is_playing = False
        self._entries: Iterator[Entry] = iter(())
        self._next: Entry | None = None
        """Taken from `_entries`, and not yet played."""
        self._ticked_s = 0
        self.seek(past.began_ns, now_s)

    def at_ns(self, now_s: float) -> int:
        """Return the position."""
        if not self.is_playing:
            return self._at_ns
        passed_ns = round((now_s - self._since_s) * self.speed * NS_PER_S)
        return max(self._at_ns, min(self._at_ns + passed_ns, self._past.ended_ns))

    def play(self, now_s: float, *, is_playing: bool | None = None, speed: float | None = None) -> None:
        """Play or pause, and set the speed."""
        # The position is that of the speed until now
        self._set_position(self.at_ns(now_s), now_s)
        if speed is not None:
            self.speed = speed
        if is_playing is not None:
            self.is_playing = is_playing

    def seek(self, at_ns: int, now_s: float) -> None:
        """Go to `at_ns`, within what is read. Pages get the differences of states, and no events."""
        past = self._past
        at_ns = min(max(at_ns, past.began_ns), past.read_ns)

        # Another model, from the states at that time: events have passed
        model = SiteModel(OWN, past.began_ns / NS_PER_S)
        for entry in past.states_at(at_ns):
            is_event = isinstance(entry.row, Topic) and entry.row.delivery is Delivery.EVENT
            if not is_event:
                self._apply_entry(entry, model)

        # The page's feed reads the cache of before, which takes over the new states
        cache = self.model.cache
        cache.become(model.cache)
        model.cache = cache
        self.model = model
        self._entries = past.entries(at_ns)
        self._next = next(self._entries, None)
        self._set_position(at_ns, now_s)
        self._tick_model()

    def step(self, by: int, now_s: float) -> None:
        """Pause, and go to the next entry, or with `by` < 0 to the one before."""
        self.is_playing = False
        if by < 0:
            previous_states = self._past.states_at(self._at_ns - 1)
            previous_ns = previous_states[-1].time_ns if previous_states else self._past.began_ns
            self.seek(previous_ns, now_s)
            return
        if self._next is not None:
            at_ns = self._play_until(self._next.time_ns)
            self._set_position(at_ns, now_s)
            self._tick_model()

    def advance(self, now_s: float) -> None:
        """Play the entries until the position of `now_s`."""
        if not self.is_playing:
            return
        at_ns = self._play_until(self.at_ns(now_s))
        self._set_position(at_ns, now_s)
        self._tick_model()
        if at_ns >= self._past.ended_ns:
            self.is_playing = False

    def status(self) -> Status:
        """Return the status of the site at the position."""
        people = [PersonLine(user=user) for user in sorted(self.model.state.people)]
        return self.model.status(people, self._at_ns / NS_PER_S, viewers=1, lan_url="", speed=1.0)

    def _set_position(self, at_ns: int, now_s: float) -> None:
        self._at_ns = at_ns
        self._since_s = now_s

    def _play_until(self, at_ns: int) -> int:
        for _ in range(MAX_AT_ONCE):
            if self._next is None or self._next.time_ns > at_ns:
                return at_ns
            self._apply_entry(self._next, self.model)
            self._next = next(self._entries, None)
        return at_ns if self._next is None else min(at_ns, self._next.time_ns)

    def _apply_entry(self, entry: Entry, model: SiteModel) -> None:
        at_s = entry.time_ns / NS_PER_S
        row = entry.row
        name = entry.name
        body = entry.body
        if isinstance(row, Topic) and isinstance(body, Message):
            model.take(row, name, body, entry.time_ns, at_s)
        elif row is SERVICE_ALIVE:
            remaining_ns = self._past.ended_ns - entry.time_ns
            if body or remaining_ns > GRACE_NS:  # else the recording ends with its run
                model.set_service(name, bool(body), at_s)
        elif row is USER_ALIVE:
            model.set_person(name, present=bool(body))

    def _tick_model(self) -> None:
        """Remove what is no longer valid, once a recorded second."""
        at_s = self._at_ns // NS_PER_S
        if at_s != self._ticked_s:
            self._ticked_s = at_s
            self.model.tick(self._at_ns / NS_PER_S)
