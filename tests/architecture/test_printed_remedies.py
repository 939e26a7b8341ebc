"""Remedies work where they are printed: options exist, paths are quoted, no unknown name is installed.

A sentence of a library is printed by many commands. What it names must exist in each of them, so it names a
variable of the environment, or an option or parameter that its own file declares.
"""

import ast
import re
import shlex
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path

import click
import pytest

from pointit.cli.main import front
from pointit.runtime.errors import ConfigError
from pointit.runtime.host import state_file
from pointit.runtime.host.state_file import keeps_modes, read_secret
from tests.architecture.sources import ROOT, shipped, shown, tree

OPTION = re.compile(r"(?<![\w-])--[a-z][a-z0-9-]+")
COMMAND = re.compile(r"`(?:pip|pipx|uv|uvx|chmod|rm|cp|mv|zstd|tar|unzip) [^`]*`")
SHARED = ("pointit/runtime/", "schemas/", "pointit/geometry/")
"""Rooms whose sentences any command can print."""
COMMON_OPTIONS = {"--connect", "--credentials", "--help", "--set"}
"""Options of each command that joins a site or starts services."""
PRINTED_BY = {
    ("pointit/runtime/config/plugins.py", "--imu"): "pointit run",
    ("pointit/runtime/config/plugins.py", "--output"): "pointit run",
    ("pointit/runtime/foreign_zenoh.py", "--listen"): "pointit run",
    ("pointit/runtime/host/store.py", "--site"): "pointit service run keeper",
    ("pointit/runtime/link/options.py", "--listen"): "pointit run",
    ("pointit/runtime/link/options.py", "--site"): "pointit run",
    ("pointit/runtime/link/refusal.py", "--host"): "pointit site renew",
    ("pointit/runtime/service/process.py", "--config"): "pointit service run pui",
    ("pointit/runtime/service/process.py", "--name"): "pointit service run pui",
    ("pointit/runtime/service/process.py", "--user"): "pointit service run pointing",
    ("pointit/runtime/zenoh/session.py", "--listen"): "pointit run",
    ("schemas/catalogue/asyncapi.py", "--write"): "pointit topic schema",
    ("schemas/catalogue/catalogue.py", "--write"): "pointit topic schema",
}
"""Options in sentences of shared rooms, and a command that prints each, or that the sentence names."""
OF_OTHER_PROGRAMS = {("pointit/runtime/host/extras.py", "--with")}
"""Options of `uvx`."""
DOCUMENTS = [
    ROOT / "README.md",
    *sorted((ROOT / "docs").rglob("*.md")),
    *sorted((ROOT / "deploy").glob("*.md")),
]
BASH = "/bin/bash"
GIT = shutil.which("git") or "git"
INSTALLS_NAME = re.compile(
    r"\b(?:pip3? install|pipx install|pipx run|uv tool install|uvx|uv pip install)(?: --?[\w-]+)* "
    r"'?pointit(?:[-_]lab)?(?:\[[^\]]*\])?'?(?![\w./-])"
)
"""A command that installs PointIt by its name from an index."""


def commands(group: click.Command, name: str = "pointit") -> Iterator[tuple[str, click.Command]]:
    yield name, group
    if isinstance(group, click.Group):
        context = click.Context(group)
        for each in group.list_commands(context):
            command = group.get_command(context, each)
            if command is not None:
                yield from commands(command, f"{name} {each}")


def known_options() -> set[str]:
    options = {"--help"}
    for _name, command in commands(front()):
        for parameter in command.params:
            options.update(parameter.opts + parameter.secondary_opts)
    return options


def sentences(path: Path) -> Iterator[str]:
    """Yield the texts of a module that people may read, without its docstrings."""
    module = tree(path)
    documents = {
        id(node.body[0].value)
        for node in ast.walk(module)
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef)
        and node.body
        and isinstance(node.body[0], ast.Expr)
    }
    for node in ast.walk(module):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in documents:
            yield node.value


def _shown_part(part: ast.expr) -> str:
    """Return a part of an f-string: its text, or its expression in braces."""
    if isinstance(part, ast.Constant):
        return str(part.value)
    assert isinstance(part, ast.FormattedValue)
    return f"{{{ast.unparse(part.value)}}}"


def test_sentence_of_a_shared_room_names_no_option_of_one_command() -> None:
    options = known_options() - COMMON_OPTIONS
    found: set[tuple[str, str]] = set()
    for path in shipped():
        if not shown(path).startswith(SHARED):
            continue
        for text in sentences(path):
            found |= {(shown(path), option) for option in OPTION.findall(text) if " " in text}
    named = {(place, option) for place, option in found if option in options} - OF_OTHER_PROGRAMS
    assert not named - PRINTED_BY.keys(), "name a variable, or let the caller give the remedy"
    assert not PRINTED_BY.keys() - named, "these are gone: remove them from the list"


@pytest.mark.parametrize(("place", "option"), PRINTED_BY)
def test_option_in_a_shared_sentence_exists_in_its_command(place: str, option: str) -> None:
    command = dict(commands(front()))[PRINTED_BY[place, option]]
    assert option in {name for parameter in command.params for name in parameter.opts}


def test_path_in_a_printed_shell_command_is_quoted() -> None:
    """The value of a path stands in `shlex.quote`, as it may have a blank."""
    found: list[str] = []
    for path in shipped():
        for node in ast.walk(tree(path)):
            if not isinstance(node, ast.JoinedStr):
                continue
            text = "".join(map(_shown_part, node.values))
            for command in COMMAND.findall(text):
                values = re.findall(r"\{([^}]*)\}", command)
                if any(re.search(r"\b(path|file|folder|directory)\b", each) for each in values):
                    found += [f"{shown(path)}: {command}" for each in values if "quote" not in each]
    assert not found


@pytest.mark.parametrize("path", DOCUMENTS, ids=lambda path: path.stem)
def test_no_document_installs_a_name_that_no_index_has(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    assert not [
        found for found in INSTALLS_NAME.findall(text) if "wheel" not in found and ".whl" not in found
    ]


def test_rule_finds_an_installation_by_name_and_no_other() -> None:
    assert INSTALLS_NAME.search("`pip install 'pointit[plot]'` adds an extra")
    assert INSTALLS_NAME.search("pipx install pointit")
    assert not INSTALLS_NAME.search("pip install 'dist/pointit-0.5.0-py3-none-any.whl[web]'")
    assert not INSTALLS_NAME.search("~/pointit-env/bin/pip install '.[web]'")


def test_chmod_is_printed_quoted_and_works(tmp_path: Path) -> None:
    secret = tmp_path / "my token.txt"
    secret.write_bytes(b"secret")
    secret.chmod(0o644)
    with pytest.raises(ConfigError) as refusal:
        read_secret(secret, 100)
    _, command, _ = str(refusal.value).split("`")
    subprocess.run(shlex.split(command), check=True)
    assert read_secret(secret, 100) == b"secret"


@pytest.mark.parametrize("is_refused", [False, True])
def test_chmod_is_not_offered_where_a_file_system_keeps_no_modes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, *, is_refused: bool
) -> None:
    """Drives of Windows in WSL ignore `chmod`; exFAT refuses it. A stand-in: mounts need rights."""

    def change_nothing(*_arguments: object, **_options: object) -> None:
        if is_refused:
            raise PermissionError

    secret = tmp_path / "my token.txt"
    secret.write_bytes(b"secret")
    secret.chmod(0o777)
    assert keeps_modes(tmp_path)
    monkeypatch.setattr(Path, "chmod", change_nothing)
    with pytest.raises(ConfigError) as refusal:
        read_secret(secret, 100)
    assert "`chmod" not in str(refusal.value)
    assert f"{state_file.NO_MODES}: move it into your home directory" in str(refusal.value)
    assert [each.name for each in tmp_path.iterdir()] == ["my token.txt"]


def test_removal_in_the_documents_leaves_the_home_of_people(tmp_path: Path) -> None:
    """Each `rm` of a home directory's file in a document is run beside files that it does not know."""
    kept = [tmp_path / ".local/share/pointit/home" / name for name in ("home.yaml", "site.yaml", "own.txt")]
    kept += [tmp_path / ".config/own.yaml", tmp_path / "own.mcap"]
    for file in kept:
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text("things: {}\n", encoding="utf-8")
    state = tmp_path / ".local/state/pointit/users"
    state.mkdir(parents=True)

    lines = [line for path in DOCUMENTS for line in path.read_text(encoding="utf-8").splitlines()]
    removals = [line for line in lines if re.match(r"rm -r?f? ?.*~", line)]
    assert removals
    for line in removals:
        subprocess.run([BASH, "-c", line], check=True, env={"HOME": str(tmp_path)}, cwd=tmp_path)
    assert not state.exists()
    assert [file for file in kept if not file.exists()] == []


def test_checkout_of_windows_has_scripts_that_a_shell_reads(tmp_path: Path) -> None:
    """A clone by a git with `core.autocrlf=true`, the default of Git for Windows."""
    origin = tmp_path / "origin"
    (origin / "scripts").mkdir(parents=True)
    for name in (".gitattributes", "scripts/demo", "scripts/lib.sh"):
        (origin / name).write_bytes((ROOT / name).read_bytes())
    identity = ["-c", "user.name=a", "-c", "user.email=a@example.org"]
    for arguments in (["init", "-q"], ["add", "-A"], [*identity, "commit", "-qm", "a"]):
        subprocess.run([GIT, *arguments], cwd=origin, check=True)
    clone = [GIT, "-c", "core.autocrlf=true", "clone", "-q", str(origin), "clone"]
    subprocess.run(clone, cwd=tmp_path, check=True)
    assert b"\r" not in (tmp_path / "clone/scripts/demo").read_bytes()
    subprocess.run([BASH, "-n", "scripts/demo"], cwd=tmp_path / "clone", check=True)
