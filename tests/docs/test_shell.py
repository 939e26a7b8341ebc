"""The runner notices blocks that do not do what a page says."""

from pathlib import Path

import pytest

from tests.docs.blocks import ROOT, blocks
from tests.docs.shell import BlockError, shell


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


async def test_blocks_of_a_page_share_a_shell_and_nothing_with_the_machine(tmp_path: Path) -> None:
    shown = "```text\n1\nlo …\n```"
    await follow(
        f"```sh\nexport A=1\n```\n\n```sh\necho $A $POINTIT_DATA; ip -br link\n```\n\n{shown}", tmp_path
    )
