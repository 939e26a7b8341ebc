"""Every `pointit WORD …` in code, texts and files of deployments is a command that the help shows."""

import re

import pytest

from pointit.cli.main import PATHS
from pointit.services.registry import PROCESSES
from pointit_lab.cli.evaluate import evaluate
from tests.architecture.sources import ROOT

SERVICES = {*(row.name for row in PROCESSES), "counter"}
"""Ours, and the one of another package in a how-to and a test."""
LAB = {("load",), ("evaluate",), *(("evaluate", entry.name) for entry in evaluate.entries)}
WAVE = ("wave",)
"""The command of another package in a how-to."""
KNOWN = {WAVE, *PATHS, *LAB, *(("service", "run", name) for name in SERVICES)}
GROUPS = {path[:-1] for path in KNOWN}
SUFFIXES = {"", ".json", ".md", ".py", ".sh", ".toml", ".ts", ".yaml", ".yml"}
FOLDERS = (
    *(".github", "bridges", "deploy", "docs", "examples", "lab", "schemas", "scripts"),
    *("services", "tests"),
)
GENERATED = {"__pycache__", "node_modules", "static"}
EXEMPT = (
    "schemas/catalogue/messages/",  # versions of messages are kept as they were
    "tests/unit/cli/test_main.py",
    "tests/architecture/test_command_spellings.py",
)

JOINED = re.compile(r"\"\s*\+?\n\s*f?\"|(?<=\w)\n[ \t]*(?:#|//|\*)?[ \t]*")
"""The break inside a text in code: between two strings, or between two words."""
QUOTED = re.compile(r"`pointit((?:\s+[a-z][\w-]*)+)")
TYPED = re.compile(r"(?:^|(?<!b)[\"'(:;&|>$]\s*|bin/|Example: )pointit((?: [a-z][\w-]*)+)", re.MULTILINE)


def misspelt(text: str) -> set[str]:
    """Return the words behind `pointit`, up to the first that is unknown."""
    found = QUOTED.findall(JOINED.sub(lambda gap: " " if gap[0][0] == "\n" else "", text))
    return {wrong for words in (*found, *TYPED.findall(text)) if (wrong := unknown(tuple(words.split())))}


def unknown(words: tuple[str, ...]) -> str:
    """Return `words` up to the first that is no command, or `""` if they begin with one or name a group."""
    for count in range(1, len(words) + 1):
        if words[:count] not in KNOWN:
            return " ".join(words[:count])
        if words[:count] not in GROUPS:
            return ""
    return ""


def texts() -> dict[str, str]:
    listed = [*ROOT.glob("*.*"), *(path for name in FOLDERS for path in (ROOT / name).rglob("*"))]
    return {
        name: path.read_text(encoding="utf-8", errors="replace")
        for path in listed
        if (name := path.relative_to(ROOT).as_posix()) and path.suffix in SUFFIXES and path.is_file()
        if not name.startswith(EXEMPT) and not GENERATED & set(path.parts)
    }


def test_commands_in_all_texts_are_those_of_the_help() -> None:
    read = texts()
    wrong = {name: words for name, text in read.items() if (words := misspelt(text))}
    assert wrong == {}
    assert len(read) > 500
    assert "`pointit topic echo KEY`" in read["services/pointit/cli/inspect/topics.py"]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("see `pointit topics`", "topics"),
        ('"see `pointit "\n    f"fly`"', "fly"),
        ("# by `pointit\n    # person fly anna`", "person fly"),
        ("$ pointit service pui", "service pui"),
        ("pointit service run puj --help", "service run puj"),
        ("`pointit service run NAME`, `pointit site`, `pointit run scenario_9`", ""),
        ("import pointit\nfrom here", ""),
    ],
)
def test_a_command_that_the_help_does_not_show_is_found(text: str, words: str) -> None:
    assert misspelt(text) == ({words} if words else set())
