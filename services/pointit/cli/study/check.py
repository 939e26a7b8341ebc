"""`pointit study check`: what is missing or wrong in a study's folder."""

from pathlib import Path

import click

from pointit.cli.common.output import Section, json_option, say, show
from pointit.runtime.service.shutdown import EXIT_FAILED
from pointit.study.check import check_folder


@click.command("check")
@click.argument("folder", metavar="FOLDER", type=click.Path(path_type=Path))
@json_option
def command(*, folder: Path, as_json: bool) -> int:
    """Find missing trials, wrong clocks, broken balance and mixed-up participants in FOLDER.

    The exit code is 1 if something is wrong. What is only not done yet is a note.

    Example: pointit study check three_methods-data
    """
    findings = check_folder(folder)
    if findings or as_json:
        rows = tuple(finding._asdict() for finding in findings)
        show([Section(name="findings", about="missing or wrong", rows=rows)], as_json=as_json)
    else:
        say(f"{folder}: nothing is missing or wrong")
    return EXIT_FAILED if any(finding.severity == "error" for finding in findings) else 0
