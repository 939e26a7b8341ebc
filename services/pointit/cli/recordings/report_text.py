"""The comparison of a replay with its recording, for people."""

from collections.abc import Sequence
from typing import cast

from pointit.cli.common.output import Section, console, print_table, say, to_line
from pointit.replay.comparison.report import Divergence, FieldReport, Report, TopicReport
from pointit.schemas import NS_PER_S

MAX_FIELDS = 3
"""Fields of a topic that the table names."""


def print_report(report: Report, began_ns: int) -> None:
    """Print the topics as a table, and the first message that differs. `began_ns`: of the recording."""
    rows = tuple(_row(topic, began_ns) for topic in report.topics)
    about = "computed again, against the recorded ones; times of the first that differs since the beginning"
    print_table(console(), Section(name="messages", about=about, rows=rows, whole=frozenset(("key",))))
    for line in first_lines(report, began_ns):
        say(line)


def lines_of(report: Report, began_ns: int) -> list[str]:
    """Return a line for each topic, and the first message that differs."""
    lines = [
        ", ".join(f"{name} {value}" for name, value in _row(topic, began_ns).items() if value)
        for topic in report.topics
    ]
    return [*lines, *first_lines(report, began_ns)]


def first_lines(report: Report, began_ns: int) -> list[str]:
    """Return the first message that differs, with its partner, or that there is none."""
    first = report.first
    if first is None:
        messages = sum(topic.replayed for topic in report.topics)
        return [f"no difference in {messages} messages of {len(report.topics)} keys"]
    return [
        f"the first that differs is on {first.key}, {_since(first, began_ns)} after the beginning:",
        f"- recorded: {_shown(first, first.recorded, first.replayed)}",
        f"- replayed: {_shown(first, first.replayed, first.recorded)}",
    ]


def _row(topic: TopicReport, began_ns: int) -> dict[str, object]:
    return {
        "key": topic.key,
        "recorded": topic.recorded,
        "replayed": topic.replayed,
        "differ": topic.differ,
        "missing": topic.only_recorded,
        "new": topic.only_replayed,
        "first": "" if topic.first is None else _since(topic.first, began_ns),
        "largest differences": ", ".join(_field(each) for each in topic.fields[:MAX_FIELDS]),
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
    return to_line(
        {name: _differing(value, other.get(name)) for name, value in content.items() if name in names}
    )


def _differing(one: object, other: object) -> object:
    """Return the items of a list that differ, with their ids, and the first pixel of bytes that does."""
    whole = one  # of the declared type, which the checks narrow
    if isinstance(one, bytes) and isinstance(other, bytes) and one != other and len(one) == len(other):
        pixel = next(at for at, (x, y) in enumerate(zip(one, other, strict=True)) if x != y) // 3
        return {"pixel": pixel, "rgb": list(one[3 * pixel :][:3])}
    if isinstance(one, dict) and isinstance(other, dict):
        mine, theirs = cast("dict[str, object]", one), cast("dict[str, object]", other)
        return {
            name: _differing(value, theirs.get(name))
            for name, value in mine.items()
            if name == "id" or value != theirs.get(name)
        }
    if isinstance(one, list | tuple) and isinstance(other, list | tuple):
        items, others = cast("Sequence[object]", one), cast("Sequence[object]", other)
        if len(items) == len(others) and any(isinstance(each, dict) for each in items):
            pairs = zip(items, others, strict=True)
            return [_differing(item, partner) for item, partner in pairs if item != partner]
        return items
    return whole
