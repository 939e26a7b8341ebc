"""`pointit export`: a recording as tidy tables or as Motion-BIDS."""

import functools
from collections.abc import Mapping
from pathlib import Path

import click

from pointit.cli.common.output import interruptible, progress
from pointit.schemas.text import first_of

TASK = "pointing"

MAX_SHOWN_CHANNELS = 5
"""Maximum number of unknown channels that a note names."""


@click.command("export")
@click.argument("recording", metavar="FILE", type=click.Path(path_type=Path))
@click.option(
    "--to",
    "folder",
    required=True,
    type=click.Path(path_type=Path),
    metavar="DIR",
    help="folder for the tables, or a BIDS dataset; created if it does not exist",
)
@click.option("--overwrite", is_flag=True, help="replace tables that are in the folder")
@click.option(
    "--format",
    "form",
    type=click.Choice(["csv", "motion-bids"]),
    default="csv",
    show_default=True,
    help="tables, or the Brain Imaging Data Structure for motion",
)
@click.option("--task", default=TASK, show_default=True, help="task of motion-bids")
@click.option("--session", default="", help="session label of motion-bids; if empty, there is one session")
def export(*, recording: Path, folder: Path, overwrite: bool, form: str, task: str, session: str) -> int:
    """Write the recording FILE as tidy CSV tables, or as a dataset of Motion-BIDS.

    The tables have units in the names of columns. selections.csv has a row for each selection, acts.csv one
    for each pointing act, the others (cursors, rays, poses, imu, objects and more) one for each message.
    columns.csv describes every column.

    Motion-BIDS has motion, channels and events of each person. More recordings join the same dataset.

    Exit code 1: the tables lack messages, as FILE is damaged, or some of its messages cannot be read.

    Example: pointit export session.mcap --to tables
    """
    has_bids_option = session or task != TASK
    if form == "csv" and has_bids_option:
        raise click.UsageError("--task and --session are of --format motion-bids: leave them out, or add it")
    from pointit.conversion.export_bids import export_bids  # noqa: PLC0415 - only what is needed is loaded
    from pointit.conversion.export_csv import export_csv  # noqa: PLC0415 - as above
    from pointit.recording.reader import Recording  # noqa: PLC0415 - needs an extra

    with Recording.open(recording) as opened:
        if opened.problem:
            click.echo(f"note: {opened.problem}", err=True)
        with interruptible(), progress(sum(opened.counts.values())) as tell:
            # Each message is read once, in the order of the file
            tick = functools.partial(tell, "messages")
            if form == "csv":
                exported = export_csv(
                    opened.entries(), opened.began_ns, folder, overwrite=overwrite, tick=tick
                )
            else:
                exported = export_bids(
                    opened.entries(), folder, task=task, session=session, overwrite=overwrite, tick=tick
                )

        # What the tables lack, which is known only when all is read
        if opened.invalid:
            click.echo(f"note: {opened.invalid} messages are left out; {opened.first_error}", err=True)
        unknown = opened.unknown
        if unknown:
            click.echo(f"note: {_unknown_text(unknown)}", err=True)
        has_lost = any((opened.problem, opened.invalid, unknown))

    for name, rows in exported.rows.items():
        click.echo(f"{folder / name}: {rows} rows")
    if exported.left_out:
        counts = [f"{count} of {key}" for key, count in exported.left_out.items()]
        click.echo(f"Messages without a table: {', '.join(counts)}.")
    return 1 if has_lost else 0


def _unknown_text(counts: Mapping[str, int]) -> str:
    """Return the sentence about messages of channels that are unknown; `counts` by the channel's name."""
    channels = [f"{count} of {name}" for name, count in counts.items()]
    names = first_of(channels, MAX_SHOWN_CHANNELS)
    total = sum(counts.values())
    return (
        f"{total} messages are left out ({names}), whose channels are none of PointIt: "
        "if a newer PointIt recorded them, update yours"
    )
