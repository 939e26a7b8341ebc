"""The gate on recorded sessions: services of now, on what devices wrote then, must do what was accepted.

Everything is virtual time on a bus in memory. The recordings hold inputs only: samples, buttons, objects,
presence, configurations, the map. `accepted` holds what the services made of them: rays, poses, cursors,
hovers, events, cues, light (frames as hashes). A failing test shows a line for each key that changed, and
the first message that differs with the one accepted. Look at the change of one session:

    .venv/bin/python -m tests.replay goal

If it is wanted, `.venv/bin/python -m tests.replay --accept` stores what the replays give now and prints a
summary. Put that into the message of the commit and say why.
"""

import pytest

from tests.replay.golden import ACCEPTED, Outputs, accepted, compare, table
from tests.replay.sessions import RECORDINGS, SESSIONS, open_recording

HELP = "the docstring of tests/replay/test_replay.py says how to look at the change, and how to accept it"

MAX_BYTES = 2_000_000
"""Limit of all recordings and accepted outputs."""


@pytest.mark.parametrize("name", SESSIONS)
def test_services_give_the_accepted_results(name: str) -> None:
    with open_recording(name) as recording:
        outputs = Outputs(recording)
        assert not recording.invalid, recording.first_error
    report = compare(list(accepted(name)), outputs.samples)
    assert report.is_same, f"{table(name, report, outputs.began_ns)}\n{HELP}"
    missing = [each for each in SESSIONS[name].happens if not _has(outputs, each)]
    assert not missing, "the session shows too little"


def test_recordings_and_outputs_are_small_and_no_other() -> None:
    files = [*RECORDINGS.iterdir(), *ACCEPTED.iterdir()]
    assert {path.name.partition(".")[0] for path in files} == set(SESSIONS)
    assert sum(path.stat().st_size for path in files) <= MAX_BYTES


def _has(outputs: Outputs, wanted: str) -> bool:
    key, _, value = wanted.partition("=")
    found = (sample for sample in outputs.samples if sample.key == key)
    return any(not value or value in sample.content.values() for sample in found)
