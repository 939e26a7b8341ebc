"""Golden sessions: real services, simulated people, virtual time; every message must be the one recorded.

These tests hold behaviour while code is rearranged. They know the topic table, scenarios, parameters and the
bus in memory, and nothing of services' insides. `sessions.py` lists what is played, `record.py` says how
messages become hashes, `hashes.json` holds for each session and key the number of messages, the hash of all
but their floats, and a weighted sum of these.

A failing test names the changed keys in the order of the topic table, roughly from the wrist to the lights.
People see the lights, so a change of light may change how they move, and the first key is not always the
cause. The first message that differs is: dump the messages here and at the commit before, and compare:

    .venv/bin/python -m tests.golden --dump /tmp/after "scenario 3, fraction"
    diff /tmp/before/*.jsonl /tmp/after/*.jsonl | head

If the change is wanted, `.venv/bin/python -m tests.golden` rewrites hashes.json: commit that by itself and
say why. An entry `(sentences)` holds the texts of a key: where only such entries change, only wording did.
"""

import asyncio
from typing import Any

import pytest

from pointit.runtime.bus.memory_bus import MemoryBus
from pointit.schemas import Feedback, UserPose
from pointit.schemas.topics import FEEDBACK, POSE, Topic
from tests.golden.record import SENTENCES, Record, difference, read_hashes
from tests.golden.sessions import SESSIONS, play

HELP = "; the docstring of tests/golden/test_golden.py says how to look at the change, and how to record it"


@pytest.mark.parametrize("name", SESSIONS)
def test_messages_are_those_recorded(name: str) -> None:
    session = SESSIONS[name]
    record = play(session, Record)
    missing = [message for message in session.happens if not record.has(message)]
    assert missing == [], "the session shows too little"

    recorded = read_hashes().get(name, {})
    changed = difference(recorded, record.hashes())
    assert not changed, f"{name}: {changed}{HELP}"


def test_the_file_has_the_sessions_and_no_other() -> None:
    assert list(read_hashes()) == list(SESSIONS)


def hashes_of(*messages: Feedback | UserPose) -> dict[str, str]:
    async def record() -> dict[str, str]:
        bus = MemoryBus()
        recorded = Record(bus)
        for message in messages:
            topic: Topic[Any] = FEEDBACK if isinstance(message, Feedback) else POSE
            bus.publisher(topic, "anna").put(message)
        await asyncio.sleep(0.01)
        await bus.close()
        return recorded.hashes()

    return asyncio.run(record())


def pose(x_m: float, seq: int = 0) -> UserPose:
    return UserPose(stamp_ns=1, seq=seq, position_m=(x_m, 0.0, 0.0), yaw_rad=0.0)


def test_a_difference_names_the_first_changed_key_with_both_counts() -> None:
    cue = Feedback(stamp_ns=1, cue="stopped")
    before = hashes_of(pose(1.0), pose(2.0, seq=1), cue)
    after = hashes_of(pose(1.0))
    assert difference(before, before) == ""
    assert difference(before, after).startswith(
        "users/anna/pose changed first: 2 messages were recorded, 1 came"
    )
    assert "also changed: users/anna/feedback" in difference(before, after)


def test_comparison_ignores_last_digits_but_not_order_or_hundredths() -> None:
    one = hashes_of(pose(1.0))
    assert not difference(one, hashes_of(pose(1.0 + 1e-9)))
    assert difference(one, hashes_of(pose(1.00002)))

    both = hashes_of(pose(1.0), pose(2.0))
    swapped = hashes_of(pose(2.0), pose(1.0))
    assert difference(both, swapped)


def test_a_change_of_wording_changes_the_entry_for_sentences_alone() -> None:
    before = hashes_of(Feedback(stamp_ns=1, cue="refused", text="go on"))
    after = hashes_of(Feedback(stamp_ns=1, cue="refused", text="wait, please"))
    changed = difference(before, after)
    assert changed.startswith(f"users/anna/feedback{SENTENCES} changed first")
    assert "also" not in changed
