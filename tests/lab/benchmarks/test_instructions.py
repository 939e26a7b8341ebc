"""Instructions of a sample: what is counted, without Valgrind, which takes minutes."""

import os
from pathlib import Path

import pytest

from pointit.runtime.virtual_time import run_virtually
from pointit_lab.benchmarks import instructions

pytestmark = pytest.mark.usefixtures("own_state")


@pytest.fixture(autouse=True)
def _small(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(instructions, "PEOPLE", 2)
    monkeypatch.setattr(instructions, "DURATION_S", 0.2)


def test_all_samples_give_cursors_between_the_two_marks() -> None:
    marks: list[None] = []
    came = run_virtually(instructions.drive(lambda: marks.append(None), read=instructions.COUNTED))
    samples = 2 * 0.2 * instructions.RATE_HZ
    assert came["users/{user}/cursor"] == pytest.approx(samples, abs=2)  # those of both ends
    assert 0 < came["users/{user}/hover"] < samples
    assert len(marks) == 2


def test_a_hop_is_what_its_service_adds() -> None:
    came = run_virtually(
        instructions.drive(lambda: None, left_out=instructions.HOPS[2:], read=instructions.COUNTED)
    )
    assert {key for key, count in came.items() if count} == {"users/{user}/imu", "users/{user}/ray"}


def test_bytecodes_are_counted_by_their_place() -> None:
    def loop(turns: int) -> None:
        for _ in range(turns):
            pass

    counts: list[int] = []
    for turns in (10, 20):
        counter = instructions.BytecodeCounter()
        counter.toggle()
        loop(turns)
        counter.toggle()
        loop(turns)
        of_loop = [count for (code, _), count in counter.executed.items() if code is loop.__code__]
        assert max(of_loop) <= turns + 1
        counts.append(sum(of_loop))
    assert counts[1] > counts[0]


def test_counts_between_the_marks_are_divided_by_the_samples(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    valgrind = tmp_path / "valgrind"
    valgrind.write_text(
        "#!/bin/sh\n"
        'for each; do case "$each" in --callgrind-out-file=*) out="${each#*=}";; esac; done\n'
        'for part in ".1 9" ".2 4000" " 9"; do\n'
        "    set -- $part\n"
        '    [ $# = 2 ] && echo "totals: ${2}000" > "$out$1" || echo "totals: 9" > "$out"\n'
        "done\n"
    )
    valgrind.chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path), prepend=os.pathsep)

    measured = instructions.measure()
    assert (measured["samples"], measured["per_sample"]) == (40, 100_000)
    assert measured["by_hop"] == dict.fromkeys(instructions.HOPS, 0)  # the same count for each run
    assert measured["messages"]["users/{user}/ray"] == pytest.approx(1.0, abs=0.1)
    assert measured["bytecodes"] > measured["different"] > 1000
    assert 0.0 < measured["cpu_us"] < 1e5
