"""Files and scripts that the documents name exist. Commands: `test_command_spellings.py`."""

import re
from pathlib import Path

import pytest

from docs.website.reference import PAGES
from tests.architecture.sources import ROOT, all_modules

DOCUMENTS = (
    *(
        path
        for folder in ("", "bridges", "deploy", "examples")
        if (path := ROOT / folder / "README.md").exists()
    ),
    ROOT / "CHANGELOG.md",
    *sorted((ROOT / "docs").rglob("*.md")),
)
TOP = (
    *("schemas/", "services/", "bridges/", "tests/", "lab/", "docs/", "examples/", "scripts/"),
    *("deploy/", "requirements/"),
)
GENERATED = {ROOT / "docs" / page for page in PAGES}
MADE_BY_READERS = {"deploy/.env", "fake.py", "src/my_wrist/__init__.py", "src/my_wrist/fake.py"}
MODULES = (
    *all_modules(),
    *(ROOT / "examples").rglob("*.py"),
    *(ROOT / "docs").rglob("*.py"),
    *(ROOT / "examples").rglob("*.py"),
    *(ROOT / "bridges/pointit/bridges/web/client/src").rglob("*.ts"),
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
        if file in GENERATED:
            continue  # scripts/docs checks them
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


def unknown_scripts(text: str) -> set[str]:
    scripts = {f"scripts/{name}" for name in re.findall(r"scripts/(\w+)", text)}
    return {script for script in scripts if not (ROOT / script).is_file()}


@documents
def test_links_paths_and_scripts_exist(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    assert missing_links(text, path) == []
    assert (missing_paths(text), unknown_scripts(text)) == ([], set())


def test_missing_files_and_scripts_are_found() -> None:
    text = "[a](docs/none.md) `services/none.py` `nothing/service.py`\n```sh\nscripts/land\n```\n"
    assert missing_links(text, ROOT / "README.md") == ["docs/none.md"]
    assert missing_paths(text) == ["services/none.py", "nothing/service.py"]
    assert unknown_scripts(text) == {"scripts/land"}
