"""`pointit home`: a home's lamps by pointing, set up in the page, without a second command."""

import json
from pathlib import Path

import click
import platformdirs

from pointit.bridges.home_assistant.setup.home_files import HomeFiles
from pointit.bridges.home_assistant.setup.progress import SetupProgress
from pointit.cli.common.panels import PanelCommand
from pointit.cli.page import browser_option, port_option
from pointit.cli.run.run import run
from pointit.runtime.errors import ConfigError
from pointit.runtime.host.extras import has_extra, remedy
from pointit.runtime.service.process import log_options

EXTRA = "home"
FIRST_PERSON = "0,0,0"
"""Pose of the person until they have pointed: at the first place, where the map begins."""


def default_folder() -> Path:
    """Return the folder of a user's home. Raises ConfigError: there is no home directory."""
    try:
        return platformdirs.user_data_path("pointit", appauthor=False) / "home"
    except RuntimeError as error:  # a user id without a name, and no HOME
        raise ConfigError("there is no home directory; set HOME, or give a folder by --folder") from error


@click.command("home", cls=PanelCommand, usual=("folder", "edit", "lan", "credentials"))
@click.option(
    "--folder",
    type=click.Path(path_type=Path, file_okay=False),
    help="folder of home.yaml, site.yaml and the token  [default: the user's folder of PointIt]",
)
@click.option("--edit", is_flag=True, help="start again at the first card; what is set up stays")
@click.option(
    "--lan",
    is_flag=True,
    help="open the page to the local network from the start, by HTTPS, as phones need it",
)
@click.option("--site", help="name of the site  [default: as of `pointit run`]")
@click.option(
    "--credentials",
    type=click.Path(path_type=Path),
    help="folder that `pointit site` has made, for a secured site; home-assistant needs an identity there",
)
@click.option("--no-view", is_flag=True, help="log instead of drawing in the terminal")
@browser_option
@port_option("--web-port", metavar="PORT")
def command(
    *,
    folder: Path | None,
    edit: bool,
    lan: bool,
    site: str | None,
    credentials: Path | None,
    no_view: bool,
    no_browser: bool,
    web_port: int | None,
    log_level: str,
) -> int:
    """Point at the lamps of your home. The page leads you through the set-up; the next start continues there.

    Five cards: connect to Home Assistant, choose lamps, pair a phone or a wristband, point at each lamp, try.
    They write home.yaml (a map) and site.yaml (parameters), which you may edit. Needs the extra `home`.

    Example: pointit home
    """
    if not has_extra(EXTRA):
        raise ConfigError(f"`pointit home` needs {remedy(EXTRA)}")
    home = (folder or default_folder()).absolute()
    files = HomeFiles(home)
    files.create()
    if edit:
        begin_again(files)

    # A home is a run with these options. JSON quotes the folder as a text of YAML, whatever its marks
    folder_text = json.dumps(str(home))
    arguments = [str(files.map), "--config", str(files.site), "--with", "home-assistant"]
    arguments += ["--imu", "page", "--pose", FIRST_PERSON, "--log-level", log_level]
    arguments += ["--set", f"home-assistant.setup={folder_text}", "--set", f"web.home_folder={folder_text}"]
    for option, is_wanted in (("--lan", lan), ("--no-view", no_view), ("--no-browser", no_browser)):
        if is_wanted:
            arguments.append(option)
    for option, value in (("--site", site), ("--credentials", credentials), ("--web-port", web_port)):
        if value is not None:
            arguments += [option, str(value)]
    code: int = run.main(arguments, prog_name="pointit home", standalone_mode=False) or 0
    return code


def begin_again(files: HomeFiles) -> None:
    """Show the first card at the next start. Raises ConfigError: what is stored cannot be used."""
    progress = SetupProgress(files.state.read())
    progress.go("connect")
    files.state.write(progress.state)


command.params += log_options()
