"""`pointit study check`: what is missing or wrong in a study's folder, or in its file."""

from pathlib import Path

import click

from pointit.commands import EXIT_FAILED, OutputSection, json_option, say, show
from pointit.study.check import Finding, check_folder
from pointit.study.model import read_study
from pointit.study.plan import check_sequences
from pointit.study.site.scenario import check_ready


@click.command("check")
@click.argument("path", metavar="FOLDER|FILE", type=click.Path(path_type=Path))
@json_option
def command(*, path: Path, as_json: bool) -> int:
    """Find missing trials, wrong clocks, broken balance and mixed-up participants in FOLDER.

    Check the FILE of a study for errors that would stop it later: values of services in all cells, pictures,
    the function that ends a trial, and blocks with too few trials for a throughput. The exit code is 1 if
    something is wrong. Trials that are not done yet are only a note.

    Example: pointit study check three_methods-data
    """
    findings: list[Finding] = []
    if path.is_file():
        study = read_study(path)
        check_ready(study)
        check_sequences(study)
    else:
        findings = check_folder(path)
    if findings or as_json:
        rows = tuple(finding._asdict() for finding in findings)
        show([OutputSection(name="findings", about="missing or wrong", rows=rows)], as_json=as_json)
    else:
        say(f"{path}: nothing is missing or wrong")
    return EXIT_FAILED if any(finding.severity == "error" for finding in findings) else 0
