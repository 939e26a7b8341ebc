"""Studies of simulated people, and what must be ready before."""

import json
import os
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
from click.testing import CliRunner

import pointit
from pointit.cli.study import check
from pointit.cli.study import command as run
from pointit.runtime.errors import ConfigError, PointItError
from pointit.study import simulated
from pointit.study.check import check_folder
from pointit.study.model import Study, read_study
from pointit.study.plan import plan_of
from pointit.study.scenario import check_ready
from pointit.study.session import Session, StoppedError
from pointit.study.simulated import SimulatedView, person_of, simulate
from pointit.study.study_folder import StudyFolder
from pointit.study.study_site import SiteOptions
from pointit.study.study_step import Picture
from pointit.study.table_file import columns_of
from pointit.study.view import StudyCommand, StudyStatus
from tests.unit.study.studies import SMALL, read_rows, simulate_all, small


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> tuple[Study, StudyFolder]:
    made = small(tmp_path_factory.mktemp("whole"))
    simulate_all(*made)
    return made


def test_simulated_study_is_whole_and_checked(whole: tuple[Study, StudyFolder]) -> None:
    study, folder = whole
    for name in study.people:
        rows = read_rows(folder.path / name / "trials.csv")
        assert [row["trial"] for row in rows] == ["1", "2", "3", "4"]
        assert list(rows[0]) == [column for column, _, _ in columns_of(["method"])]
        assert all(row["outcome"] == "hit" and float(row["selection_s"]) < 10.0 for row in rows)
        assert len(read_rows(folder.path / name / "answers.csv")) == 2 * 10
        about = folder.about(name)
        assert about["order"] == [rows[0]["method"], rows[3]["method"]]
        assert about["configuration"][0]["services"]["selector"]["method"] == about["order"][0]
    assert check_folder(folder.path) == []
    with pytest.raises(ConfigError, match="P02 has finished; give another one"):
        simulate(study, folder, "P02", lambda _status: None)


class _KilledError(BaseException):
    """The process ends here."""


@pytest.mark.slow
@pytest.mark.parametrize("step", [1, 6])
def test_study_continues_at_the_trial_after_kill_9(
    step: int, whole: tuple[Study, StudyFolder], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Step 2n ends the process after the row of trial n + 1 is written, 2n + 1 in the middle of the next."""
    study, folder = small(tmp_path)
    fsync: Callable[[int], None] = os.fsync

    def kill(number: int) -> None:
        fsync(number)
        if (folder.path / "P01/trials.csv").exists() and len(
            read_rows(folder.path / "P01/trials.csv")
        ) > step // 2:
            raise _KilledError

    monkeypatch.setattr(os, "fsync", kill)
    with pytest.raises(_KilledError):
        simulate(study, folder, "P01", lambda _status: None)

    monkeypatch.setattr(os, "fsync", fsync)
    if step % 2:
        with (folder.path / "P01/trials.csv").open("a") as file:
            file.write(f"P01,1,{step // 2 + 2},1,0,ho")
    simulate(study, folder, "P01", lambda _status: None)

    rows = read_rows(folder.path / "P01/trials.csv")
    assert [(row["trial"], row["attempt"]) for row in rows] == [(str(n), "1") for n in range(1, 5)]
    for name in ("trials.csv", "answers.csv", "participant.yaml"):
        assert (folder.path / "P01" / name).read_bytes() == (whole[1].path / "P01" / name).read_bytes()
    assert all(
        finding.severity == "note" and not finding.participant for finding in check_folder(folder.path)
    )


@pytest.mark.long
def test_interrupted_simulated_participant_goes_on_with_the_same_bytes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The person tires, blocks restart the site, and answers and attempts to repeat are random, too."""
    text = SMALL.replace("repetitions: 2", "repetitions: 3").replace(
        "{kind: reach}", "{kind: reach, others: 2}"
    )
    text += "practice: 1\nconsent: Do you agree?\n"
    text = text.replace(
        "gauge: {selector.method: gauge}", "gauge: {selector.method: gauge, pointing.filter: steady}"
    )
    text = text.replace(
        "hold: {selector.method: hold}", "hold: {selector.method: hold, pointing.filter: normal}"
    )
    study, done = small(tmp_path / "done", text)
    lossy = {"user-sim.wristband.dropout_share": 0.5, "user-sim.wristband.dropout_burst_s": 4.0}
    monkeypatch.setattr(simulated, "LIGHT", {**simulated.LIGHT, **lossy})
    simulate(study, done, "P02", lambda _status: None)
    whole_bytes = {file.name: file.read_bytes() for file in (done.path / "P02").iterdir()}

    assert b"repeated: no ray" in whole_bytes["trials.csv"]
    attempts = len(read_rows(done.path / "P02/trials.csv"))
    for stop in (2, attempts - 1):
        study, folder = small(tmp_path / str(stop), text)
        shutil.copytree(done.path / "P02", folder.path / "P02")
        table = folder.path / "P02/trials.csv"
        lines = whole_bytes["trials.csv"].splitlines(keepends=True)
        table.write_bytes(b"".join(lines[: stop + 1]) + lines[stop + 1][:9])
        (folder.path / "P02/answers.csv").unlink()
        folder.put_about("P02", {**folder.about("P02"), "ended": ""})
        simulate(study, folder, "P02", lambda _status: None)
        found = {file.name: file.read_bytes() for file in (folder.path / "P02").iterdir()}
        assert found.pop("incomplete_trials.csv") == lines[stop + 1][:9]
        assert found == whole_bytes


@pytest.mark.slow
def test_participant_whom_an_experimenter_stopped_is_finished_when_simulated(tmp_path: Path) -> None:
    study, folder = small(tmp_path)
    with pytest.raises(StoppedError):
        pointit.run_virtually(_session(study, folder, [(3, "pointing", StudyCommand("stop"))]).run())
    simulate(study, folder, "P01", lambda _status: None)
    rows = read_rows(folder.path / "P01/trials.csv")
    assert [(row["trial"], row["attempt"]) for row in rows if not row["reason"]] == [
        *(("1", "1"), ("2", "1"), ("4", "1"), ("3", "2"))
    ]
    assert folder.about("P01")["ended"]


class _Experimenter(SimulatedView):
    """Gives commands by trial number, each at its first status `pointing` or else at any."""

    def __init__(self, commands: list[tuple[int, str, StudyCommand]]) -> None:
        super().__init__(0, self._on_status)
        self._plan = commands
        self._now: list[StudyCommand] = []

    def _on_status(self, status: StudyStatus) -> None:
        if self._plan and self._plan[0][:2] == (status.trial, status.state):
            self._now.append(self._plan.pop(0)[2])

    def command(self) -> StudyCommand | None:
        return self._now.pop(0) if self._now else None


def _session(study: Study, folder: StudyFolder, commands: list[tuple[int, str, StudyCommand]]) -> Session:
    return Session(study, folder, "P01", _Experimenter(commands), SiteOptions(person=person_of(study, "P01")))


def test_participant_begun_by_a_person_is_not_continued_by_simulation(tmp_path: Path) -> None:
    study, folder = small(tmp_path)
    folder.put_about("P01", {"pseudonym": "P01", "simulated": False})
    with pytest.raises(ConfigError, match="P01 was begun by a person"):
        simulate(study, folder, "P01", lambda _status: None)


def test_experimenter_repeats_skips_pauses_and_stops(tmp_path: Path) -> None:
    study, folder = small(tmp_path)
    commands = [
        (1, "pointing", StudyCommand("repeat")),
        (2, "pause", StudyCommand("repeat")),  # the trial before
        (2, "pointing", StudyCommand("pause")),
        (2, "paused", StudyCommand("skip", "sneezed")),
        (3, "pointing", StudyCommand("stop")),
    ]
    with pytest.raises(StoppedError, match="P01 is stopped at trial 3; the same command goes on there"):
        pointit.run_virtually(_session(study, folder, commands).run())

    notes = [finding.text for finding in check_folder(folder.path)]
    assert "2 of 4 trials are missing: 3, 4; the same command goes on" in notes
    pointit.run_virtually(_session(study, folder, []).run())
    rows = read_rows(folder.path / "P01/trials.csv")
    assert [(row["trial"], row["attempt"], row["outcome"], row["reason"]) for row in rows] == [
        ("1", "1", "skipped", "repeated: repeat by the experimenter"),
        ("1", "2", "hit", ""),
        ("1", "3", "hit", ""),
        ("2", "1", "skipped", "repeated: pause by the experimenter"),
        ("2", "2", "skipped", "skipped: sneezed"),
        ("3", "1", "skipped", "repeated: stop by the experimenter"),
        ("3", "2", "hit", ""),
        ("4", "1", "hit", ""),
    ]


def test_wrist_lost_in_mid_trial_costs_that_attempt_only(tmp_path: Path) -> None:
    study, folder = small(tmp_path, SMALL.replace("repetitions: 2", "repetitions: 1"))
    person = {
        **person_of(study, "P01"),
        "user-sim.wristband.dropout_share": 0.5,
        "user-sim.wristband.dropout_burst_s": 4.0,
    }
    view = SimulatedView(0, lambda _status: None)
    pointit.run_virtually(Session(study, folder, "P01", view, SiteOptions(person=person)).run())
    rows = read_rows(folder.path / "P01/trials.csv")
    lost = [row for row in rows if row["reason"].startswith("repeated: no ray")]
    assert lost
    assert {row["trial"] for row in rows if not row["reason"].startswith("repeated")} == {"1", "2"}


def with_a_clock_set_back(lines: list[str]) -> list[str]:
    """Return `lines` with the times of the first two rows exchanged."""
    at = lines[0].split(",").index("began_utc")
    first, second = (line.split(",") for line in lines[1:3])
    first[at], second[at] = second[at], first[at]
    return [lines[0], ",".join(first), ",".join(second), *lines[3:]]


def test_check_finds_what_is_missing_or_wrong(whole: tuple[Study, StudyFolder], tmp_path: Path) -> None:
    data = tmp_path / "data"
    shutil.copytree(whole[1].path, data)

    def change(name: str, alter: Callable[[list[str]], list[str]]) -> None:
        path = data / name / "trials.csv"
        path.write_text("".join(alter(path.read_text().splitlines(keepends=True))))

    change("P01", lambda lines: [*lines[:2], *lines[3:]])  # trial 2 is gone
    change("P02", with_a_clock_set_back)
    about = (data / "P02/participant.yaml").read_text()
    (data / "P02/participant.yaml").write_text(about.replace("simulated: true", "simulated: false"))
    shutil.copytree(data / "P02", data / "P03")
    found = {(finding.participant, finding.text) for finding in check_folder(data)}

    assert ("P01", "1 of 4 trials are missing: 2") in found
    assert ("P02", "trial 2 begins before trial 1 ends: a clock was set back") in found
    assert ("P03", "does not take part in the study; remove the folder") in found
    assert ("", "P02 is there twice, in P02 and P03") in found

    shutil.rmtree(data / "P02")
    shutil.rmtree(data / "P03")
    checked = json.loads(CliRunner().invoke(check, [str(data), "--json"]).stdout)
    texts = [finding["text"] for finding in checked["findings"]]
    assert any("orders are not balanced" in text for text in texts)
    assert "not begun: P02" in texts


SHELF = """
about: buttons on a shelf
duration_s: null
places: [{position_m: [0.0, 0.0, 0.0], yaw_deg: 20.0}]
site:
  pui: {map: shelf, surfaces: [strip]}
  selector: {journal: {enabled: false}}
  led-driver: {}
  keeper: {}
user:
  pointing: {}
  localizer: {}
  supervisor: {}
  user-sim: {think_s: 0.0, behaviour: select, target_kinds: [screws], lost_press_s: 0.0}
"""


@pytest.mark.slow
@pytest.mark.parametrize(
    ("scenario", "task"),
    [
        ("belts", "{kind: packages, lane: part_e, others: 2}"),
        ("strips\n        end: press", "{kind: tapping, strip: '0', width_m: 0.3, distance_m: 1.5}"),
        ("strips\n        end: ends.py:on", "{kind: reach, others: 2}"),
        ("space", "{kind: tapping, width_m: 0.6, distance_m: 1.5, targets: 5, center_m: [5.0, 0.5, 1.5]}"),
        ("space", "{kind: places, lamps: [led_0, led_1], places: {door: [4.0, 2.0, 1.0]}, width_m: 0.8}"),
        ("shelf.yaml", "{kind: places, things: [screws, nuts, bolts]}"),
    ],
)
def test_ready_task_runs_simulated(scenario: str, task: str, tmp_path: Path) -> None:
    (tmp_path / "ends.py").write_text(
        "def on(now):\n    return 'hit' if now.hovered == now.target else None\n"
    )
    text = f"""
        name: one
        participants: 1
        scenario: {scenario}
        task: {task}
        order: as_written
        repetitions: 4
    """
    (tmp_path / "shelf.yaml").write_text(SHELF)
    study, folder = small(tmp_path, text)
    simulate_all(study, folder)

    rows = read_rows(folder.path / "P01/trials.csv")
    assert [row["trial"] for row in rows] == ["1", "2", "3", "4"]
    hits = sum(row["outcome"] == "hit" for row in rows)
    assert hits >= (4 if "things" in task else 1)  # of things, only the one that was named
    assert all(float(row["target_width_deg"]) > 0.0 for row in rows)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("task", "trials"), [("land", 2), ("follow, width_m: 0.6, stay_s: 0.3", 1), ("localize", 1)]
)
def test_task_with_a_robot_runs_simulated(task: str, trials: int, tmp_path: Path) -> None:
    study, folder = small(
        tmp_path,
        f"name: one\nparticipants: 1\nscenario: robots\ntask: {{kind: {task}}}\norder: as_written\n"
        f"repetitions: {trials}\ntimeout_s: 60\n",
    )
    simulate_all(study, folder)
    rows = read_rows(folder.path / "P01/trials.csv")
    assert [row["outcome"] for row in rows] == ["hit"] * trials
    assert len({row["target"] for row in rows}) == trials
    assert all(2.0 < float(row["selection_s"]) < 60.0 and float(row["error_m"]) < 0.4 for row in rows)


@pytest.mark.parametrize(
    ("task", "sentence"),
    [
        ("{kind: reach, distance_m: 9}", "strip . is 5 m long: no two targets 0.2 m wide are 9 m apart"),
        ("{kind: reach, strips: [x]}", "the map has no strip x; it has 0, 1"),
        ("{kind: packages}", "the map has no belt"),
        ("{kind: places}", "task places needs places, lamps or things"),
        ("{kind: places, things: [radio]}", "the map has no button radio; it has none"),
    ],
)
def test_task_that_the_room_has_not_is_refused(task: str, sentence: str, tmp_path: Path) -> None:
    study, folder = small(tmp_path, f"name: one\nparticipants: 1\ntask: {task}\norder: as_written\n")
    with pytest.raises(PointItError, match=sentence):
        simulate(study, folder, "P01", lambda _status: None)


@pytest.mark.parametrize("record", [None, "", "pseudonym: P01\n"])
def test_trials_possibly_of_a_person_get_no_simulated_ones(tmp_path: Path, record: str | None) -> None:
    study, folder = small(tmp_path)
    table = folder.trials("P01")
    trial = plan_of(study, "P01").trials[0]
    usual = {"participant": "P01", "block": 1, "trial": 1, "attempt": 1, "practice": False, **trial.cell}
    table.append({**usual, "outcome": "hit"})
    table.close()
    content = table.path.read_bytes()
    if record is not None:
        (table.path.parent / "participant.yaml").write_text(record)
    with pytest.raises(ConfigError, match=r"participant\.yaml: does not state whether the trials are of"):
        simulate(study, folder, "P01", lambda _status: None)
    assert table.path.read_bytes() == content


PNG = b"\x89PNG\r\n\x1a\nand so on"
"""The first bytes of a picture decide."""


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("instruction: {image: none.png}", r"image none\.png: .*none\.png cannot be read \(no such file"),
        ("instructions: {hold: {text: Hold., image: text.png}}", r"image text\.png: use a PNG, JPEG"),
        ("consent: {image: ../outside.png}", r"image \.\./outside\.png: is not beside the study; copy it"),
        ("instruction: {image: link.png}", r"image link\.png: is not beside the study"),
        ("instruction: {image: circle.png}", r"image .?circle\.png.?: .*cannot be read"),
        ("settings: {selector.window: 1}", "hold: .*no parameter window; did you mean window_s"),
        ("settings: {conveyor-sim.speed_mps: 1}", "hold: .*conveyor-sim is not among what this starts"),
        ("scenario: nowhere.yaml", r"hold: .*nowhere\.yaml"),
        ("end: none.py:ends", r"end: there is no file .*none\.py"),
        (
            "factors: {method: {levels: {hold: {selector.method: hold}, magic: {selector.method: magic}}}}",
            "magic: .*selector.method.*'magic'",
        ),
    ],
)
def test_mistakes_of_a_study_are_refused_before_the_first_trial(
    tmp_path: Path, text: str, sentence: str
) -> None:
    folder = tmp_path / "study"
    folder.mkdir()
    (folder / "text.png").write_text("no picture")
    (tmp_path / "outside.png").write_bytes(PNG)
    (folder / "link.png").symlink_to(tmp_path / "outside.png")
    (folder / "circle.png").symlink_to(folder / "circle.png")
    lines = [line for line in SMALL.splitlines() if line.split(":")[0] != text.split(":", maxsplit=1)[0]]
    if text.startswith("factors"):
        lines = [line for line in lines if not line.startswith(" ")]

    file = folder / "small.yaml"
    file.write_text("\n".join([*lines, text]))
    with pytest.raises(ConfigError, match=sentence) as refused:
        check_ready(read_study(file))
    assert "\n" not in str(refused.value)
    for command, arguments in ((run, ["--to", str(tmp_path / "data"), "--simulated", "1"]), (check, [])):
        assert str(CliRunner().invoke(command, [str(file), *arguments]).exception) == str(refused.value)
    assert not (tmp_path / "data").exists()


def test_pictures_are_those_of_all_steps(tmp_path: Path) -> None:
    (tmp_path / "more").mkdir()
    (tmp_path / "more/a.png").write_bytes(PNG)
    (tmp_path / "b.webp").write_bytes(b"RIFF0000WEBP")
    study, _ = small(
        tmp_path,
        f"{SMALL}instruction: {{text: a, image: more/a.png}}\ninstructions: {{hold: {{image: b.webp}}}}\n",
    )
    assert check_ready(study) == {
        "more/a.png": Picture(PNG, "image/png"),
        "b.webp": Picture(b"RIFF0000WEBP", "image/webp"),
    }


def test_simulated_participants_run_once_and_take_no_options_of_people(tmp_path: Path) -> None:
    small(tmp_path, SMALL.replace("repetitions: 2", "repetitions: 1"))
    arguments = [str(tmp_path / "small.yaml"), "--to", str(tmp_path / "data"), "--simulated", "1"]
    for option in (["--imu", "page"], ["--page"], ["--participant", "P01"], ["--lsl"]):
        refused = CliRunner().invoke(run, [*arguments, *option]).exception
        assert str(refused) == f"--simulated 1: {option[0]} is for people; leave one of the two out"
    assert CliRunner().invoke(run, arguments).stdout.startswith("1 simulated participants have done 2 trials")
    again = CliRunner().invoke(run, arguments).exception
    assert "P01 to P01 have finished, with data in" in str(again)
    assert "give --to another folder to begin again" in str(again)
