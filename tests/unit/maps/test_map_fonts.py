"""Pictures of maps whose names have letters of any script: a font that has them, or a note."""

from pathlib import Path

import pytest
from click.testing import CliRunner

from pointit.cli.maps.map_file import command


def plot(folder: Path, name: str, label: str, suffix: str) -> tuple[Path, str]:
    path, picture = folder / f"{name}.yaml", folder / f"picture{suffix}"
    thing = f'{{light: a, mode: switch, label: "{label}"}}'
    path.write_text(f"lamps: {{a: {{position: [0, 0, 1]}}}}\nthings: {{t: {thing}}}\n", encoding="utf-8")
    result = CliRunner().invoke(command, [str(path), "-o", str(picture)])
    assert result.exception is None, result.output
    return picture, result.stderr


@pytest.mark.parametrize("suffix", [".svg", ".png", ".pdf"])
def test_letters_that_no_font_has_are_boxes_with_a_note_and_no_warning(tmp_path: Path, suffix: str) -> None:
    private = "\U000f0001\U000f0002"  # no font of any machine has these
    picture, note = plot(tmp_path, f"raum_{private}", "Küche", suffix)
    assert picture.stat().st_size > 1000
    assert note.startswith("note: letters are drawn as boxes: no font here has them; install one")


@pytest.mark.parametrize("label", ["Küche", "Ωμέγα", "света", "half $1 of $2", r"cost $\\frac{a$"])
def test_letters_of_the_usual_font_and_formulas_are_texts(tmp_path: Path, label: str) -> None:
    assert "note" not in plot(tmp_path, "room", label, ".svg")[1]
