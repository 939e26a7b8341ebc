"""The site of the documents: built strict, complete, and without requests to other hosts."""

import re
import subprocess
import sys

import pytest

from tests.docs.blocks import ROOT, difference
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


PAGE = """
```sh terminal 2
pointit run
```

```python title="lamp.py"
print(1)
```

```sh
python lamp.py
```

```text numbers
it took 3.5 s, as …
…
end
```
"""


def test_words_of_a_fence_are_read_and_output_belongs_to_the_block_above() -> None:
    first, saved, run = blocks_of(ROOT / "README.md", PAGE)
    assert (first.terminal, first.line, saved.title, saved.output) == ("2", 2, "lamp.py", None)
    assert run.output is not None
    assert not difference(run.output, "it took 12 s, as always\nmany\nlines\nend")
    assert not difference(run.output, "it took -0.25   s, as always\nend\n")
    assert "shows" in difference(run.output, "it took long, as always\nend")
    assert "shows" in difference(run.output, "it took 3.5 s, as always\nend\nmore")


def test_a_fence_with_unknown_words_is_refused() -> None:
    with pytest.raises(ValueError, match="scripts/docs --help"):
        blocks_of(ROOT / "README.md", "```sh norun\nls\n```\n")
