"""The runner of mutants, and that its rows fit the code; `scripts/mutants` runs the mutants themselves."""

from pathlib import Path

import pytest

from tests.mutants import __main__ as runner
from tests.mutants import fresh

SOURCE = "def area(a, b):\n    return a * b\n"
LINE = "return a * b"
MUTATED = "return a + b"


@pytest.fixture
def project(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a project of one module and its test, in place of this one."""
    monkeypatch.setattr(runner, "ROOT", tmp_path)
    monkeypatch.setattr(runner, "SOURCES", ("src",))
    sources = tmp_path / "src"
    root = Path(__file__).parents[2]
    monkeypatch.setenv("PYTHONPATH", f"{sources}:{root}")
    sources.mkdir()
    (sources / "shape.py").write_text(SOURCE, encoding="utf-8")
    (tmp_path / "test_shape.py").write_text(
        "import shape\n\ndef test_area():\n    assert shape.area(2, 3) == 6\n", encoding="utf-8"
    )
    (tmp_path / "test_other.py").write_text("def test_other():\n    pass\n", encoding="utf-8")
    return tmp_path


def mutant(mutated: str = MUTATED, *, line: str = LINE, test: str = "test_shape.py") -> runner.Mutant:
    return runner.Mutant("src/shape.py", line, mutated, test)


def test_each_row_names_one_line_and_a_test_that_exist() -> None:
    errors = list(filter(None, (row.error() for row in runner.read())))
    assert not errors, "\n".join([*errors, "mend tests/mutants/mutants.toml: scripts/mutants --help"])


def test_no_mutant_is_listed_twice() -> None:
    rows = [(row.file, row.line, row.mutated) for row in runner.read()]
    assert len(rows) == len(set(rows))


@pytest.mark.parametrize(
    ("each", "complaint"),
    [
        (mutant(), ""),
        (
            mutant(line="return a - b"),
            "found 0 times instead of once: return a - b\n  nearest line: return a * b",
        ),
        (mutant("return a +"), "is no Python"),
        (mutant(LINE), "is not changed"),
        (mutant(test="test_shape.py::test_volume"), "test_volume: no such test"),
    ],
)
def test_error_says_what_to_mend(project: Path, each: runner.Mutant, complaint: str) -> None:
    assert project.is_dir()
    error = each.error()
    if complaint:
        assert complaint in error
    else:
        assert error == ""


@pytest.mark.parametrize(
    ("each", "expected"),
    [
        (mutant(), "killed"),
        (mutant("return b * a"), "SURVIVED"),
        (mutant(test="test_other.py"), "SURVIVED (the test does not import the mutated file)"),
    ],
)
def test_verdict_is_what_the_test_did(project: Path, each: runner.Mutant, expected: str) -> None:
    assert runner.verdict(each) == expected
    assert (project / "src" / "shape.py").read_text(encoding="utf-8") == SOURCE


def test_a_file_that_is_imported_through_a_link_is_mutated(project: Path) -> None:
    (project / "src").rename(project / "files")
    (project / "src").symlink_to("files")
    linked = runner.Mutant("files/shape.py", LINE, MUTATED, "test_shape.py")
    assert runner.verdict(linked) == "killed"


def test_mutant_that_cannot_be_imported_is_broken_not_killed(project: Path) -> None:
    each = mutant("def area(a, b, c=undefined):", line="def area(a, b):")
    assert project.is_dir()
    assert runner.verdict(each).startswith("BROKEN (pytest ended with 2)")


def test_seed_draws_the_same_lines_of_cores_except_excluded_ones() -> None:
    drawn = fresh.sample(20, "a seed", set())
    (first_file, first_line, _), *others = drawn
    assert others == fresh.sample(19, "a seed", {(first_file, first_line)})

    assert all(fresh.unit_tests(file) for file, _, _ in drawn)


def test_equivalent_mutants_are_those_of_lines_that_are_there() -> None:
    rows = runner.read(runner.EQUIVALENT)
    for row in rows:
        source = (runner.ROOT / row.file).read_text("utf-8")
        assert row.line in source, row
        assert row.test, row
