"""`pointit replay`: a recording through the services of this version, and the differences in their output."""

import asyncio
import contextlib
import sys
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Literal, cast

import click

from pointit.cli.common.output import (
    OutputSection,
    console,
    interruptible,
    json_option,
    print_json,
    print_table,
    progress,
    say,
    to_line,
)
from pointit.cli.common.panels import Finite, PanelCommand
from pointit.cli.common.site_link import join_site, site_options
from pointit.conversion.recording_file import new_recording
from pointit.recording.entries import Entry
from pointit.recording.reader import Recording
from pointit.recording.writer import RecordingWriter
from pointit.replay.comparison import (
    Comparison,
    ComparisonReport,
    Divergence,
    FieldReport,
    TopicReport,
    sample_of,
)
from pointit.replay.playing import (
    ReplayPlan,
    plan_replay,
    play_live,
    recorded_outputs,
    replay,
    replay_by_loop_time,
)
from pointit.replay.replayed_services import SERVICES, Level
from pointit.runtime.service.logs import setup_logging
from pointit.schemas import NS_PER_S

DIFFERENT = 1
"""Exit code of a comparison that found differences."""

MAX_FIELDS = 3
"""Fields of a topic that the table names."""


@click.command(
    "replay",
    params=site_options(),
    cls=PanelCommand,
    usual=("compare", "output", "speed", "level", "live", "outputs", "connect"),
)
@click.argument("file", type=click.Path(path_type=Path, dir_okay=False))
@click.option(
    "--from",
    "level",
    type=click.Choice(list(SERVICES)),
    default="edge",
    help="replayed part of the recording: messages of devices, or also rays and poses, or also cursors",
)
@click.option(
    "--speed",
    type=Finite(0.01, 100),
    help="speed relative to real time; without it, as fast as this machine computes",
)
@click.option("--to", "output", type=click.Path(path_type=Path, dir_okay=False), help="file for the result")
@click.option("--overwrite", is_flag=True, help="replace the file of --to if it exists")
@click.option("--compare", is_flag=True, help="compare with the recording; exits with 1 if they differ")
@click.option(
    "--live", is_flag=True, help="play on a site at --speed, 1 by default; it must not run the same services"
)
@click.option(
    "--output",
    "outputs",
    type=click.Choice(["none", "recorded"]),
    default="none",
    help="with --live: drive the outputs at the recorded addresses, or none",
)
@json_option
def command(
    *,
    file: Path,
    level: Level,
    speed: float | None,
    output: Path | None,
    overwrite: bool,
    compare: bool,
    live: bool,
    outputs: str,
    as_json: bool,
    site: str,
    connect: tuple[str, ...],
) -> int:
    """Run the services of FILE, a recording, again on the recorded data of its devices.

    They have their recorded parameters, map and states, and the recording's time. Without --live no site is
    joined, and without --output recorded no light is lit. The same file gives the same result, byte for byte.
    --compare shows by topic how many messages differ from the recorded ones, by how much, and the first
    that does.

    Example: pointit replay session.mcap --compare
    """
    if outputs == "recorded" and not live:
        raise click.UsageError("--output recorded drives lights in recorded time: give --live, too")
    setup_logging("warning")
    with contextlib.ExitStack() as stack:
        stack.enter_context(interruptible())
        recording = stack.enter_context(Recording.open(file))
        if recording.problem:
            say(recording.problem, err=True)
        _tell_missing(recording.head.without, level)
        plan = plan_replay(recording, level)

        # What is computed again is counted, and written and compared if asked
        writer = None
        if output is not None:
            writer = stack.enter_context(new_recording(output, recording.head, overwrite=overwrite))
        length_s = (recording.ended_ns - recording.began_ns) / NS_PER_S
        tell = stack.enter_context(progress(round(length_s)))

        def tick(time_ns: int) -> None:
            tell("seconds replayed", (time_ns - recording.began_ns) // NS_PER_S)

        result = _Result(writer, Comparison() if compare else None, tick)

        # On a site in its time, or alone: in virtual time, or slowed down to a speed
        if live:
            lights = outputs == "recorded"
            _print_outputs(recorded_outputs(recording), lights=lights)
            say(f"playing {length_s:.1f} s on site {site}; Ctrl-C ends it", err=True)
            asyncio.run(_play_live(plan, result, speed or 1.0, site, connect, lights=lights))
        elif speed is None:
            replay(plan, result)
        else:
            asyncio.run(replay_by_loop_time(plan, result, speed))
    if recording.invalid:
        say(f"{recording.invalid} entries were left out: {recording.first_error}", err=True)
    if output is not None and writer is not None:
        say(f"{output}: {writer.entries} entries", err=True)
    return _print_result(result, length_s, recording.began_ns, as_json=as_json)


def _print_result(result: "_Result", length_s: float, began_ns: int, *, as_json: bool) -> int:
    if result.comparison is None:
        _print_counts(result.counts, length_s, as_json=as_json)
        return 0
    report = result.comparison.finish()
    if as_json:
        print_json({"duration_s": length_s, "is_same": report.is_same, **report.model_dump()})
    else:
        print_report(report, began_ns)
    return 0 if report.is_same else DIFFERENT


async def _play_live(
    plan: ReplayPlan, result: "_Result", speed: float, site: str, connect: tuple[str, ...], *, lights: bool
) -> None:
    async with join_site(site, connect) as bus:
        await play_live(plan, bus, result, speed, lights=lights)


def _tell_missing(without: Sequence[str], level: Level) -> None:
    """Say what the recording was made without, and from which level it can be replayed all the same."""
    if not without:
        return
    sentence = f"recorded without {', '.join(without)}: what services compute from it is missing"
    if "imu" in without and level != "cursors":
        sentence += "; --from cursors needs no imu"
    say(sentence, err=True)


def _print_outputs(outputs: Sequence[str], *, lights: bool) -> None:
    """Say which outputs the recording drives, or would: it may come from anybody."""
    state = "is driven" if lights else "is left out"
    for output in outputs:
        say(f"output {output} {state}", err=True)
    if outputs and not lights:
        say("--output recorded drives them", err=True)


class _Result:
    """Counts, compares and writes what a replay yields."""

    def __init__(
        self, writer: RecordingWriter | None, comparison: Comparison | None, tick: Callable[[int], None]
    ) -> None:
        self._writer = writer
        self._tick = tick
        self._printed_ns = 0
        self.comparison = comparison
        self.counts = Counter[str]()
        """Recomputed messages by key."""

    def recorded(self, entry: Entry) -> None:
        """Compare an entry of the recording."""
        self._compare("recorded", entry)

    def replayed(self, entry: Entry, *, is_recomputed: bool) -> None:
        """Write an entry, and compare it if it was computed now."""
        if entry.time_ns - self._printed_ns > NS_PER_S:
            self._printed_ns = entry.time_ns
            self._tick(entry.time_ns)
        if self._writer is not None:
            self._writer.add(entry)
        if is_recomputed:
            self.counts[entry.key] += 1
            self._compare("replayed", entry)

    def _compare(self, side: Literal["recorded", "replayed"], entry: Entry) -> None:
        if self.comparison is None:
            return
        sample = sample_of(entry)
        if sample is not None:
            self.comparison.add(side, sample)


def _print_counts(counts: Counter[str], length_s: float, *, as_json: bool) -> None:
    if as_json:
        print_json({"duration_s": length_s, "replayed": dict(sorted(counts.items()))})
        return
    rows: list[dict[str, object]] = []
    for key, count in sorted(counts.items()):
        rows.append({"key": key, "messages": count})
    about = f"computed again from {length_s:.1f} s; --compare compares them with the recorded ones"
    print_table(console(), OutputSection(name="messages", about=about, rows=tuple(rows)))
    sys.stdout.flush()


def print_report(report: ComparisonReport, began_ns: int) -> None:
    """Print the topics as a table, and the first message that differs. `began_ns`: of the recording."""
    rows = tuple(_row(topic, began_ns) for topic in report.topics)
    about = "computed again, against the recorded ones; times of the first that differs since the beginning"
    section = OutputSection(name="messages", about=about, rows=rows, whole=frozenset(("key",)))
    print_table(console(), section)
    for line in first_lines(report, began_ns):
        say(line)


def first_lines(report: ComparisonReport, began_ns: int) -> list[str]:
    """Return the first message that differs, with its partner, or that there is none."""
    first = report.first
    if first is None:
        messages = sum(topic.replayed for topic in report.topics)
        return [f"no difference in {messages} messages of {len(report.topics)} keys"]
    since = _since(first, began_ns)
    recorded = _shown(first, first.recorded, first.replayed)
    replayed = _shown(first, first.replayed, first.recorded)
    return [
        f"the first that differs is on {first.key}, {since} after the beginning:",
        f"- recorded: {recorded}",
        f"- replayed: {replayed}",
    ]


def _row(topic: TopicReport, began_ns: int) -> dict[str, object]:
    first = "" if topic.first is None else _since(topic.first, began_ns)
    differences = [_field(field) for field in topic.fields[:MAX_FIELDS]]
    return {
        "key": topic.key,
        "recorded": topic.recorded,
        "replayed": topic.replayed,
        "differ": topic.differ,
        "missing": topic.only_recorded,
        "new": topic.only_replayed,
        "first": first,
        "largest differences": ", ".join(differences),
    }


def _field(field: FieldReport) -> str:
    if field.largest is None:
        return field.field
    unit = " s" if field.field.endswith("_ns") else ""
    return f"{field.field} {field.largest:.3g}{unit}"


def _since(divergence: Divergence, began_ns: int) -> str:
    return f"{(divergence.time_ns - began_ns) / NS_PER_S:.3f} s"


def _shown(divergence: Divergence, content: dict[str, object] | None, other: dict[str, object] | None) -> str:
    """Return the parts of a message that differ from the `other`, or all of it if it has no partner."""
    if content is None:
        return "no such message"
    if other is None:
        return to_line(content)
    names = {field.partition(".")[0] for field in divergence.fields} | {"stamp_ns"}
    shown: dict[str, object] = {}
    for key, value in content.items():
        if key in names:
            shown[key] = _differing(value, other.get(key))
    return to_line(shown)


def _differing(value: object, other: object) -> object:
    """Return the items of a list that differ, with their ids, and the first pixel of bytes that does."""
    if isinstance(value, bytes) and isinstance(other, bytes):
        return _differing_pixel(value, other)
    if isinstance(value, dict) and isinstance(other, dict):
        return _differing_fields(cast("dict[str, object]", value), cast("dict[str, object]", other))
    if isinstance(value, (list, tuple)) and isinstance(other, (list, tuple)):
        return _differing_items(cast("Sequence[object]", value), cast("Sequence[object]", other))
    return value


def _differing_pixel(rgb: bytes, other: bytes) -> object:
    if len(rgb) != len(other):
        return rgb
    for position, (byte, other_byte) in enumerate(zip(rgb, other, strict=True)):
        if byte != other_byte:
            pixel = position // 3
            color = rgb[3 * pixel :][:3]
            return {"pixel": pixel, "rgb": list(color)}
    return rgb


def _differing_fields(fields: dict[str, object], others: dict[str, object]) -> dict[str, object]:
    differing: dict[str, object] = {}
    for name, value in fields.items():
        other = others.get(name)
        if name == "id" or value != other:
            differing[name] = _differing(value, other)
    return differing


def _differing_items(items: Sequence[object], others: Sequence[object]) -> Sequence[object]:
    # Numbers, such as a position, are shown whole
    has_parts = any(isinstance(item, dict) for item in items)
    if len(items) != len(others) or not has_parts:
        return items
    differing: list[object] = []
    for item, other in zip(items, others, strict=True):
        if item != other:
            differing.append(_differing(item, other))
    return differing
