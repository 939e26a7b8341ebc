"""Blocks of the documents run, and print what is shown; the runner notices those that do not."""

import json
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml

from tests.docs.blocks import DATA, ROOT, RUN, SHOWN, blocks, pages
from tests.docs.shell import BlockError, shell

REASONS = {
    "hardware": "needs a device on a port of this machine",
    "machine": "is for another machine",
    "containers": "needs container images; `tests/containers` runs the same",
    "ros": "needs a ROS 2 installation",
    "recordings": "needs recordings that are not public",
    "minutes": "takes minutes",
    "network": "downloads",
}
"""Words behind `no-run: `."""
UNRUN = {
    "README.md": 1, "deploy/README.md": 10, "docs/explanation/limits.md": 1,
    "docs/explanation/simulation.md": 1, "docs/how-to/assistants.md": 2,
    "docs/how-to/contribute.md": 1, "docs/how-to/conveyor.md": 1, "docs/how-to/export.md": 3,
    "docs/how-to/home.md": 1, "docs/how-to/home-assistant.md": 3,
    "docs/how-to/measure.md": 9, "docs/how-to/motion-capture.md": 1, "docs/how-to/observe.md": 1,
    "docs/how-to/page.md": 1,
    "docs/how-to/put-that-there.md": 1, "docs/how-to/replay.md": 1, "docs/how-to/ros2.md": 3,
    "docs/how-to/ros4hri.md": 2, "docs/how-to/scan-details.md": 4, "docs/how-to/scan.md": 2,
    "docs/how-to/study.md": 1, "docs/how-to/study-report.md": 3, "docs/index.md": 1,
    "docs/how-to/strips.md": 2, "docs/how-to/wrist.md": 3,
    "docs/how-to/wrists.md": 3, "docs/how-to/wrists-network.md": 1,
    "docs/how-to/write-a-plug-in.md": 1, "docs/reference/maps.md": 1, "docs/reference/ros2.md": 1,
    "docs/tutorial/install.md": 6, "docs/tutorial/wrist.md": 3,
}  # fmt: skip
"""Number of blocks of each page that are not run."""
LONG = {
    f"docs/how-to/{name}.md"
    for name in (
        "assistants",
        "measure",
        "network",
        "put-that-there",
        "replay",
        "robots",
        "ros2-robots",
        "study",
    )
}
"""Pages whose blocks take 7 s of CPU or more; `.ci/nightly` runs them."""
READERS: dict[str, Callable[[str], Any]] = {"yaml": yaml.safe_load, "json": json.loads, "toml": tomllib.loads}
PAGES = {str(page.relative_to(ROOT)): blocks(page, page.read_text(encoding="utf-8")) for page in pages()}


@pytest.mark.slow  # `scripts/docs` runs them
@pytest.mark.timeout(900)  # of each block: see `PATIENCE_S`
@pytest.mark.parametrize(
    "page",
    [
        pytest.param(name, marks=pytest.mark.long) if name in LONG else name
        for name, found in PAGES.items()
        if any(each.language in RUN for each in found)
    ],
)
async def test_blocks_run_and_print_what_the_page_shows(page: str, tmp_path: Path) -> None:
    async with shell(tmp_path) as reader:
        for block in PAGES[page]:
            if block.title:
                (tmp_path / "page" / block.title).write_text(block.code, encoding="utf-8")
            elif block.language in RUN and not block.no_run:
                await reader.run(block)
        await reader.end()


@pytest.mark.parametrize("page", PAGES)
def test_every_block_is_run_read_or_listed(page: str) -> None:
    for block in PAGES[page]:
        assert block.language in (*RUN, *DATA, *SHOWN), f"{block.place}: nothing runs {block.language}"
        assert not block.no_run or block.no_run in REASONS, f"{block.place}: no reason is {block.no_run!r}"
        if block.language in DATA:
            READERS[block.language](block.code)
    assert sum(bool(block.no_run) for block in PAGES[page]) == UNRUN.get(page, 0)


def test_listed_pages_exist() -> None:
    assert UNRUN.keys() | LONG <= PAGES.keys()


async def follow(text: str, folder: Path) -> None:
    async with shell(folder) as reader:
        for block in blocks(ROOT / "README.md", text):
            await reader.run(block)
        await reader.end()


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("```sh\nfalse\ntrue\n```", "README.md:1: false failed"),
        ("```sh fails\ntrue\n```", "should fail"),
        ("```sh\necho one\n```\n\n```text\ntwo\n```", "the page shows\ntwo"),
        ("```sh terminal 1\necho begun; exit 3\n```", "ended .*printed\nbegun"),
        (
            "```sh terminal 1\ntrap 'exit 4' INT; echo begun; while sleep 0.01; do :; done\n```",
            "ended with 4",
        ),
        (
            "```sh terminal 1\necho begun\n```\n\n```sh\nsleep .2\n```\n\n```sh\ntrue\n```",
            "ended and printed\nbegun",
        ),
        ("```python\nraise SystemExit(2)\n```", "failed"),
        ("```sh\nexit 0\n```", "ended the shell"),
    ],
)
async def test_a_block_that_fails_is_named(text: str, problem: str, tmp_path: Path) -> None:
    with pytest.raises(BlockError, match=problem):
        await follow(text, tmp_path)


async def test_page_blocks_share_a_shell_isolated_from_the_machine(tmp_path: Path) -> None:
    shown = "```text\n1\nlo …\n```"
    await follow(
        f"```sh\nexport A=1\n```\n\n```sh\necho $A $POINTIT_DATA; ip -br link\n```\n\n{shown}", tmp_path
    )
