"""`pointit map list`: the shipped maps."""

import click

from pointit.cli.common.output import Section, json_option, show
from pointit.maps.checks.check import contents
from pointit.maps.file import about_map, map_path, read_clouds, read_map_file, shipped_maps


@click.command("list")
@json_option
def command(*, as_json: bool) -> None:
    """List the shipped maps with their contents.

    Use one with `--set pui.map=NAME`.
    """
    rows: list[dict[str, str]] = []
    for name in shipped_maps():
        with map_path(name) as path:
            file = read_map_file(path)
            rows.append(
                {"name": name, "about": about_map(path), "has": contents(file, read_clouds(path, file))}
            )
    show(
        [Section(name="maps", about="draw one with `pointit map plot NAME -o FILE.svg`", rows=tuple(rows))],
        as_json=as_json,
    )
