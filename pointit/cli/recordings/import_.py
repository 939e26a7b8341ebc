"""`pointit import`: a recording from a table of another program or a bag of ROS 2."""

from collections.abc import Callable
from pathlib import Path
from typing import Literal

import click

from pointit.cli.common.completions import maps
from pointit.cli.common.output import interruptible, progress
from pointit.cli.common.panels import PanelCommand
from pointit.runtime.errors import ConfigError

SITE = "imported"
TABLES = (".csv", ".tsv", ".txt")


@click.command("import", cls=PanelCommand, usual=("recording", "columns", "lost", "up", "mounting", "room"))
@click.argument("source", type=click.Path(path_type=Path))
@click.option(
    "--to",
    "recording",
    required=True,
    type=click.Path(path_type=Path, dir_okay=False),
    metavar="FILE",
    help="the recording to write, such as session.mcap",
)
@click.option("--overwrite", is_flag=True, help="replace FILE if it exists")
@click.option("--user", default="user1", help="for a CSV file: the person's name")
@click.option(
    "--mounting",
    default="",
    show_default=False,
    help="for a CSV file: mounting of the sensor on the arm  "
    "[default: minus_x, as in a Myo; plus_x for Motion-BIDS]",
)
@click.option(
    "--columns",
    default="",
    show_default=False,
    metavar="LIST",
    help="for a CSV file: its columns by name or number, and units, t=time/ms,qx=3,robot_x=mm; "
    "t=time/us/32bit is a counter that starts again",
)
@click.option("--lost", default="", show_default=False, help="for a CSV file: text or number of lost values")
@click.option(
    "--up",
    type=click.Choice(["z", "y", "-y", "x", "-x", "-z"]),
    default="z",
    help="for a CSV file: its axis that points up",
)
@click.option(
    "--map",
    "room",
    metavar="MAP",
    shell_complete=maps,
    help="for a bag: the room, without which its packages and pointers have no positions",
)
@click.option(
    "--stamps",
    type=click.Choice(["header", "bag"]),
    default="header",
    help="for a bag: source of the capture times, the messages or the bag",
)
def command(
    *,
    source: Path,
    recording: Path,
    overwrite: bool,
    user: str,
    mounting: str,
    columns: str,
    lost: str,
    up: str,
    room: str | None,
    stamps: Literal["header", "bag"],
) -> None:
    """Make a recording of SOURCE, for `pointit export`, `pointit page` and `pointit evaluate`.

    SOURCE is a CSV file of an arm (columns t, qw, qx, qy, qz; also robot_x and head_x, y, z of motion
    capture) or of points on the floor (t, px, py with robot and head), in seconds and metres, z up, unless
    --columns, --lost and --up declare others; a _motion.tsv of Motion-BIDS beside its _channels.tsv; or a ROS
    2 bag of the ROS toolkit: its folder, or an .mcap or .db3 file. `pointit replay` computes rays from a file
    of an arm, and the position of a user who follows a robot. Other imports cannot be replayed.

    Example: pointit import rosbag2_2026_11_21 --map lab.yaml --to session.mcap
    """
    if not source.exists():
        raise ConfigError(f"{source}: there is no such file or folder")
    with interruptible(), progress() as tell:

        def tick(done: int) -> None:
            tell(f"{done} messages")

        # A table has samples only, a bag has messages of its own types
        if source.suffix.lower() in TABLES:
            from pointit.conversion.import_csv import csv_entries  # noqa: PLC0415 - only what is needed is loaded
            from pointit.conversion.recording_file import write_recording  # noqa: PLC0415 - needs an extra
            from pointit.sim.motion_table import MotionForm  # noqa: PLC0415 - as above

            form = MotionForm.model_validate({"columns": columns, "lost": lost, "up": up})
            entries = csv_entries(source, user=user, mounting=mounting, form=form, note=_note)
            count = write_recording(entries, recording, SITE, overwrite=overwrite, tick=tick)
        else:
            count = _import_bag(source, recording, room, stamps, overwrite=overwrite, tick=tick)
    click.echo(f"{recording}: {count} entries")


def _note(sentence: str) -> None:
    click.echo(f"note: {sentence}", err=True)


def _import_bag(
    source: Path,
    recording: Path,
    room: str | None,
    stamps: Literal["header", "bag"],
    *,
    overwrite: bool,
    tick: Callable[[int], None],
) -> int:
    from pointit.conversion.import_bag import Bag, is_bag  # noqa: PLC0415 - needs an extra
    from pointit.conversion.recording_file import write_recording  # noqa: PLC0415 - as above
    from pointit.maps.file import load_map  # noqa: PLC0415 - only what is needed is loaded

    if not is_bag(source):
        hint = "give the folder of a bag, or its .mcap or .db3"
        if source.suffix.lower() == ".bag":
            hint = f"of a ROS 1 bag, `rosbags-convert --src {source} --dst FOLDER` makes one"
        raise ConfigError(f"{source}: is neither a CSV file nor a ROS 2 bag; {hint}")
    environment = None if room is None else load_map(room, 0)
    bag = Bag(source, environment, stamps)
    try:
        return write_recording(bag.entries(), recording, SITE, overwrite=overwrite, tick=tick)
    finally:
        # Also if nothing could be taken: then the reasons are what matters
        for topic, taken in bag.taken.items():
            click.echo(f"{topic}: {taken} messages")
        for topic, reason in bag.left_out.items():
            count = bag.left_out_messages[topic]
            click.echo(f"note: {topic}: {count} messages left out, {reason}", err=True)
