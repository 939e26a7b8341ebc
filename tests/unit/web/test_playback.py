"""Playing a past: what is shown is what was true, wherever the position comes from."""

import asyncio
import itertools
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from pointit.bridges.web.model.site_model import SiteModel
from pointit.bridges.web.playback import recent as recent_module
from pointit.bridges.web.playback.file_past import FilePast
from pointit.bridges.web.playback.playback import Playback
from pointit.bridges.web.playback.recent import Lanes, Past, Recent, moment
from pointit.recording.entries import Body, Entry, entry
from pointit.recording.reader import Recording
from pointit.runtime.virtual_time import START_NS, run_virtually
from pointit.schemas import (
    NS_PER_S,
    Deployment,
    Environment,
    ExpectedService,
    Health,
    Hover,
    Interaction,
    Message,
    RobotState,
    SelectionEvent,
    TrackedObject,
    TrackedObjects,
    UserPose,
    topics,
)
from pointit.schemas.problems import Problem
from pointit.schemas.system import RUN
from pointit.schemas.topics import ROBOT_STATE, SERVICE_ALIVE
from tests.support import there
from tests.support.recorded import write_recording

LENGTH_S = 20.0
BEN_LEAVES_S = 12.0


def at(seconds: float) -> int:
    return START_NS + round(seconds * NS_PER_S)


def said(seconds: float, row: topics.Topic[Any] | topics.Presence, name: str, body: Body) -> Entry:
    return entry(at(seconds), row, name, body)


def pose(seconds: float, x_m: float) -> UserPose:
    return UserPose(stamp_ns=at(seconds), yaw_rad=0.0, position_m=(x_m, 0.0, 0.0))


def event(seconds: float, what: str, user: str = "anna", kind: str = "red") -> SelectionEvent:
    return SelectionEvent.model_validate(
        {"stamp_ns": at(seconds), "event": what, "object_id": "run-7", "kind": kind, "user": user}
    )


def health(seconds: float, *warnings: str, user: str = "") -> Health:
    stamp_ns = at(seconds)
    problems = tuple(Problem(code="lost", sentence=each) for each in warnings)
    return Health(stamp_ns=stamp_ns, service="any", instance="any", user=user, pid=1, problems=problems)


@pytest.fixture(scope="module")
def entries() -> list[Entry]:
    """Return 20 s of anna, who walks and hovers, and ben, who leaves."""
    thing = TrackedObject(id="run-7", kind="red", position_m=(1.0, 0.0, 1.0))
    deployment = Deployment(
        stamp_ns=at(0),
        name="scenario_4",
        services=(ExpectedService(service="selector"),),
        scenario="scenario_4",
        target_kinds=("red",),
    )
    found = [
        said(0.0, topics.SERVICE_ALIVE, "selector", True),
        said(0.0, topics.USER_ALIVE, "anna", True),
        said(0.0, topics.USER_ALIVE, "ben", True),
        said(0.0, topics.MAP, "", Environment(stamp_ns=at(0), name="lab")),
        said(0.0, topics.DEPLOYMENT, f"{RUN}1", deployment),
        said(0.0, topics.POSE, "ben", pose(0.0, 5.0)),
        said(1.0, topics.INTERACTION, "anna", Interaction(stamp_ns=at(1), state="pointing")),
        said(9.5, topics.SELECTION_EVENTS, "", event(9.5, "selected")),
        said(10.5, topics.SELECTION_EVENTS, "", event(10.5, "selected", kind="blue")),
        said(11.0, topics.SELECTION_EVENTS, "", event(11.0, "refused")),
        said(BEN_LEAVES_S, topics.USER_ALIVE, "ben", False),
        said(0.0, topics.SERVICE_ALIVE, "pui", True),
        said(15.0, topics.SERVICE_ALIVE, "pui", False),
        said(13.0, topics.SELECTION_EVENTS, "", event(13.0, "left", user="")),
        said(13.5, topics.SELECTION_EVENTS, "", event(13.5, "dispatched", user="")),
    ]
    for tick in range(round(LENGTH_S * 10)):
        now_s = 0.05 + tick / 10
        found.append(said(now_s, topics.POSE, "anna", pose(now_s, now_s)))
        over = "run-7" if 8.0 <= now_s <= 9.5 else ""
        found.append(said(now_s, topics.HOVER, "anna", Hover(stamp_ns=at(now_s), object_id=over)))
        found.append(
            said(now_s, topics.OBJECTS, "belt", TrackedObjects(stamp_ns=at(now_s), objects=(thing,)))
        )
        if not tick % 10:
            warnings = (f"{tick} messages lost",) if 5.0 <= now_s <= 8.0 else ()
            found.append(said(now_s, topics.HEALTH, "selector", health(now_s, *warnings)))
    found.append(said(LENGTH_S, topics.SERVICE_ALIVE, "selector", False))
    return sorted(found, key=lambda each: each.time_ns)


@pytest.fixture(scope="module")
def path(entries: list[Entry], tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("recorded") / "lab.mcap"
    write_recording(file, entries)
    return file


@pytest.fixture(scope="module")
def in_file(path: Path) -> Iterator[FilePast]:
    with Recording.open(path) as recording:
        past = FilePast(recording, "lab.mcap")
        asyncio.run(past.read())
        yield past


def kept(entries: list[Entry], window_s: float = 600.0) -> Recent:
    recent = Recent("lab", window_s)
    model = SiteModel("web", 0.0, recent)
    for each in entries:
        at_s = each.time_ns / NS_PER_S
        if isinstance(each.row, topics.Topic) and isinstance(each.body, Message):
            assert model.take(each.row, each.name, each.body, each.time_ns, at_s)
        elif isinstance(each.row, topics.Presence) and isinstance(each.body, bool):
            recent.add(each.time_ns, each.row, each.name, each.body, moment(each).payload)
            if each.row is topics.SERVICE_ALIVE:
                model.set_service(each.name, each.body, at_s)
            else:
                model.set_person(each.name, present=each.body)
    return recent


@pytest.fixture(params=["a file", "the last minutes"], scope="module")
def past(request: pytest.FixtureRequest, entries: list[Entry], in_file: FilePast) -> Past:
    return in_file if request.param == "a file" else kept(entries).past(entries[-1].time_ns)


def shown(playback: Playback) -> set[tuple[str, str, bytes | None]]:
    return set(playback.model.cache.states_since(0))


def played_to(past: Past, seconds: float) -> Playback:
    playback = Playback(past, 0.0)
    playback.play(0.0, is_playing=True)
    for tick in range(1, round(seconds * 20) + 1):
        playback.advance(tick / 20)
    return playback


@pytest.mark.parametrize("seconds", [0.0, 0.06, 4.0, 9.5, 11.95, 12.0, 19.95])
def test_seek_shows_the_same_as_playing_until_then(past: Past, seconds: float) -> None:
    played = played_to(past, seconds)
    sought = Playback(past, 0.0)
    sought.seek(at(17.0), 0.0)
    sought.seek(at(seconds), 0.0)
    assert sought.at_ns(0.0) == played.at_ns(seconds) == at(seconds)
    assert shown(sought) == shown(played)
    people = [[person.user for person in each.status().people] for each in (sought, played)]
    assert people[0] == people[1] == (["anna", "ben"] if seconds < BEN_LEAVES_S else ["anna"])


def test_seek_sends_a_page_differences_and_no_events(past: Past) -> None:
    playback = Playback(past, 0.0)
    feed = playback.model.cache.open(60.0)
    first = there(feed.take(0.0))
    assert ("map", "") in {news[:2] for news in first.states}

    playback.seek(at(14.0), 0.0)
    batch = there(feed.take(1.0))
    assert {news[:2]: news[2] is not None for news in batch.states} == {
        ("users/{user}/pose", "anna"): True,
        ("users/{user}/pose", "ben"): False,
        ("users/{user}/hover", "anna"): True,
        ("users/{user}/interaction", "anna"): True,
        ("objects/{tracker}", "belt"): True,
        ("health/{service}", "selector"): True,
    }
    assert (batch.events, batch.dropped) == ((), 0)


def test_position_follows_the_clock_and_stops_at_the_end(past: Past) -> None:
    playback = Playback(past, 0.0)
    playback.play(100.0, is_playing=True, speed=0.5)
    playback.advance(102.0)
    assert playback.at_ns(102.0) == at(1.0)

    playback.play(102.0, speed=8.0)
    playback.advance(102.5)
    assert playback.at_ns(102.5) == at(5.0)

    playback.play(102.5, is_playing=False)
    playback.advance(110.0)
    assert playback.at_ns(110.0) == at(5.0)

    playback.play(110.0, is_playing=True)
    for tick in range(20):
        playback.advance(110.0 + tick)
    assert not playback.is_playing
    assert playback.at_ns(200.0) == past.ended_ns


def test_slow_machine_plays_slowly_without_skipping(past: Past, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("pointit.bridges.web.playback.playback.MAX_AT_ONCE", 5)
    playback = Playback(past, 0.0)
    feed = playback.model.cache.open(60.0)
    playback.play(0.0, is_playing=True)
    playback.advance(15.0)
    assert playback.at_ns(15.0) < at(1.0)
    for tick in range(len(list(past.entries(0)))):
        playback.advance(15.0 + tick)
    assert not playback.is_playing
    events = [news for _ in range(3) for batch in [feed.take(1e6)] if batch for news in batch.events]
    assert len(events) == 5


def test_steps_visit_every_message_in_both_directions(past: Past, entries: list[Entry]) -> None:
    times = sorted({each.time_ns for each in entries if at(9.0) <= each.time_ns <= at(11.5)})
    playback = Playback(past, 0.0)
    playback.seek(times[0], 0.0)
    playback.play(0.0, is_playing=True)
    for time_ns in times[1:]:
        playback.step(1, 0.0)
        assert playback.at_ns(50.0) == time_ns
    for time_ns in times[-2::-1]:
        playback.step(-1, 0.0)
        assert playback.at_ns(50.0) == time_ns


def test_lanes_show_states_selections_refusals_misses_and_warnings(past: Past) -> None:
    lanes = {(lane.kind, lane.user): lane.items for lane in past.timeline().lanes}
    assert lanes == {
        ("interaction", "anna"): ((1.0, 20.0, "pointing"),),
        ("hover", "anna"): ((8.05, 9.55, "red 7"),),
        ("selections", "anna"): ((9.5, 9.5, "selected red 7"), (10.5, 10.5, "selected blue 7")),
        ("wrong", "anna"): ((10.5, 10.5, "not wanted: blue 7"),),
        ("refusals", "anna"): ((11.0, 11.0, "refused red 7"),),
        ("interaction", "ben"): (),
        ("misses", ""): tuple((at_s, at_s, "red 7 left without being selected") for at_s in (13.0, 13.5)),
        ("warnings", ""): ((5.05, 8.05, "selector: 50 messages lost"), (15.0, 15.0, "pui has gone")),
    }


@pytest.mark.parametrize(("before_s", "is_told"), [(4.0, True), (1.0, False)])
def test_services_leaving_together_are_an_outage_except_at_the_end(
    tmp_path: Path, before_s: float, *, is_told: bool
) -> None:
    left_s = LENGTH_S - before_s
    run = [said(LENGTH_S, topics.POSE, "anna", pose(LENGTH_S, 1.0))]
    for name in ("pui", "selector", "led-driver", "keeper"):
        run += [said(at_s, topics.SERVICE_ALIVE, name, at_s == 0.0) for at_s in (0.0, left_s)]
        run += [said(at_s, topics.HEALTH, name, health(at_s)) for at_s in range(1, round(left_s))]
    write_recording(tmp_path / "run.mcap", sorted(run, key=lambda each: each.time_ns))
    with Recording.open(tmp_path / "run.mcap") as recording:
        past = FilePast(recording, "run")
        run_virtually(past.read())
        findings = played_to(past, LENGTH_S + 1.0).status().findings
    assert any("gone together" in each.sentence for each in findings) is is_told


@pytest.mark.parametrize("most", [3, 4])
def test_states_outlast_dropped_checkpoints(
    most: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("pointit.bridges.web.playback.file_past.MAX_CHECKPOINTS", most)
    seconds = range(60)
    write_recording(tmp_path / "long.mcap", [said(n, topics.POSE, f"user{n}", pose(n, 1.0)) for n in seconds])
    with Recording.open(tmp_path / "long.mcap") as recording:
        past = FilePast(recording, "long")
        asyncio.run(past.read())
        for until in seconds:
            assert [each.name for each in past.states_at(at(until))] == [f"user{n}" for n in range(until + 1)]


def test_recent_past_keeps_its_window(entries: list[Entry]) -> None:
    past = kept(entries, window_s=6.0).past(at(LENGTH_S))
    assert past.began_ns == at(14.0)
    playback = Playback(past, 0.0)
    assert shown(playback) == shown(played_to(kept(entries).past(at(LENGTH_S)), 14.0))
    assert all(start >= 0.0 for lane in past.timeline().lanes for start, _, _ in lane.items)


def test_recent_past_has_bounded_memory(entries: list[Entry], monkeypatch: pytest.MonkeyPatch) -> None:
    whole = kept(entries).past(at(LENGTH_S))
    monkeypatch.setattr(recent_module, "MAX_BYTES", 15_000)
    bounded = kept(entries).past(at(LENGTH_S))
    assert whole.began_ns < bounded.began_ns < bounded.ended_ns
    then_s = (bounded.began_ns - START_NS) / NS_PER_S
    assert shown(Playback(bounded, 0.0)) == shown(played_to(whole, then_s))


def test_recent_past_restarts_when_the_clock_is_set_back(entries: list[Entry]) -> None:
    recent = kept(entries)
    early = at(-1000.0)
    recent.add(early, topics.USER_ALIVE, "carl", True, b"1")
    past = recent.past(early + 5 * NS_PER_S)
    assert past.began_ns == early
    states = past.states_at(past.ended_ns)
    assert [each.name for each in states if each.row is topics.USER_ALIVE] == ["anna", "carl"]
    assert [each.name for each in states if each.row is topics.POSE] == ["anna"]
    lanes = {(lane.kind, lane.user): lane.items for lane in past.timeline().lanes}
    assert lanes == {("interaction", "anna"): ((0.0, 5.0, "pointing"),), ("interaction", "carl"): ()}


def test_number_of_lanes_is_bounded_when_people_are_invented() -> None:
    lanes = Lanes()
    for number in range(2000):
        lanes.add(at(number / 100), topics.USER_ALIVE, f"user{number}", True)
        lanes.add(
            at(number / 100), topics.INTERACTION, f"user{number}", Interaction(stamp_ns=1, state="pointing")
        )
    assert len(lanes.lanes(at(0), at(20.0))) <= 512


def visitors(number: int, stay_s: float) -> Iterator[Entry]:
    """Yield `number` people, one after the other, who point, hover, select and leave."""
    for index in range(number):
        name = f"visitor{index}"
        now_s = index * stay_s
        yield said(now_s, topics.USER_ALIVE, name, True)
        yield said(now_s, topics.SERVICE_ALIVE, f"pointing.{name}", True)
        yield said(now_s + 1.0, topics.HEALTH, f"pointing.{name}", health(now_s + 1.0, "hot", user=name))
        yield said(
            now_s + 1.0, topics.INTERACTION, name, Interaction(stamp_ns=at(now_s + 1), state="pointing")
        )
        yield said(now_s + 2.0, topics.HOVER, name, Hover(stamp_ns=at(now_s + 2.0), object_id="run-7"))
        yield said(now_s + 3.0, topics.SELECTION_EVENTS, "", event(now_s + 3.0, "selected", user=name))
        yield said(now_s + 3.0, topics.SELECTION_EVENTS, "", event(now_s + 3.0, "refused", user=name))
        yield said(now_s + stay_s, topics.SERVICE_ALIVE, f"pointing.{name}", False)
        yield said(now_s + stay_s, topics.USER_ALIVE, name, False)


def test_recent_past_compresses_a_burst_in_small_pieces(monkeypatch: pytest.MonkeyPatch) -> None:
    """Compression is done in the loop that serves pages: 512 kB take 15 ms."""
    sizes: list[int] = []
    compress = zlib.compress

    def counted(data: bytes, level: int) -> bytes:
        sizes.append(len(data))
        return compress(data, level)

    monkeypatch.setattr("zlib.compress", counted)
    recent = Recent("lab")
    for number in range(100):
        recent.add(at(number / 100), topics.MAP, "", Environment(stamp_ns=1, name="lab"), b"x" * 50_000)
    recent.past(at(1.0))
    assert sum(sizes) == 5_000_000
    assert max(sizes) <= 600_000


def test_recent_past_shows_the_last_visitors_of_its_window(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(recent_module, "MAX_KEYS", 20)
    number = 300
    stay_s = 30.0
    past = kept(list(visitors(number, stay_s)), window_s=119.0).past(at(number * stay_s))
    last = {f"visitor{n}" for n in range(number - 4, number)}
    kinds = ("interaction", "hover", "selections", "refusals", "warnings")
    assert {(lane.user, lane.kind) for lane in past.timeline().lanes} == set(itertools.product(last, kinds))
    playback = Playback(past, 0.0)
    playback.seek(at(number * stay_s - 1.0), 0.0)
    assert [person.user for person in playback.status().people] == [f"visitor{number - 1}"]
    states = {(key, name) for key, name, _ in shown(playback)}
    assert states == {(row.key, f"visitor{number - 1}") for row in (topics.INTERACTION, topics.HOVER)} | {
        (topics.HEALTH.key, f"pointing.visitor{number - 1}")
    }


def test_robot_lane_shows_phase_owner_and_reason() -> None:
    lanes = Lanes()

    def tell(seconds: float, **fields: Any) -> None:
        zero = (0.0, 0.0, 0.0)
        known = {"position_m": zero, "velocity_mps": zero, "yaw_rad": 0.0, "radius_m": 0.2}
        state = RobotState.model_validate({"stamp_ns": at(seconds), "kind": "ground", **known, **fields})
        lanes.add(at(seconds), ROBOT_STATE, "cart", state)

    lanes.add(at(0.0), SERVICE_ALIVE, "robot.cart", body=True)
    tell(0.0, phase="idle")
    tell(1.0, phase="moving", user="anna")
    tell(2.0, phase="moving", user="anna")
    tell(3.0, phase="stopped", user="anna", reason="ben is 0.91 m away")
    tell(4.0, phase="stopped", user="anna", reason="ben is 0.87 m away")
    tell(5.0, phase="idle")
    tell(6.0, phase="taking_off")
    lanes.add(at(7.0), SERVICE_ALIVE, "robot.cart", body=False)

    (lane,) = lanes.lanes(at(0.0), at(7.0))
    assert (lane.kind, lane.user) == ("robot", "cart")
    assert lane.items == (
        (1.0, 3.0, "moving, steered by anna"),
        (3.0, 5.0, "stopped, steered by anna: ben is 0.91 m away"),
        (6.0, 7.0, "taking off"),
    )
