"""Code blocks of the documents, and the words of their fences."""

import dataclasses
import re
from dataclasses import dataclass
from pathlib import Path

from markdown_it import MarkdownIt

ROOT = Path(__file__).parents[2]
RUN = ("sh", "python")
"""Languages of blocks that are run."""
DATA = ("yaml", "json", "toml")
"""Languages of blocks that must parse, and are saved if they have a title."""
SHOWN = ("text", "mermaid")
"""Languages of output, and of diagrams."""
INFO = re.compile(
    r"(?P<language>[a-z]+)"
    r'(?: title="(?P<title>[^"]+)")?'
    r"(?: (?P<exit>fails|any-exit)| terminal (?P<terminal>\d)| no-run: (?P<no_run>.+)| (?P<numbers>numbers))?"
)
"""Words behind the three backticks; `scripts/docs --help` explains it."""


@dataclass(frozen=True, kw_only=True)
class Block:
    """A fenced block, with the output that is shown directly below it."""

    page: Path
    line: int
    """Line of the fence, from 1."""
    language: str
    code: str
    title: str = ""
    """Name of the file in which it is saved, or `""`."""
    terminal: str = ""
    """Number of the terminal in which it is left running, or `""` if it is waited for."""
    exit: str = ""
    """`fails`: it must; `any-exit`: it may; `""`: it must not."""
    no_run: str = ""
    """Reason not to run it, or `""`."""
    numbers: bool = False
    """True if a number in this output stands for any number."""
    output: "Block | None" = None

    @property
    def place(self) -> str:
        """Return file and line, as editors take them."""
        return f"{self.page.relative_to(ROOT)}:{self.line}"


def pages() -> list[Path]:
    readmes = [ROOT / folder / "README.md" for folder in ("", "deploy", "examples", "lab")]
    return [path for path in readmes if path.exists()] + sorted((ROOT / "docs").rglob("*.md"))


def blocks(page: Path, text: str) -> list[Block]:
    """Return the fenced blocks of a page.

    Raises:
        ValueError: If the words of a fence are unknown.
    """
    found: list[Block] = []
    follows_code = False
    for token in MarkdownIt().parse(text):
        if token.type != "fence":
            follows_code = False
            continue
        line = token.map[0] + 1 if token.map else 0
        match = INFO.fullmatch(token.info.strip())
        if match is None:
            raise ValueError(f"{page}:{line}: `{token.info}`: unknown words, see scripts/docs --help")
        said = {name: value or "" for name, value in match.groupdict().items()}
        block = Block(
            page=page, line=line, language=said["language"], code=token.content, title=said["title"],
            terminal=said["terminal"], exit=said["exit"], no_run=said["no_run"],
            numbers=bool(said["numbers"]),
        )  # fmt: skip
        if follows_code and block.language == "text":
            found[-1] = dataclasses.replace(found[-1], output=block)
            follows_code = False
        else:
            found.append(block)
            follows_code = block.language in RUN
    return found


def difference(shown: Block, printed: str) -> str:
    """Return an error message if `printed` is not the output that a page shows, else `""`.

    `…` stands for any text in a line, and for any lines if it is alone on its line. All gaps are alike.
    """
    lines = [" ".join(line.split()) for line in shown.code.strip().splitlines()]
    given = [" ".join(line.split()) for line in printed.strip().splitlines()]
    pattern = "".join("(?:.*\n)*?" if line == "…" else f"{_pattern(line, shown)}\n" for line in lines)
    if re.fullmatch(pattern, "".join(f"{line}\n" for line in given)):
        return ""
    return f"{shown.place}: the page shows\n{shown.code}\nbut it printed\n{printed}"


def _pattern(line: str, shown: Block) -> str:
    pattern = ".*?".join(re.escape(part) for part in line.split("…"))
    return re.sub(r"(?:\\-)?\d+(?:\\\.\d+)?", r"-?\\d+(?:\\.\\d+)?", pattern) if shown.numbers else pattern
