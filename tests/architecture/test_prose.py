"""`scripts/prose` with files that it is given."""

import subprocess
from pathlib import Path

from tests.architecture.sources import ROOT


def test_prose_checks_a_markdown_file(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    text = "A map … that " + "hee" + "ds nothing."  # in one piece it would be an offence here
    page.write_text(f"# Rooms\n\n{text}\n", encoding="utf-8")
    done = subprocess.run([ROOT / "scripts" / "prose", page], capture_output=True, text=True, check=False)
    told = f"{page}:3: use an everyday word: {text}\n"
    assert (done.returncode, done.stdout) == (1, told), done.stderr
