"""Check that tests notice mistakes: `scripts/mutants --help`.

Each row of `mutants.toml` is a mutant: a mistake of one line that users would feel, and the test that must
fail because of it. The test runs once unchanged, where it must pass, and once with the line replaced while
Python imports its file (`plugin.py`): the files themselves are never touched.

- killed: the test failed, as it must.
- SURVIVED: the test passed. It has lost the behaviour: mend the test, not the row.
- BROKEN: pytest ended otherwise, for instance because the changed module can no longer be imported.

`scripts/mutants --fresh N` draws N mistakes in the cores that are no rows (`fresh.py`) and runs the unit
tests of their rooms, then the golden and the replayed sessions, until one fails. Those that survive need a
test, or a row in `equivalent.toml` with the reason if no behaviour differs.

`scripts/mutants FILE --by TEST` makes a mistake in each line of one file and counts those that this test file
finds: before and after it is rewritten. `--sample N` makes N of them.

When code moves, `scripts/mutants --check` names the rows whose line is no longer found exactly once, and
where such a line is now; `--mend` enters the new path where only one file has it, and leaves out the names of
tests that are gone. To add a mutant, append a row whose mistake changes behaviour and whose test is quick.
"""

import argparse
import difflib
import json
import os
import random
import re
import resource
import subprocess
import sys
import time
import tomllib
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from tests.mutants import fresh
from tests.mutants.plugin import NOT_IMPORTED, VARIABLE, mutate

ROOT = Path(__file__).parents[2]
ROWS = Path(__file__).with_name("mutants.toml")
EQUIVALENT = Path(__file__).with_name("equivalent.toml")
"""Mistakes that change nothing, each with the reason in place of a test."""
SOURCES = ("pointit", "schemas", "services", "bridges")
TIMEOUT_S = 30
"""Limit of a single test (s). A mutant that makes a test hang is killed."""
PASSED = 0
"""Exit code of pytest: all passed."""
FAILED = 1
"""Exit code: some failed. The others mean that it was interrupted or found no test."""


@dataclass(frozen=True)
class Mutant:
    """A row of `mutants.toml`."""

    file: str
    """Path of the mutated module, relative to the root of the repository."""
    line: str
    """Original line without indentation. It occurs exactly once in `file`."""
    mutated: str
    """Line to put in its place, without indentation."""
    test: str
    """Test file or node id that fails with the mutant."""

    def error(self) -> str:
        """Return the problem of the row, or `""`."""
        path = ROOT / self.file
        if not path.is_file():
            return f"{self.file}: no such file{self._elsewhere()}"
        try:
            source = mutate(path.read_text("utf-8"), self.line, self.mutated)
            compile(source, self.file, "exec")
        except ValueError as error:
            return f"{self.file}: {error}{self._elsewhere()}"
        except SyntaxError as error:
            return f"{self.file}: mutated line is no Python: {error}"
        if self.line == self.mutated:
            return f"{self.file}: line is not changed: {self.line}"
        test, *names = self.test.split("::")
        path = ROOT / test
        if not path.is_file():
            return f"{self.test}: no such test"
        tests = path.read_text("utf-8")
        for name in names:
            function, _, _ = name.partition("[")
            if function not in tests:
                return f"{self.test}: no such test"
        return ""

    def homes(self) -> list[str]:
        """Return the product files that contain the line exactly once."""
        homes: list[str] = []
        for source in SOURCES:
            for path in sorted((ROOT / source).rglob("*.py")):
                lines = [text.strip() for text in path.read_text("utf-8").splitlines()]
                if lines.count(self.line) == 1:
                    homes.append(path.relative_to(ROOT).as_posix())
        return homes

    def _elsewhere(self) -> str:
        """Return a hint where the line may be now."""
        homes = self.homes()
        if homes:
            return f"\n  the line is in {', '.join(homes)}"
        lines: list[str] = []
        path = ROOT / self.file
        if path.is_file():
            lines = [text.strip() for text in path.read_text("utf-8").splitlines()]
        nearest = difflib.get_close_matches(self.line, lines, n=1)
        return f"\n  nearest line: {nearest[0]}" if nearest else ""


def read(path: Path = ROWS) -> list[Mutant]:
    """Return the mutants in the order of the file."""
    rows = tomllib.loads(path.read_text("utf-8"))["mutant"]
    return [Mutant(**row) for row in rows]


def mend(path: Path = ROWS) -> None:
    """Correct the rows whose line is now in exactly one other file, or whose test was renamed.

    Instead of a test that was renamed its whole file is run.
    """
    text = path.read_text("utf-8")
    head, *rows = text.split("[[mutant]]\n")
    for index, mutant in enumerate(read(path)):
        if not mutant.error():
            continue
        homes = mutant.homes()
        if mutant.file not in homes and len(homes) == 1:
            rows[index] = rows[index].replace(mutant.file, homes[0], 1)
        test, *names = mutant.test.split("::")
        test_path = ROOT / test
        if not names or not test_path.is_file():
            continue
        if names[-1] not in test_path.read_text("utf-8"):
            rows[index] = rows[index].replace(mutant.test, test, 1)
    mended = "[[mutant]]\n".join([head, *rows])
    path.write_text(mended, "utf-8")


def run_tests(tests: Sequence[str], mutant: Mutant | None = None) -> tuple[int, str]:
    """Run `tests` in a process of their own, with `mutant` if given.

    Returns:
        The exit code of pytest and what it printed.
    """
    options = ["-q", "--no-header", "--tb=short", "-p", "no:cacheprovider", "-p", "tests.mutants.plugin"]
    options += ["-o", f"timeout={TIMEOUT_S}", "--hypothesis-seed=0"]
    environment = os.environ | {"OPENBLAS_NUM_THREADS": "1"}
    environment.pop("PYTHONDONTWRITEBYTECODE", None)
    if mutant is not None:
        options += ["-x"]
        file = {"file": str(ROOT / mutant.file)}
        environment[VARIABLE] = json.dumps(asdict(mutant) | file)
    process = subprocess.run(
        [sys.executable, "-m", "pytest", *options, *tests],
        cwd=ROOT,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    return process.returncode, process.stdout + process.stderr


def verdict(mutant: Mutant) -> str:
    """Return `"killed"`, or the problem."""
    code, printed = run_tests([mutant.test], mutant)
    if code == FAILED:
        return "killed"
    if code == PASSED:
        if NOT_IMPORTED in printed:
            return f"SURVIVED ({NOT_IMPORTED})"
        return "SURVIVED"
    return f"BROKEN (pytest ended with {code})\n{printed}"


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the mutants that `arguments` choose; return 0 if their tests killed all of them."""
    parser = argparse.ArgumentParser(
        prog="scripts/mutants", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("part", nargs="*", help="only mutants whose file or test contains this text")
    parser.add_argument("--sample", type=int, metavar="N", help="only N of them, chosen by --seed")
    parser.add_argument(
        "--fresh", type=int, metavar="N", help="N mistakes that are no rows, chosen by --seed"
    )
    parser.add_argument("--by", metavar="TEST", help="mistakes of the file `part` that this test file finds")
    parser.add_argument("--seed", default="0", help="any text; the same text chooses the same mutants")
    parser.add_argument("--check", action="store_true", help="only check the rows; run no test")
    parser.add_argument(
        "--mend",
        action="store_true",
        help="first correct rows whose file was moved or whose test was renamed",
    )
    chosen = parser.parse_args(arguments)
    if chosen.fresh is not None:
        return _run_fresh(chosen.fresh, chosen.seed, chosen.part)
    if chosen.by is not None:
        (file,) = chosen.part or [""]
        return _run_by(file, chosen.by, chosen.sample, chosen.seed)
    if chosen.mend:
        mend()
    mutants = [mutant for mutant in read() if _is_chosen(mutant, chosen.part)]
    if chosen.sample is not None:
        count = min(chosen.sample, len(mutants))
        mutants = random.Random(chosen.seed).sample(mutants, count)
    errors = list(filter(None, (mutant.error() for mutant in mutants)))
    _say("\n".join([*errors, f"{len(mutants)} mutants, {len(errors)} rows to mend"]))
    if errors or not mutants:
        return 1
    if chosen.check:
        return 0
    return _run(mutants)


def _is_chosen(mutant: Mutant, parts: Sequence[str]) -> bool:
    """Return True if file or test contains one of `parts`, or there are none."""
    text = f"{mutant.file} {mutant.test}"
    return not parts or any(part in text for part in parts)


def _run_by(file: str, test: str, count: int | None, seed: str) -> int:
    """Print how many mistakes of `file` a test file finds. Return 1 if it fails without any."""
    code, printed = run_tests([test])
    if code != PASSED:
        _say(f"{printed}\n{test} fails without any mistake.")
        return 1
    mistakes = fresh.of_file(file, seed)[:count]
    killed = 0
    for line, mutated in mistakes:
        answer = verdict(Mutant(file, line, mutated, test))
        is_killed = not answer.startswith("SURVIVED")  # BROKEN: it can no longer be imported
        killed += is_killed
        if not is_killed:
            _say(f"{file}: {line} -> {mutated}: {answer}")
    _say(f"{test} finds {killed} of {len(mistakes)} mistakes in {file}")
    return 0


def _say(text: str) -> None:
    sys.stdout.write(f"{text}\n")
    sys.stdout.flush()


def _run(mutants: Sequence[Mutant]) -> int:
    """Run the tests of `mutants` without and with them; return 0 if all are killed."""
    tests = {mutant.test for mutant in mutants}
    code, printed = run_tests(sorted(tests))
    if code != PASSED:
        _say(f"{printed}\nThe tests fail without any mutant.")
        return 1
    killed = 0
    for mutant in mutants:
        start_s = time.monotonic()
        answer = verdict(mutant)
        took_s = time.monotonic() - start_s
        killed += answer == "killed"
        _say(f"{took_s:5.1f} s  {mutant.file}: {mutant.mutated}: {answer}")
    _say(f"{killed} of {len(mutants)} killed, {_children_s():.0f} s of CPU")
    return int(killed < len(mutants))


def _children_s() -> float:
    """Return the CPU time of the processes that have ended."""
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime


def _run_fresh(count: int, seed: str, parts: Sequence[str]) -> int:
    """Run the tests of rooms and the nets with fresh mutants; return 0 if nine in ten are killed."""
    rows = {(row.file, row.line) for row in read()}
    reasons: dict[tuple[str, str, str], str] = {}
    for row in read(EQUIVALENT):
        reasons[row.file, row.line, row.mutated] = row.test
    tally: Counter[str] = Counter()
    for file, line, mutated in fresh.sample(count, seed, rows):
        mutant = Mutant(file, line, mutated, "")
        if not _is_chosen(mutant, parts):
            continue
        start_s = time.monotonic()
        answer = "equivalent"
        detail = reasons.get((file, line, mutated), "")
        if not detail:
            answer, detail = _fresh_verdict(mutant)
        took_s = time.monotonic() - start_s
        tally[answer] += 1
        _say(f"{took_s:5.1f} s  {answer}  {file}: {line} -> {mutated}  {detail}")
    _say(f"{dict(tally)}, {_children_s():.0f} s of CPU")
    judged = tally["killed"] + tally["SURVIVED"]
    return int(tally["killed"] < 0.9 * judged)


def _fresh_verdict(mutant: Mutant) -> tuple[str, str]:
    """Return `killed` or `SURVIVED`, and the test that failed."""
    for tests in (fresh.unit_tests(mutant.file), fresh.NETS):
        code = PASSED
        printed = ""
        if tests:
            code, printed = run_tests(tests, mutant)
        if code != PASSED:  # also an import that is no longer possible
            failed = re.search(r"^(?:FAILED|ERROR) (\S+)", printed, re.MULTILINE)
            return "killed", failed[1] if failed else f"pytest ended with {code}"
    return "SURVIVED", ""


if __name__ == "__main__":
    sys.exit(main())
