"""Instructions of a sample: what is counted, without Valgrind, which takes minutes."""

import os
from pathlib import Path

import pytest

from pointit.runtime.virtual_time import run_virtually
from pointit_lab.benchmarks import instructions


@pytest.mark.usefixtures("own_state")
def test_all_samples_give_cursors_between_the_two_marks(monkeypatch: pytest.MonkeyPatch) -> None:
    marks: list[None] = []
    monkeypatch.setattr(os, instructions.MARK, lambda: marks.append(None))
    monkeypatch.setattr(instructions, "PEOPLE", 2)
    monkeypatch.setattr(instructions, "DURATION_S", 0.2)
    assert run_virtually(instructions.drive()) >= 0.99 * 2 * 0.2 * instructions.RATE_HZ
    assert len(marks) == 2


def test_only_what_is_counted_between_the_marks_is_divided_by_the_samples(
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
    assert instructions.measure() == {"people": 20, "samples": 2000, "per_sample": 2000}
