"""Plans of studies, and their rows."""

import itertools
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import pytest
from click.testing import CliRunner
from hypothesis import given, settings
from hypothesis import strategies as st

import pointit
from pointit import study_report
from pointit.cli.study import check
from pointit.errors import PointItError
from pointit.runtime.errors import ConfigError
from pointit.study.check import check_folder
from pointit.study.model import Study, read_study
from pointit.study.order import imbalance, square
from pointit.study.plan import check_sequences, plan_of
from pointit.study.session import Session
from pointit.study.simulated import SimulatedView
from pointit.study.study_folder import StudyFolder
from pointit.study.study_site import SiteOptions
from tests.unit.study.studies import small

BASE = {"name": "s", "task": {"kind": "reach"}}


def study(**fields: object) -> Study:
    return Study.model_validate({**BASE, **fields}, strict=False)


def factor_text(vary: str, name: str) -> str:
    return f"{{vary: {vary}, levels: {{x: {{task.{name}: 0.6}}, y: {{task.{name}: 0.9}}}}}}"


def factor(levels: int, vary: str, parameter: str) -> dict[str, object]:
    return {
        "vary": vary,
        "levels": {f"{parameter[-1]}{n}": {parameter: 0.1 * (n + 1)} for n in range(levels)},
    }


@given(conditions=st.integers(1, 12))
def test_williams_squares_balance_positions_and_sequences(conditions: int) -> None:
    rows = [[str(each) for each in row] for row in square("williams", conditions)]
    assert imbalance(rows, "williams") == ""
    if conditions > 2:
        assert imbalance(rows[:-1], "williams")
    followers = Counter(pair for row in rows for pair in itertools.pairwise(row))
    assert len(followers) == conditions * (conditions - 1)
    assert len(set(followers.values())) <= 1
    assert (
        imbalance([[str(n) for n in row] for row in square("latin_square", conditions)], "latin_square") == ""
    )


@settings(deadline=None, max_examples=25)
@given(
    blocks=st.integers(2, 5),
    inner=st.integers(2, 4),
    groups=st.sampled_from([1, 2]),
    rounds=st.integers(1, 2),
    order=st.sampled_from(["latin_square", "williams", "blocked_random"]),
    repetitions=st.integers(1, 3),
    practice=st.integers(0, 3),
    seed=st.integers(0, 99),
)
def test_participants_have_each_cell_equally_often_and_orders_balance(
    *,
    blocks: int,
    inner: int,
    groups: int,
    rounds: int,
    order: str,
    repetitions: int,
    practice: int,
    seed: int,
) -> None:
    factors = {"b": factor(blocks, "block", "x.b"), "t": factor(inner, "trial", "task.t")}
    if groups == 2:
        factors["g"] = factor(2, "between", "x.g")
    rows = len(square("williams" if order == "williams" else "latin_square", blocks))
    people = rows * groups * rounds
    made = study(
        participants=people,
        factors=factors,
        order=order,
        repetitions=repetitions,
        practice=practice,
        seed=seed,
    )
    plans = [plan_of(made, name) for name in made.people]

    assert plans == [plan_of(made, name) for name in made.people]
    for plan in plans:
        cells = Counter(tuple(trial.cell.values()) for trial in plan.trials if not trial.practice)
        assert set(cells.values()) == {repetitions}
        assert len(cells) == blocks * inner
        assert [trial.number for trial in plan.trials] == list(range(1, len(plan.trials) + 1))
        assert sum(trial.practice for trial in plan.trials) == practice * blocks
        assert sorted(plan.order) == sorted(plans[0].order)
    for group in {tuple(plan.group.items()) for plan in plans}:
        orders = [plan.order for plan in plans if tuple(plan.group.items()) == group]
        assert len(orders) == people / groups
        assert imbalance(orders, made.order) == ""


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        (
            "participants: 5",
            "5 participants cannot balance 3 conditions in order williams; use a multiple of 6, such as 6",
        ),
        ("participants: [anna, anna]", "participants: anna is there twice"),
        ("task: {kind: reach, width_m: -1}", "task.reach.width_m: must be above 0"),
        ("end: hover", "end: use selection, press, timeout, or FILE.py:FUNCTION"),
        ("questionnaires: [tlx]", "use one of nasa-tlx, sus or write items"),
        ("repetitoins: 3", "repetitions"),
        (
            "factors: {m: {levels: {a: {x.y: 1}, b: {x.z: 1}}}}",
            "level b and level a must set the same parameters; x.y is only in one",
        ),
        (
            "factors: {m: {vary: trial, levels: {a: {x.y: 1}, b: {x.y: 2}}}}",
            "x.y cannot change from trial to trial",
        ),
        (
            "factors: {m: {vary: trial, levels: {a: {task.width: 1}, b: {task.width: 2}}}}",
            "task in a: no parameter width; did you mean width_m",
        ),
        ("task: {kind: reaching}", "task.kind: no kind 'reaching'; did you mean reach?"),
        ("task: {kind: dance}", "task.kind: no kind 'dance'; there are reach, tapping, packages, places,"),
        ("scenario: strip", "no scenario 'strip': give a .yaml file, or did you mean strips?"),
        ("scenario: hall", "'hall': give a .yaml file, or there are belts, robots, space, strips"),
        ("questionnaires: [sus, sus]", "sus is there twice: their answers could not be told apart"),
        (
            f"factors: {{m: {{levels: {{{', '.join(f'l{n}: {{x.y: {n}}}' for n in range(1001))}}}}}}}",
            "the factors have 1001 combinations of levels; 1000 at most",
        ),
        ("factors: {target: {levels: {a: {x.y: 1}, b: {x.y: 2}}}}", "factor target: use another name"),
    ],
)
def test_bad_study_is_refused_in_one_sentence(tmp_path: Path, change: str, sentence: str) -> None:
    lines = {
        "name": "name: s",
        "participants": "participants: 6",
        "task": "task: {kind: reach}",
        "factors": "factors: {m: {levels: {a: {x.y: 1}, b: {x.y: 2}, c: {x.y: 3}}}}",
    }
    file = tmp_path / "s.yaml"
    file.write_text("\n".join({**lines, change.partition(":")[0]: change}.values()))
    with pytest.raises(ConfigError) as refused:
        read_study(file)
    assert sentence in str(refused.value)
    assert "{" not in str(refused.value)
    assert str(refused.value).startswith(str(file))
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ("repetitions: 4", "repetitions: 4: a: a block has 3 movements with one distance and width"),
        ("repetitions: 5", "throughput needs 5; use repetitions: 6 or more"),
        ("repetitions: 6", ""),
        ("repetitions: 5\npractice: 3", "a block has 4 movements"),
        (f"repetitions: 6\nfactors: {{w: {factor_text('trial', 'width_m')}}}", ""),
        (f"repetitions: 5\nfactors: {{w: {factor_text('trial', 'width_m')}}}", "use repetitions: 6 or more"),
        (f"repetitions: 4\nfactors: {{w: {factor_text('between', 'width_m')}}}", "a block has 3 movements"),
        ("repetitions: 4\ntask: {kind: tapping, strip: '0', distance_m: 1.5}", "a block has 3 movements"),
        ("repetitions: 1\ntask: {kind: reach}", ""),
    ],
)
def test_check_refuses_tapping_whose_blocks_have_no_throughput(
    tmp_path: Path, change: str, sentence: str
) -> None:
    lines = {
        "name": "name: s",
        "participants": "participants: 6",
        "scenario": "scenario: strips" if "strip:" in change else "scenario: space",
        "task": "task: {kind: tapping, width_m: 0.6, distance_m: 1.5, center_m: [5.0, 0.5, 1.5]}",
        "factors": "factors: {m: {levels: {a: {selector.method: hold}, b: {selector.method: gauge}}}}",
    }
    for line in change.splitlines():
        lines[line.partition(":")[0]] = line
    file = tmp_path / "s.yaml"
    file.write_text("\n".join(lines.values()))

    checked = CliRunner().invoke(check, [str(file)])
    assert sentence in str(checked.exception or "")
    assert (checked.exit_code == 0) == (sentence == "")

    StudyFolder(tmp_path / "data", read_study(file), file.read_text())
    texts = [found.text for found in check_folder(tmp_path / "data") if found.severity == "error"]
    assert texts == ([str(checked.exception)] if sentence else [])


def test_advised_repetitions_are_enough_where_distances_alternate_at_random(tmp_path: Path) -> None:
    file = tmp_path / "s.yaml"
    text = "name: s\nparticipants: 3\ntask: {kind: tapping}\n"
    text += f"factors: {{d: {factor_text('trial', 'distance_m')}}}\n"
    file.write_text(text + "repetitions: 6\n")
    with pytest.raises(ConfigError, match=r"use repetitions: (\d+) or more") as refused:
        check_sequences(read_study(file))
    advised = int(str(refused.value).split("use repetitions: ")[1].split()[0])
    file.write_text(text + f"repetitions: {advised - 1}\n")
    with pytest.raises(ConfigError):
        check_sequences(read_study(file))
    file.write_text(text + f"repetitions: {advised}\n")
    check_sequences(read_study(file))


def test_names_in_studies_are_literal_text(tmp_path: Path) -> None:
    file = tmp_path / "s.yaml"
    file.write_text(
        "name: s\nparticipants: [01, 1, 2e1, on]\norder: as_written\ntask: {kind: reach, strips: [010]}\n"
        "settings: {localizer.robot_id: 010, led-driver.max_rate_hz: 060}\n"
        "factors: {m: {vary: between, levels: {on: {pui.map: 1.10}, off: {pui.map: no}}}}\n"
        "instructions: {on: 12:30, off: 7}\n"
    )

    study = read_study(file)
    assert study.people == ("01", "1", "2e1", "on")
    assert study.task.model_dump()["strips"] == ("010",)
    assert list(study.factors["m"].levels) == ["on", "off"]
    assert {level: step.text for level, step in study.instructions.items()} == {"on": "12:30", "off": "7"}

    run = pointit.run(settings=study.services({"m": "off"}))
    with pytest.raises(ConfigError, match="map 'no' is not shipped"):
        run.check()

    settings = {name: value for name, value in study.services({"m": "on"}).items() if name != "pui.map"}
    configs = {each.service.NAME: each.config.model_dump() for each in pointit.run(settings=settings).check()}
    assert configs["localizer"]["robot_id"] == "010"
    assert configs["led-driver"]["max_rate_hz"] == 60.0


RATIOS = """
name: ratios
participants: 2
order: latin_square
task: {kind: reach}
factors:
  ratio: {levels: {'1.1': {task.width_m: 0.2}, '1.10': {task.width_m: 0.3}}}
questionnaires: [sus]
"""


@pytest.fixture
def ratios(tmp_path: Path) -> tuple[Study, StudyFolder]:
    """Return a study whose levels a spreadsheet cannot tell apart, with the trials and answers of P01."""
    study, folder = small(tmp_path, RATIOS)
    table = folder.trials("P01")
    answers = folder.answers("P01")
    for trial in plan_of(study, "P01").trials:
        usual = {"participant": "P01", "block": trial.block, "attempt": 1, "practice": False}
        numbers = {"selection_s": 1.5, "path_length_deg": 12.5, "corrections": 1}
        row = {**usual, "trial": trial.number, "outcome": "hit", **trial.cell, **numbers}
        table.append({**row, "began_utc": f"2026-03-02T09:0{trial.number}:00+00:00"})
        answers.append(
            *(
                {**usual, "questionnaire": "sus", "condition": trial.cell["ratio"], "item": item, "value": 3}
                for item in range(1, 11)
            )
        )
    table.close()
    answers.close()
    folder.put_about("P01", {"pseudonym": "P01", "simulated": False, "seed": 0, "begun": "2026-03-02 09:00"})
    return study, folder


def verdicts(study: Study, folder: StudyFolder) -> dict[str, str]:
    """Return the first error of check, run and report by their name, `""` if there is none."""

    def run() -> None:
        Session(
            study, folder, "P01", SimulatedView(0, lambda _: None), SiteOptions(imu="page")
        )._table.close()
        folder.answers("P01").close()

    def check() -> None:
        for finding in check_folder(folder.path):
            if finding.severity == "error" and finding.participant:
                raise PointItError(finding.text)

    found: dict[str, str] = {}
    calls: dict[str, Callable[[], object]] = {
        "check": check,
        "run": run,
        "report": lambda: study_report.trials(folder.path),
    }
    for name, call in calls.items():
        try:
            call()
        except PointItError as error:
            found[name] = str(error)
        else:
            found[name] = ""
    return found


def replace_in(path: Path, before: bytes, after: bytes) -> None:
    content = path.read_bytes()
    assert before in content
    path.write_bytes(content.replace(before, after))


def test_planned_rows_are_accepted_by_check_run_and_report(ratios: tuple[Study, StudyFolder]) -> None:
    assert verdicts(*ratios) == {"check": "", "run": "", "report": ""}


@pytest.mark.parametrize(
    ("table", "before", "after", "sentence"),
    [
        ("trials.csv", b",1.10,", b",1.1,", "not that of the plan: ratio is '1.1', in the plan '1.10'"),
        ("trials.csv", b"P01,2,2,1,", b"P01,2,7,1,", "trial 7 is not that of the plan, which has 2"),
        ("trials.csv", b"P01,2,2,1,", b"P02,2,2,1,", "P01 has data of P02"),
        ("trials.csv", b",1.10,", b",1.2,", "ratio '1.2' is not of the study"),
        ("trials.csv", b",12.5,", b",1e999,", "line 2: path_length_deg is '1e999', not a number or empty"),
        ("answers.csv", b",1.10,", b",1.1,", "block 2 has condition '1.1', in the plan '1.10'"),
        ("answers.csv", b"P01,", b"P02,", "P01 has answers of P02"),
    ],
)  # fmt: skip
def test_damaged_rows_are_refused_alike_by_check_run_and_report(
    ratios: tuple[Study, StudyFolder], table: str, before: bytes, after: bytes, sentence: str
) -> None:
    replace_in(ratios[1].path / "P01" / table, before, after)
    found = verdicts(*ratios)
    assert all(sentence in text for text in found.values()), found


def test_rows_without_a_record_are_noted_and_not_continued(
    ratios: tuple[Study, StudyFolder],
) -> None:
    study, folder = ratios
    table = folder.path / "P01/trials.csv"
    replace_in(table, table.read_bytes().splitlines(keepends=True)[2], b"")
    (folder.path / "P01/participant.yaml").unlink()
    sentence = "does not state whether the trials are of a person"
    session = Session(study, folder, "P01", SimulatedView(0, lambda _: None), SiteOptions(imu="page"))
    with pytest.raises(ConfigError, match=sentence):
        pointit.run_virtually(session.run())
    assert any(sentence in each.text and each.severity == "error" for each in check_folder(folder.path))
    assert any(sentence in note for note in study_report.trials(folder.path).notes)
