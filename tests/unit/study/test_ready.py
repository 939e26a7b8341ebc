"""Checks before the first trial: what would stop a study later, and options that do not go together."""

import json
from pathlib import Path

import pytest
from click.testing import CliRunner

from pointit.cli.study import check, report
from pointit.cli.study import command as run
from pointit.runtime.errors import ConfigError
from pointit.study.model import Picture, read_study
from pointit.study.simulated import simulate
from pointit.study.study_site import check_ready
from tests.unit.study.studies import SMALL, small

PNG = b"\x89PNG\r\n\x1a\nand so on"
"""The first bytes of a picture decide."""


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("instruction: {image: none.png}", r"image none\.png: .*none\.png cannot be read \(No such file"),
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
def test_what_would_fail_later_is_refused_before_the_first_trial(
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


def test_simulated_participants_are_done_once_and_take_no_options_of_people(tmp_path: Path) -> None:
    small(tmp_path, SMALL.replace("repetitions: 2", "repetitions: 1"))
    arguments = [str(tmp_path / "small.yaml"), "--to", str(tmp_path / "data"), "--simulated", "1"]
    for option in (["--imu", "page"], ["--page"], ["--participant", "P01"], ["--lsl"]):
        refused = CliRunner().invoke(run, [*arguments, *option]).exception
        assert str(refused) == f"--simulated 1: {option[0]} is for people; leave one of the two out"
    assert CliRunner().invoke(run, arguments).stdout.startswith("1 simulated participants have done 2 trials")
    again = CliRunner().invoke(run, arguments).exception
    assert "P01 to P01 have finished, with data in" in str(again)
    assert "give --to another folder to begin again" in str(again)


def test_run_check_and_report_refuse_a_table_that_a_spreadsheet_has_saved(tmp_path: Path) -> None:
    text = SMALL.replace("repetitions: 2", "repetitions: 1")
    study, folder = small(tmp_path, text)
    file, data = tmp_path / "small.yaml", folder.path
    simulate(study, folder, "P01", lambda _status: None)
    table = data / "P01" / "trials.csv"
    saved = b"\xef\xbb\xbf" + table.read_bytes().replace(b",", b";").replace(b"\n", b"\r\n")
    table.write_bytes(saved)
    about = data / "P01/participant.yaml"
    about.write_text("".join(x for x in about.read_text().splitlines(keepends=True) if "ended" not in x))
    sentence = f"{table}: another program has rewritten it (line 1 has"

    checked = CliRunner().invoke(check, [str(data), "--json"])
    texts = [finding["text"] for finding in json.loads(checked.stdout)["findings"]]
    assert any(each.startswith(sentence) for each in texts)
    ran = CliRunner().invoke(run, [str(file), "--to", str(data), "--simulated", "1"])
    assert str(ran.exception).startswith(sentence)
    reported = CliRunner().invoke(report, [str(data)])
    assert str(reported.exception).startswith(sentence)
    assert table.read_bytes() == saved

    again = CliRunner().invoke(run, [str(file), "--to", str(tmp_path / "new"), "--simulated", "1"])
    assert again.exit_code == 0, again.output
