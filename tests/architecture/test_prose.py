"""`scripts/prose` with files that it is given."""

import subprocess
from pathlib import Path

import pytest

from tests.architecture.sources import ROOT


def test_prose_checks_a_markdown_file(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    text = "A map … that " + "hee" + "ds nothing."  # in one piece it would be an offence here
    page.write_text(f"# Rooms\n\n{text}\n", encoding="utf-8")
    done = subprocess.run([ROOT / "scripts" / "prose", page], capture_output=True, text=True, check=False)
    told = f"{page}:3: use an everyday word: {text}\n"
    assert (done.returncode, done.stdout) == (1, told), done.stderr


@pytest.mark.parametrize(
    ("name", "text", "rule"),
    [
        ("docstring.py", '"""Take the map."""', "use an active verb with an effect, or a noun"),
        ("docstring.py", '"""Let it go."""', "use an active verb with an effect, or a noun"),
        ("docstring.py", '"""Whether it flies."""', "use an active verb with an effect, or a noun"),
        ("message.py", 'raise ValueError("keys for who' + ' asks")', "name the role"),
        ("help.py", 'option(help="wait so' + ' long, s")', "name the duration"),
        ("help.py", 'option(help=f"at most so' + ' many of {kind}")', "name the number"),
        ("comment.py", "x = 1  # kept ti" + "ll it ends", "write until"),
        ("function.py", "def wait_ti" + "ll_end() -> None: ...", "write until"),
        ("parameter.py", "def wait(ti" + "ll) -> None: ...", "write until"),
        ("attribute.py", "self.is_ne" + "ws = is_ne" + "ws = True", "name the message or the change"),
        ("comment.ts", "const x = 1; // kept ti" + "ll it ends", "write until"),
        ("text.ts", "const x = 'the robot of who" + " points';", "name the role"),
        ("page.md", "The page is none of" + " the model.", "write `is not a …`"),
    ],
)
def test_prose_reads_texts_and_identifiers(tmp_path: Path, name: str, text: str, rule: str) -> None:
    file = tmp_path / name
    file.write_text(text + "\n", encoding="utf-8")
    done = subprocess.run([ROOT / "scripts" / "prose", file], capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert f"{file}:1: {rule}: " in done.stdout, done.stdout


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("code.ts", "const till = so_long;"),
        ("text.py", 'text = "The map of those who point, so long as they point, and who is here."'),
        ("picture.py", '"""Take the picture of the page."""'),
    ],
)
def test_prose_accepts_plain_texts(tmp_path: Path, name: str, text: str) -> None:
    file = tmp_path / name
    file.write_text(text + "\n", encoding="utf-8")
    done = subprocess.run([ROOT / "scripts" / "prose", file], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (0, ""), done.stderr
