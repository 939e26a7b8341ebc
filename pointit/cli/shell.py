"""`pointit completion`: installs completion in a shell, and removes it."""

import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import click
import platformdirs
from click.shell_completion import BashComplete, FishComplete, ShellComplete, ZshComplete

from pointit.cli.common.lazy import COMPLETE
from pointit.runtime.errors import ConfigError
from pointit.runtime.host.state_file import replaced_file
from pointit.schemas.text import system_reason

SHELLS: dict[str, type[ShellComplete]] = {"bash": BashComplete, "zsh": ZshComplete, "fish": FishComplete}
ZSH_SETUP = "(( $+functions[compdef] )) || { autoload -Uz compinit && compinit }\n"
"""zsh has no `compdef` before its completion is set up."""
HEADING = "# completion of pointit"
"""Comment above the line that loads the script."""


@dataclass(frozen=True)
class CompletionFiles:
    """Files of the completion in one shell."""

    script: Path
    """File with the completion script."""
    start_file: Path | None
    """File of the shell that loads the script. None if the shell finds the script by itself."""

    @property
    def line(self) -> str:
        """Line of `start_file`. It does nothing if the script is gone, as after an uninstall."""
        return f'[ -f "{self.script}" ] && source "{self.script}"\n'

    @property
    def unguarded_line(self) -> str:
        """Line that versions before 0.4 wrote."""
        return f'source "{self.script}"\n'


@click.command("completion")
@click.argument("shell", type=click.Choice(list(SHELLS)), required=False)
@click.option("--print", "is_printed", is_flag=True, help="print the script instead of installing it")
@click.option("--remove", "is_removed", is_flag=True, help="remove the script and the line that loads it")
@click.pass_context
def command(ctx: click.Context, *, shell: str | None, is_printed: bool, is_removed: bool) -> None:
    """Install completion by the Tab key in SHELL, by default that of your account.

    It completes commands, options, and names of scenarios, maps and services. Writes the script, and for bash
    and zsh a line in .bashrc or .zshrc that loads it. Before you uninstall PointIt, --remove removes both.

    Example: pointit completion bash
    """
    name = shell or Path(os.environ.get("SHELL", "")).name
    if name not in SHELLS:
        raise ConfigError(f"SHELL: {name or 'none'} is not supported; name one of {', '.join(SHELLS)}")
    if is_printed and is_removed:
        raise click.UsageError("--print and --remove exclude each other")

    # The script of the completion is click's
    script = SHELLS[name](ctx.find_root().command, {}, "pointit", COMPLETE).source()
    if name == "zsh":
        script = ZSH_SETUP + script
    if is_printed:
        click.echo(script)
        return

    # Its files, and the shell's own file that loads it
    try:
        files = _files(name)
    except RuntimeError as error:
        raise ConfigError("there is no home directory; set HOME, or print the script with --print") from error
    if is_removed:
        _change(files, _remove)
        click.echo(f"completion for {name} is removed")
        return
    _change(files, lambda files: _install(files, script))
    place = f"{files.script}"
    if files.start_file is not None:
        place = f"{files.script}, which {files.start_file} loads"
    click.echo(f"completion for {name} is in {place}; open a new terminal to use it")


def _change(files: CompletionFiles, change: Callable[[CompletionFiles], None]) -> None:
    """Apply `change`. Raises: ConfigError: If a file cannot be written."""
    try:
        change(files)
    except OSError as error:
        raise ConfigError(
            f"{error.filename}: cannot be written ({system_reason(error)}); print the script with --print"
        ) from error


def _install(files: CompletionFiles, script: str) -> None:
    """Write the script, and the line that loads it unless it is there."""
    files.script.parent.mkdir(parents=True, exist_ok=True)
    with replaced_file(files.script) as part:
        part.write_text(script, encoding="utf-8")
    if files.start_file is None:
        return

    # The file is the user's: its encoding is unknown, so it is read and written as bytes.
    previous = _bytes_of(files.start_file)
    if files.line.encode() in previous:
        return
    content = _without_lines(previous, files)
    entry = f"\n{HEADING}\n{files.line}".encode()
    with replaced_file(files.start_file) as part:
        part.write_bytes(content + entry)


def _remove(files: CompletionFiles) -> None:
    """Delete the script, and the line that loads it."""
    files.script.unlink(missing_ok=True)
    if files.start_file is None:
        return
    previous = _bytes_of(files.start_file)
    content = _without_lines(previous, files)
    if content != previous:
        with replaced_file(files.start_file) as part:
            part.write_bytes(content)


def _bytes_of(path: Path) -> bytes:
    if not path.exists():
        return b""
    return path.read_bytes()


def _without_lines(content: bytes, files: CompletionFiles) -> bytes:
    """Return `content` of a start file without the lines that this command wrote in any version."""
    for line in (files.line, files.unguarded_line):
        content = content.replace(f"\n{HEADING}\n{line}".encode(), b"")
        if content.startswith(line.encode()):
            content = content.removeprefix(line.encode())
        content = content.replace(f"\n{line}".encode(), b"\n")
    return content


def _files(shell: str) -> CompletionFiles:
    """Return the files of the completion in `shell`.

    Raises:
        RuntimeError: If there is no home directory.
    """
    if shell == "fish":
        folder = Path(os.environ.get("XDG_CONFIG_HOME") or Path.home() / ".config")
        return CompletionFiles(script=folder / "fish/completions/pointit.fish", start_file=None)
    script = platformdirs.user_data_path("pointit", appauthor=False) / f"completion.{shell}"
    folder = Path.home()
    if shell == "zsh" and os.environ.get("ZDOTDIR"):
        folder = Path(os.environ["ZDOTDIR"])
    return CompletionFiles(script=script, start_file=folder / f".{shell}rc")
