"""The site of the documents: built strict, complete, and without requests to other hosts."""

import re
import subprocess
import sys
from pathlib import Path
from typing import Literal

import pytest

from docs.website.reference import PAGES
from tests.docs.blocks import ROOT
from tests.docs.blocks import blocks as blocks_of
from tests.e2e.web.axe import SIZES, violations
from tests.support.browser import chromium, installed

SITE = ROOT / "site"


@pytest.fixture(scope="module")
def _built() -> None:
    command = [sys.executable, "-m", "mkdocs", "build", "--quiet", "--strict"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.long
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


@pytest.mark.long
@pytest.mark.usefixtures("_built")
def test_reference_is_generated_from_the_code() -> None:
    def page(name: str) -> str:
        return (SITE / "reference" / f"{name}.html").read_text(encoding="utf-8")

    assert "gauge.full_s" in page("parameters")
    assert 'id="cursorv' in page("messages")
    assert "pointit doctor" in page("commands")
    assert "send_a_robot" in page("scenarios")
    assert "one_euro.py" in page("modules")


@pytest.mark.long
@pytest.mark.usefixtures("_built")
def test_links_to_sources_of_generated_pages_lead_to_the_pages() -> None:
    listed = (SITE / "reference" / "index.html").read_text(encoding="utf-8").partition("<article")[2]
    assert [page for page in PAGES if f'href="{Path(page).stem}.html"' not in listed] == []
    assert 'href="../reference/parameters.html#imu-bridge"' in (SITE / "how-to/wrist.html").read_text()


@pytest.mark.long
@pytest.mark.usefixtures("_built")
def test_first_page_plays_a_recording() -> None:
    first = (SITE / "index.html").read_text(encoding="utf-8")
    assert re.search('<iframe [^>]*src="visit.html"', first)
    assert 'src="pictures/window-light.webp"' in first
    played = (SITE / "visit.html").read_text(encoding="utf-8")
    found = re.search(r'<script id="recording" type="text/plain" data-start-s="([\d.]+)"', played)
    assert found is not None
    assert 1.0 < float(found[1]) < 20.0  # just before the first selection


@pytest.mark.long
@pytest.mark.slow
@pytest.mark.usefixtures("_built")
@pytest.mark.parametrize("theme", ["light", "dark"])
async def test_nothing_bars_the_way_of_readers(theme: Literal["light", "dark"]) -> None:
    path = installed()
    if path is None:
        pytest.skip("no browser")
    async with chromium(path) as browser:
        page = await (await browser.new_context(color_scheme=theme)).new_page()
        for name, sizes in (("index", SIZES), ("how-to/run", SIZES[:1]), ("how-to/index", SIZES[-1:])):
            for width, height in sizes:
                await page.set_viewport_size({"width": width, "height": height})
                await page.goto((SITE / f"{name}.html").as_uri())
                assert await violations(page) == [], (name, width, height)


def test_first_page_has_the_way_to_the_demo_and_nothing_for_maintainers() -> None:
    text = (ROOT / "docs/index.md").read_text(encoding="utf-8")
    assert {"git clone ADDRESS pointit", "cd pointit", "scripts/demo"} <= {*text.splitlines()}
    assert "scripts/test" not in text
    assert "scripts/docs" not in text


def test_a_fence_with_unknown_words_is_refused() -> None:
    with pytest.raises(ValueError, match="scripts/docs --help"):
        blocks_of(ROOT / "README.md", "```sh norun\nls\n```\n")
