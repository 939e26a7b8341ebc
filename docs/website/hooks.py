"""Hooks of MkDocs: generated pages, pages from other folders, links to files that are no pages."""

import posixpath
import re
from pathlib import Path
from typing import Any

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

from docs.website.reference import PAGES
from docs.website.visit import framed, visit
from pointit.bridges.web.server.bundle import STATIC

ROOT = Path(__file__).parents[2]
ELSEWHERE = {
    "CHANGELOG.md": "changelog.md",
    "bridges/README.md": "explanation/bridges.md",
    "deploy/README.md": "how-to/deploy.md",
    "examples/README.md": "how-to/examples.md",
    "schemas/catalogue/shipped/README.md": "reference/topics.md",
}
"""Pages whose files are in other folders of the repository, and their paths below `docs`."""
SOURCES = {
    "schemas/catalogue/shipped/messages": "reference/messages.md",
    "pointit": "reference/modules.md",
    "pointit/__init__.pyi": "reference/api-names.md",
    "pointit/cli/commands.py": "reference/commands.md",
    "pointit/launch/scenarios": "reference/scenarios.md",
    "pointit/plugins": "reference/plug-ins.md",
    "schemas/problems.py": "reference/problems.md",
    "services": "reference/parameters.md",
}
"""Sources of generated pages, and these pages. Links to a source work without the site, too."""
LINK = re.compile(r"(!?)\[((?:[^\[\]]|\[[^\]]*\])*)\]\(([^)\s]+)\)")
MESSAGE = re.compile(r"schemas/catalogue/shipped/messages/(\w+)\.v(\d+)\.json")
PARAMETERS = re.compile(r"services/(\w+)/config\.py")
SECTION = re.compile(
    r' aria-labelledby="__nav_[^"]*"'
    r'([^>]*>\s*<label class="md-nav__title"[^>]*>\s*<span[^>]*></span>([^<]*)<)'
)
"""Navigation of a section, and its title: the label that names it is empty if the section has a page."""
FENCE = re.compile(r"^([ ]*```[a-z]+)((?: title=\"[^\"]*\")?)[^\n`]*$", re.MULTILINE)


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the pages that are not in `docs`."""
    files.append(File.generated(config, "visit.html", content=visit()))
    files.append(File.generated(config, "icon.svg", abs_src_path=str(STATIC / "icon.svg")))
    for uri, page in PAGES.items():
        files.append(File.generated(config, uri, content="\n\n".join(page()) + "\n"))
    for path, uri in ELSEWHERE.items():
        if (ROOT / path).exists():
            files.append(File.generated(config, uri, content=(ROOT / path).read_text(encoding="utf-8")))
    return files


def on_page_markdown(markdown: str, page: Page, **_others: Any) -> str:
    """Return a page without the words that only `scripts/docs` reads, its links fit for the site."""
    uri = page.file.src_uri
    source = next((path for path, other in ELSEWHERE.items() if other == uri), f"docs/{uri}")

    def linked(match: re.Match[str]) -> str:
        picture, text, target = match.groups()
        path, _, fragment = target.partition("#")
        if not path or "://" in path:
            return match[0]
        there = posixpath.normpath(posixpath.join(posixpath.dirname(source), path))
        if message := MESSAGE.fullmatch(there):
            there = "docs/reference/messages.md"
            fragment = f"{message[1].lower()}v{message[2]}"
        if not source.startswith("docs/explanation/"):  # there, the files themselves are meant
            if service := PARAMETERS.fullmatch(there):
                there = "docs/reference/parameters.md"
                fragment = service[1].replace("_", "-")
            there = f"docs/{SOURCES[there]}" if there in SOURCES else there
        there = f"docs/{ELSEWHERE[there]}" if there in ELSEWHERE else there
        if not there.startswith("docs/"):
            return text
        relative = posixpath.relpath(there.removeprefix("docs/"), posixpath.dirname(uri) or ".")
        return f"{picture}[{text}]({relative}{'#' if fragment else ''}{fragment})"

    markdown = FENCE.sub(r"\1\2", LINK.sub(linked, markdown))
    if uri != "index.md":
        return markdown
    page.meta["hide"] = ["navigation", "toc"]
    return framed(markdown)


def on_post_page(output: str, **_others: Any) -> str:
    """Return the HTML of a page with a name for the navigation of each section."""
    return SECTION.sub(lambda match: f' aria-label="{match[2].strip()}"{match[1]}', output)
