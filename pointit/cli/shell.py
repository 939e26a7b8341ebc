"""`pointit completion`: installs completion in a shell."""

import os
from pathlib import Path

import click
import platformdirs
from click.shell_completion import BashComplete, FishComplete, ShellComplete, ZshComplete

from pointit.cli.common.lazy import COMPLETE
from pointit.runtime.errors import ConfigError
from pointit.runtime.host.state_file import replaced_file

SHELLS: dict[str, type[ShellComplete]] = {"bash": BashComplete, "zsh": ZshComplete, "fish": FishComplete}
ZSH_SETUP = "(( $+functions[compdef] )) || { autoload -Uz compinit && compinit }\n"
"""zsh has no `compdef` before its completion is set up."""


@click.command("completion")
@click.argument("shell", type=click.Choice(list(SHELLS)), required=False)
@click.option("--print", "is_printed", is_flag=True, help="print the script instead of installing it")
@click.pass_context
def command(ctx: click.Context, *, shell: str | None, is_printed: bool) -> None:
    """Install completion with the Tab key in SHELL, the one of your account by default.

    It completes commands, options, and names of scenarios, maps and services. Writes the script, and for bash
    and zsh a line in .bashrc or .zshrc that loads it.

    Example: pointit completion bash
    """
    name = shell or Path(os.environ.get("SHELL", "")).name
    if name not in SHELLS:
        raise ConfigError(f"SHELL: {name or 'none'} is not supported; name one of {', '.join(SHELLS)}")
    script = SHELLS[name](ctx.find_root().command, {}, "pointit", COMPLETE).source()
    script = ZSH_SETUP + script if name == "zsh" else script
    if is_printed:
        click.echo(script)
        return
    try:
        file, start = _files(name)
    except RuntimeError as error:
        raise ConfigError("there is no home directory; set HOME, or print the script with --print") from error
    line = f'source "{file}"\n'
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        with replaced_file(file) as part:
            part.write_text(script, encoding="utf-8")
        if start is not None and (not start.exists() or line.encode() not in start.read_bytes()):
            with start.open("a", encoding="utf-8") as opened:
                opened.write(f"\n# completion of pointit\n{line}")
    except OSError as error:
        raise ConfigError(
            f"{error.filename}: cannot be written ({error.strerror}); print the script with --print"
        ) from error
    where = f"{file}" if start is None else f"{file}, which {start} loads"
    click.echo(f"completion for {name} is in {where}; open a new terminal to use it")


def _files(shell: str) -> tuple[Path, Path | None]:
    """Return the script's file, and the file that loads it, if one has to.

    Raises:
        RuntimeError: If there is no home directory.
    """
    if shell == "fish":
        folder = Path(os.environ.get("XDG_CONFIG_HOME") or Path.home() / ".config")
        return folder / "fish/completions/pointit.fish", None
    file = platformdirs.user_data_path("pointit", appauthor=False) / f"completion.{shell}"
    home = os.environ.get("ZDOTDIR") if shell == "zsh" else None
    return file, Path(home or Path.home()) / f".{shell}rc"
