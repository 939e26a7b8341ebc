"""The site of the documents: built strict, complete, and without requests to other hosts."""

import re
import subprocess
import sys

import pytest

from tests.docs.blocks import ROOT
from tests.docs.blocks import blocks as blocks_of

SITE = ROOT / "site"


@pytest.fixture(scope="module")
def _built() -> None:
    command = [sys.executable, "-m", "mkdocs", "build", "--quiet", "--strict"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.usefixtures("_built")
def test_pages_load_nothing_from_other_hosts() -> None:
    pages = [*SITE.rglob("*.html")]
    assert len(pages) > 20
    for page in pages:
        text = page.read_text(encoding="utf-8")
        loads = re.findall(
            r"<(?:script|img|iframe|link[^>]* rel=.?(?:stylesheet|icon|preconnect))[^>]*https?://[^>]*>", text
        )
        assert not loads, (page, loads)


@pytest.mark.usefixtures("_built")
def test_reference_is_generated_from_the_code() -> None:
    def page(name: str) -> str:
        return (SITE / "reference" / f"{name}.html").read_text(encoding="utf-8")

    assert "gauge.full_s" in page("parameters")
    assert 'id="cursorv' in page("messages")
    assert "pointit doctor" in page("commands")
    assert "send_a_robot" in page("scenarios")


def test_a_fence_with_unknown_words_is_refused() -> None:
    with pytest.raises(ValueError, match="scripts/docs --help"):
        blocks_of(ROOT / "README.md", "```sh norun\nls\n```\n")
