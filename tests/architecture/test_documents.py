"""Files, scripts and commands that the documents name exist."""

import os
import re
from pathlib import Path
from typing import get_args

import pytest

from pointit.cli.main import PATHS
from pointit.diagnosis.observation import Code
from pointit.services.registry import PROCESSES
from pointit_lab.cli.evaluate import evaluate
from tests.architecture.sources import ROOT, all_modules

DOCUMENTS = (
    *(
        path
        for folder in ("", "bridges", "deploy", "examples", "lab")
        if (path := ROOT / folder / "README.md").exists()
    ),
    ROOT / "CHANGELOG.md",
    *sorted((ROOT / "docs").rglob("*.md")),
)
TOP = (
    *("schemas/", "services/", "bridges/", "tests/", "lab/", "docs/", "examples/", "scripts/"),
    *("deploy/", "requirements/"),
)
MADE_BY_READERS = {
    "deploy/.env",
    "my_order.py",
    "promises.py",
    "src/my_wrist/__init__.py",
    "src/my_wrist/promises.py",
}
MODULES = (
    *all_modules(),
    *(ROOT / "examples").rglob("*.py"),
    *(ROOT / "docs").rglob("*.py"),
    *(ROOT / "examples").rglob("*.py"),
    *(ROOT / "bridges/web/client/src").rglob("*.ts"),
    *(ROOT / "bridges/web/client/src").rglob("*.tsx"),
)
documents = pytest.mark.parametrize(
    "path", [pytest.param(path, id=str(path.relative_to(ROOT))) for path in DOCUMENTS]
)


def anchors(text: str) -> set[str]:
    """Return the fragments of all headings, as GitHub makes them."""
    headings = re.findall(r"^#+ (.*)$", text, re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


def missing_links(text: str, path: Path) -> list[str]:
    """Return relative links of the document at `path` that lead nowhere."""
    missing: list[str] = []
    for link in re.findall(r"\]\(([^)\s]+)\)", text):
        target, _, fragment = link.partition("#")
        if "://" in target:
            continue
        file = (path.parent / target).resolve() if target else path
        if not file.exists() or (fragment and fragment not in anchors(file.read_text(encoding="utf-8"))):
            missing.append(link)
    return missing


def missing_paths(text: str) -> list[str]:
    """Return paths of the repository and names of modules, in backticks, that do not exist."""
    missing: list[str] = []
    for quoted in re.findall(r"`([^`\s]+)`", text):
        is_module = re.fullmatch(r"[\w/.]+\.(py|ts)", quoted) is not None
        if not is_module and (not quoted.startswith(TOP) or re.search(r"[{*<…]", quoted)):
            continue
        is_there = (ROOT / quoted).exists() or quoted in MADE_BY_READERS
        if is_module and not is_there:
            is_there = any(module.as_posix().endswith(f"/{quoted}") for module in MODULES)
        if not is_there:
            missing.append(quoted)
    return missing


def missing_symbols(text: str, path: Path) -> list[str]:
    """Return the names that stand behind a link to a module, ", `name` and `name`", and that it has not."""
    missing: list[str] = []
    kinds = "def|class|function|const|interface|type"
    defined = rf"(?m)\b(?:{kinds})\s+{{0}}\b|^\s*(?:async |get |set |private )*{{0}}\s*[:=(<]"
    names = r"`[\w.]+`(?:\([^)]*\))?"
    for link, named in re.findall(rf"\]\(([^)#]+\.(?:py|ts))\), ({names}(?:(?:, | and ){names})*)", text):
        file = path.parent / link
        has = file.read_text(encoding="utf-8") if file.exists() else ""
        symbols = re.findall(r"`(?:\w+\.)*(\w+)`", named)
        missing += [f"{link}: {name}" for name in symbols if not re.search(defined.format(name), has)]
    return missing


def cut_tables(text: str) -> list[str]:
    """Return the rows that a blank line cuts off from the table above, and that begin no table."""
    lines = text.splitlines()
    cut: list[str] = []
    for above, blank, row, below in zip(lines, lines[1:], lines[2:], [*lines[3:], ""], strict=False):
        is_cut = above.startswith("|") and not blank and row.startswith("|")
        if is_cut and not re.fullmatch(r"\|[\s:|-]+", below):
            cut.append(row)
    return cut


def unknown_scripts(text: str) -> set[str]:
    scripts = {f"scripts/{name}" for name in re.findall(r"scripts/([\w-]*\w)", text)}
    return {script for script in scripts if not (ROOT / script).is_file()}


@documents
def test_links_paths_and_scripts_exist(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    assert missing_links(text, path) == []
    assert (missing_paths(text), unknown_scripts(text)) == ([], set())
    assert missing_symbols(text, path) == []


@documents
def test_tables_have_no_blank_line(path: Path) -> None:
    assert cut_tables(path.read_text(encoding="utf-8")) == []


def test_row_below_a_blank_line_is_found() -> None:
    table = "| a |\n|---|\n| 1 |\n"
    assert cut_tables(f"{table}\n| b |\n|---|\n") == []
    assert cut_tables(f"{table}\n| 2 |\n| 3 |\n") == ["| 2 |"]
    assert cut_tables(f"{table}\n| 2 |") == ["| 2 |"]


def test_missing_files_and_scripts_are_found() -> None:
    text = "[a](docs/none.md) `services/none.py` `nothing/service.py`\n```sh\nscripts/land\n```\n"
    assert missing_links(text, ROOT / "README.md") == ["docs/none.md"]
    assert missing_paths(text) == ["services/none.py", "nothing/service.py"]
    assert unknown_scripts(text) == {"scripts/land"}
    link = "tests/support/pace.py"
    text = f"[a]({link}), `Gate` and `Patience`; [b]({link}), `a.slowness`, `there.is_none`"
    assert missing_symbols(text, ROOT / "README.md") == [f"{link}: {each}" for each in ("Gate", "is_none")]


SERVICES = {*(row.name for row in PROCESSES), "counter"}
"""Ours, and the one of another package in a how-to and a test."""
LAB = {("load",), ("evaluate",), *(("evaluate", entry.name) for entry in evaluate.entries)}
WAVE = ("wave",)
"""The command of another package in a how-to."""
KNOWN = {WAVE, *PATHS, *LAB, *(("service", "run", name) for name in SERVICES)}
GROUPS = {file[:-1] for file in KNOWN}
SUFFIXES = {"", ".json", ".md", ".py", ".sh", ".toml", ".ts", ".tsx", ".yaml", ".yml"}
FOLDERS = (
    *(".github", "bridges", "deploy", "docs", "examples", "lab", "schemas", "scripts"),
    *("pointit", "services", "tests"),
)
BUILT = {"__pycache__", "node_modules", "static"}
EXEMPT = (
    "schemas/catalogue/shipped/messages/",  # versions of messages are kept as they were
    "tests/unit/cli/test_main.py",
    "tests/architecture/test_documents.py",
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
    listed = [*ROOT.glob("*.*"), *(file for name in FOLDERS for file in (ROOT / name).rglob("*"))]
    return {
        name: file.read_text(encoding="utf-8", errors="replace")
        for file in listed
        if (name := file.relative_to(ROOT).as_posix()) and file.suffix in SUFFIXES and file.is_file()
        if not name.startswith(EXEMPT) and not BUILT & set(file.parts)
    }


def test_commands_in_all_texts_are_those_of_the_help() -> None:
    read = texts()
    wrong = {name: words for name, text in read.items() if (words := misspelt(text))}
    assert wrong == {}
    assert len(read) > 500
    assert "`pointit topic echo KEY`" in read["pointit/cli/inspect/listings.py"]


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


def test_every_finding_of_doctor_has_a_row_of_troubleshooting() -> None:
    page = (ROOT / "docs/how-to/troubleshooting.md").read_text()
    rows = set(
        re.findall(r"`([\w-]+)`", "".join(re.findall(r"(?m)^\|([^|]*)\|", page.split("## Findings")[1])))
    )
    assert rows == {*get_args(Code)}


def test_the_page_has_the_glossary_of_the_documents() -> None:
    built = ROOT / "bridges/web/static/glossary.md"
    assert built.read_bytes() == (ROOT / "docs/reference/glossary.md").read_bytes(), "run scripts/page"


def test_readme_names_the_commands_to_try_and_to_test_it() -> None:
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    (section,) = [part for part in text.split("\n## ") if part.startswith("Try it\n")]
    for name in ("demo", "test"):
        assert re.search(rf"(`|^)scripts/{name}\b", section, re.MULTILINE), name
        assert os.access(ROOT / "scripts" / name, os.X_OK)
