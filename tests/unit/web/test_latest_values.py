"""Whatever a page's speed, it ends with the newest of every key; rate limits and latencies."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pointit.bridges.web.pages.latest_values import LatestValueCache, TokenBucket
from pointit.bridges.web.pages.page_session import LATENCIES_S, Latencies
from pointit.bridges.web.wire import IN_FLIGHT
from pointit.schemas import pack
from pointit.schemas.topics import CURSOR, FEEDBACK, HOVER, MAP, SELECTION_EVENTS, STRIPS_FRAME
from tests.support import there

FAST_HZ = 1e6


def test_batch_is_packed_as_the_wire_format_says() -> None:
    cache = LatestValueCache()
    feed = cache.open(60.0)
    cache.put(CURSOR, "anna", b"\x81")
    cache.put(SELECTION_EVENTS, "", b"\x82")
    batch = there(feed.take(0.0))
    expected = [1, 5, 2.0, [["users/{user}/cursor", "anna", b"\x81"]], [["selection/events", "", b"\x82"]], 0]
    assert batch.packed(5, 2.0) == pack(expected)


def test_urgent_state_does_not_wait_for_the_previous_batch() -> None:
    cache = LatestValueCache()
    feed = cache.open(10.0)
    cache.put(CURSOR, "anna", b"1")
    assert feed.take(0.0) is not None
    cache.put(STRIPS_FRAME, "", b"2", urgent=True)
    assert feed.take(0.001) is not None

    cache.put(STRIPS_FRAME, "", b"3", urgent=True)
    assert feed.take(0.002) is None, "more than its rate"
    assert feed.take(0.1001) is not None

    feed.ack(3)
    cache.put(CURSOR, "anna", b"4")
    assert feed.take(0.15) is None
    assert feed.wait_s(0.15) == pytest.approx(0.15), "a batch is reserved for what is urgent"

    cache.put(STRIPS_FRAME, "", b"5", urgent=True)
    batch = there(feed.take(0.2001))
    assert [payload for _, _, payload in batch.states] == [b"4", b"5"]


def test_page_without_acknowledgements_gets_three_batches_then_the_newest() -> None:
    cache = LatestValueCache()
    feed = cache.open(FAST_HZ)
    sent = 0
    for moment in range(10):
        cache.put(CURSOR, "anna", bytes([moment]))
        sent += feed.take(float(moment)) is not None

    assert sent == IN_FLIGHT
    assert feed.in_flight == IN_FLIGHT
    assert feed.wait_s(10.0) is None
    assert not feed.ack(0)
    assert feed.ack(3)
    assert feed.ack(1), "acknowledgements may overtake each other"
    assert not feed.ack(1), "once each"
    assert not feed.ack(3)
    assert feed.in_flight == 0
    assert there(feed.take(11.0)).states == (("users/{user}/cursor", "anna", bytes([9])),)


def test_forgotten_keys_that_pages_know_make_room() -> None:
    cache = LatestValueCache(max_keys=10)
    feed = cache.open(FAST_HZ)
    for number in range(50):
        assert cache.has_room(CURSOR, f"user{number}"), "forgotten keys fill the cache"
        cache.put(CURSOR, f"user{number}", b"1")
        cache.forget(CURSOR, f"user{number}")
        feed.take(float(number))
        feed.ack(feed.in_flight + feed._acked)
    assert len(cache._entries) <= 10


def test_forgotten_key_makes_room_when_its_page_closes() -> None:
    cache = LatestValueCache(max_keys=3)
    feed = cache.open(FAST_HZ)
    for name in ("a", "b", "c"):
        assert cache.has_room(CURSOR, name)
        cache.put(CURSOR, name, b"1")
    assert not cache.has_room(CURSOR, "d")
    assert cache.has_room(CURSOR, "a")
    cache.forget(CURSOR, "b")
    cache.close(feed)
    assert cache.has_room(CURSOR, "d")


RING = 5
STATES = (CURSOR, HOVER, MAP)
ACTIONS = st.lists(
    st.one_of(
        st.tuples(st.just("put"), st.integers(0, 2), st.sampled_from(["anna", "ben"])),
        st.tuples(st.just("forget"), st.integers(0, 2), st.sampled_from(["anna", "ben"])),
        st.tuples(st.just("event"), st.just(0), st.just("anna")),
        st.tuples(st.just("take"), st.integers(0, 1), st.just("")),
        st.tuples(st.just("ack"), st.integers(0, 1), st.sampled_from(["newest", "next", "wrong"])),
        st.tuples(st.just("open"), st.just(0), st.just("")),
    ),
    max_size=60,
)


class Page:
    def __init__(self, cache: LatestValueCache, first_event: int = 0) -> None:
        self.feed = cache.open(FAST_HZ)
        self.known: dict[tuple[str, str], bytes] = {}
        self.events: list[bytes] = []
        self.first_event = first_event
        self.dropped = 0
        self.sent = 0
        self.acked = 0

    def take(self, now_s: float) -> None:
        batch = self.feed.take(now_s)
        if batch is None:
            return
        self.sent += 1
        assert batch.n == self.sent, "batches are counted from 1"
        assert batch.states or batch.events or batch.dropped, "a batch without news"
        keys = [(key, name) for key, name, _ in batch.states]
        assert len(set(keys)) == len(keys), "one key twice in a batch"
        for key, name, payload in batch.states:
            if payload is None:
                self.known.pop((key, name), None)
            else:
                self.known[key, name] = payload
        self.events += [payload for _, _, payload in batch.events if payload is not None]
        self.dropped += batch.dropped


class Story:
    """A cache, two pages, and what is true."""

    def __init__(self) -> None:
        self.cache = LatestValueCache(max_events=RING)
        self.true: dict[tuple[str, str], bytes] = {}
        self.events: list[bytes] = []
        self.pages = [Page(self.cache), Page(self.cache)]
        self.now_s = 0.0

    def put(self, which: int, name: str) -> None:
        payload = str(self.now_s).encode()
        self.cache.put(STATES[which], name, payload)
        self.true[STATES[which].key, name] = payload

    def forget(self, which: int, name: str) -> None:
        self.true.pop((STATES[which].key, name), None)
        self.cache.forget(STATES[which], name)

    def event(self, _which: int, name: str) -> None:
        self.events.append(str(self.now_s).encode())
        self.cache.put(FEEDBACK, name, self.events[-1])

    def open(self, _which: int, _name: str) -> None:
        self.cache.close(self.pages[0].feed)
        self.pages[0] = Page(self.cache, max(0, len(self.events) - RING))

    def take(self, which: int, _name: str) -> None:
        self.pages[which].take(self.now_s)

    def ack(self, which: int, name: str) -> None:
        page = self.pages[which]
        if name == "wrong":
            assert not page.feed.ack(page.sent + 1)
        elif page.acked < page.sent:
            page.acked = page.sent if name == "newest" else page.acked + 1
            assert page.feed.ack(page.acked)

    def end(self) -> None:
        for page in self.pages:
            for _ in range(3):
                self.now_s += 1.0
                page.feed.ack(page.sent)
                page.take(self.now_s)
            assert page.known == self.true
            seen = self.events[page.first_event :]
            assert page.events == [event for event in seen if event in page.events], "out of order, or twice"
            assert len(page.events) + page.dropped == len(seen)
            assert page.feed.dropped == page.dropped
            assert page.feed.wait_s(self.now_s) is None


@given(ACTIONS)
def test_pages_end_with_the_newest_states_in_any_order(actions: list[tuple[str, int, str]]) -> None:
    story = Story()
    for what, which, name in actions:
        story.now_s += 1.0
        getattr(story, what)(which, name)
        for page in story.pages:
            assert page.feed.in_flight == page.sent - page.acked <= IN_FLIGHT
    story.end()


def test_bucket_passes_a_burst_and_then_its_rate() -> None:
    bucket = TokenBucket(20.0, 40.0)
    assert sum(bucket.take(5.0) for _ in range(100)) == 40
    assert bucket.wait_s(5.0) == pytest.approx(1 / 20)
    assert sum(bucket.take(5.0 + k / 1000) for k in range(1, 1001)) == 20


def test_bucket_gives_no_token_when_the_clock_goes_back() -> None:
    bucket = TokenBucket(10.0, 1.0)
    assert bucket.take(100.0)
    assert not bucket.take(0.0)
    assert not bucket.take(100.0)


def test_latency_quantile_is_one_of_the_values_of_its_window() -> None:
    latencies = Latencies()
    assert latencies.p95_ms(0.0) is None
    for value in range(1, 101):
        latencies.add(float(value), 1.0)
    assert latencies.p95_ms(1.0) == 95.0
    latencies.add(7.0, 2.0)
    assert latencies.p95_ms(1.5 + LATENCIES_S) == 7.0
    assert latencies.p95_ms(3.0 + LATENCIES_S) is None


def test_reserved_tokens_come_one_after_another() -> None:
    bucket = TokenBucket(50.0, 2.0)
    assert [round(bucket.reserve(1.0), 3) for _ in range(5)] == [0.0, 0.0, 0.02, 0.04, 0.06]
    assert bucket.reserve(2.0) == 0.0, "a second later they are there again"
