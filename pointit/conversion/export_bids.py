"""A recording as a dataset of Motion-BIDS: files of motion, channels and events for each person.

Samples keep their times: rows are messages, and the channel `LATENCY` has the time of capture. Nothing is
resampled.
"""

import json
import re
import shutil
import tempfile
import unicodedata
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from datetime import UTC, datetime
from pathlib import Path

from pointit.conversion.bids_table import (
    MISSING,
    SYSTEMS,
    BidsChannel,
    BidsTable,
    channel_lines,
    channels_json,
    motion_folder,
    motion_json,
)
from pointit.conversion.export_csv import Exported, neutralize_formula
from pointit.recording.entries import Entry
from pointit.runtime.config.validation_message import format_value
from pointit.runtime.errors import ConfigError
from pointit.runtime.host.extras import pointit_version
from pointit.schemas import (
    NS_PER_S,
    ActOutcome,
    Cursor,
    ImuSample,
    Message,
    SelectionEvent,
    TrackedObjects,
    UserPose,
)
from pointit.schemas.text import system_reason
from pointit.site.site_state import ActResults

BIDS_VERSION = "1.10.0"
"""Version of the standard that the files keep to."""
TICK = 1000
"""Entries between two reports of progress."""
AXES = ("x", "y", "z")
QUATERNION = ("quat_x", "quat_y", "quat_z", "quat_w")
PERSON_KINDS = ("person", "person_frame")
"""Kinds of tracked objects whose ids are people."""
_DESCRIPTION = "dataset_description.json"
_PARTICIPANTS = "participants.tsv"

_EVENT_COLUMNS = {
    "trial_type": {"Description": "event of the object"},
    "object": {"Description": "id of the object"},
    "object_kind": {"Description": "kind of the object"},
    "cause": {"Description": "action of the person, such as dwell or button"},
}

_README = """# Pointing sessions

Exported from recordings of PointIt. Each tracking system has its own times: the channel `LATENCY` counts
from `acq_time` of `scans.tsv`, which all files of a session share. Positions of the system `cursor` and
`pose` are computed, the others measured."""


def export_bids(
    entries: Iterable[Entry],
    folder: Path,
    *,
    task: str = "pointing",
    session: str = "",
    overwrite: bool = False,
    tick: Callable[[int], None] = lambda _: None,
) -> Exported:
    """Write `entries` of a recording to the dataset in `folder`.

    Other people and sessions of a dataset stay. Nothing stays of an export that fails.

    Args:
        entries: in order of time.
        folder: a dataset, or a folder that is empty or does not exist.
        task: name of the task.
        session: label of the session, or `""` for a single one.
        overwrite: replace files that are there.
        tick: called with the number of entries so far.

    Raises:
        ConfigError: If there is no person, a name has no letters, or the folder cannot be used.
    """
    recorded = _RecordedMotion()
    for count, entry in enumerate(entries):
        recorded.add(entry)
        if count % TICK == 0:
            tick(count)
    if not recorded.people:
        raise ConfigError("the recording has no motion of a person: record a session with one")
    entities = f"_task-{bids_label(task)}"
    if session:
        entities = f"_ses-{bids_label(session)}{entities}"
    prefixes = {name: f"sub-{subject_label(name)}{entities}" for name in sorted(recorded.people)}

    try:
        folder.mkdir(parents=True, exist_ok=True)
        existing = _files_in(folder)
        if existing and Path(_DESCRIPTION) not in existing:
            raise ConfigError(f"{folder}: has files and is no BIDS dataset; give an empty folder")
        # All files are written beside the dataset first, so that nothing stays of an export that fails.
        staging = Path(tempfile.mkdtemp(dir=folder, prefix=".pointit-"))
        try:
            rows: dict[Path, int] = {}
            for person, prefix in prefixes.items():
                rows |= recorded.write(person, prefix, task, staging, folder)
            subjects = [prefix.partition("_")[0] for prefix in prefixes.values()]
            _write_dataset(staging, folder, subjects)
            outdated = _files_of(prefixes.values(), existing)
            if outdated and not overwrite:
                raise ConfigError(
                    f"{folder}: has {min(outdated)}; give --session a label, another folder, or --overwrite"
                )
            _replace_files(folder, staging, outdated)
        finally:
            shutil.rmtree(staging, ignore_errors=True)
    except OSError as error:
        raise ConfigError(f"{folder}: cannot be written ({system_reason(error)})") from error
    by_name = {f"{path}": count for path, count in rows.items()}
    return Exported(rows=by_name, left_out=dict(recorded.left_out))


def _files_in(folder: Path) -> set[Path]:
    """Return the files in `folder`, relative to it."""
    return {path.relative_to(folder) for path in folder.rglob("*") if path.is_file()}


def _files_of(prefixes: Iterable[str], existing: Collection[Path]) -> set[Path]:
    """Return the motion files of `prefixes`: files of other modalities and derivatives begin the same."""
    files: set[Path] = set()
    for prefix in prefixes:
        folder = motion_folder(prefix)
        for path in existing:
            if path.parent == folder and path.name.startswith(f"{prefix}_"):
                files.add(path)
    return files


def _replace_files(folder: Path, staging: Path, outdated: Collection[Path]) -> None:
    """Move the files in `staging` into `folder`, and delete those that are `outdated` and not replaced."""
    written = _files_in(staging)
    for path in sorted(written):
        (folder / path).parent.mkdir(parents=True, exist_ok=True)
        (staging / path).replace(folder / path)
    for path in set(outdated) - written:
        (folder / path).unlink()


def bids_label(name: str) -> str:
    """Return `name` with the letters and digits that the standard allows.

    Raises:
        ConfigError: If there is none.
    """
    plain = unicodedata.normalize("NFKD", name).encode("ascii", "ignore").decode()
    label = re.sub("[^0-9A-Za-z]", "", plain)
    if not label:
        raise ConfigError(f"{name!r}: has no letter or digit for a label of BIDS; give another name")
    return label


def subject_label(name: str) -> str:
    """Return the label of the person `name`, which no other name has: `anna-2` is `annaX2d2`.

    `X` and bytes that are no letters or digits of ASCII are written as `X` and two hexadecimal digits, so
    that recordings of several days join a dataset without a list of its people.
    """
    plain = frozenset(b"0123456789abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWYZ")
    return "".join(chr(byte) if byte in plain else f"X{byte:02x}" for byte in name.encode())


class _RecordedMotion:
    """Tables of a recording."""

    def __init__(self) -> None:
        self._tables: dict[tuple[str, str], BidsTable] = {}
        """By person, or `""` for trackers of objects, and label of the tracking system."""
        self._act_results = ActResults()
        self._events: list[SelectionEvent] = []
        self.people: set[str] = set()
        self.left_out: Counter[str] = Counter()
        """Number of messages by topic of those that have no file."""

    def add(self, entry: Entry) -> None:
        message = entry.body
        name = entry.name
        match message:
            case ImuSample():
                self._add(name, "imu", message.stamp_ns, _imu_cells(message))
            case UserPose():
                cells = _cells("feet", "POS", message.position_m, "m")
                yaw_channel = BidsChannel("feet", "ORNT", "z", "rad", "room")
                cells.append((yaw_channel, message.yaw_rad))
                self._add(name, "pose", message.stamp_ns, cells)
            case Cursor():
                cells = _cells("cursor", "POS", message.point_m, "m")
                self._add(name, "cursor", message.stamp_ns, cells)
            case TrackedObjects():
                self._add_objects(name, message)
            case SelectionEvent() | ActOutcome():
                event = self._act_results.event_to_show(message)
                if event is not None:
                    self._events.append(event)
            case Message():
                self.left_out[entry.row.key] += 1
            case _:
                pass

    def _add(
        self, person: str, system: str, stamp_ns: int, cells: Sequence[tuple[BidsChannel, float]]
    ) -> None:
        if person:
            self.people.add(person)
        table = self._tables.setdefault((person, system), BidsTable())
        table.add(stamp_ns, cells)

    def _add_objects(self, tracker: str, message: TrackedObjects) -> None:
        cells: list[tuple[BidsChannel, float]] = []
        for tracked in message.objects:
            person = tracked.id if tracked.kind in PERSON_KINDS else ""
            if person:
                self.people.add(person)
            placement = "head" if person else MISSING
            point = _text_cell(tracked.id, "object")
            cells += _cells(point, "POS", tracked.position_m, "m", placement=placement, owner=person)
            if tracked.yaw_rad is not None:
                channel = BidsChannel(point, "ORNT", "z", "rad", "room", placement, person)
                cells.append((channel, tracked.yaw_rad))
        system = bids_label(tracker)
        if system in SYSTEMS:  # a tracker that is called as one of ours
            system = f"{system}objects"
        self._add("", system, message.stamp_ns, cells)

    def write(self, person: str, prefix: str, task: str, staging: Path, folder: Path) -> dict[Path, int]:
        """Write the files of one person for the dataset in `folder`, and return their rows.

        `prefix`: beginning of their names.
        """
        place = staging / motion_folder(prefix)
        place.mkdir(parents=True)

        # All files of a session count from the first stamp of any.
        stamps_ns = [event.stamp_ns for event in self._events]
        for table in self._tables.values():
            stamps_ns += min(table.stamps_ns), max(table.stamps_ns)
        onset_ns = min(stamps_ns)
        duration_s = (max(stamps_ns) - onset_ns) / NS_PER_S

        # A tracking system is a table with its channels.
        rows: dict[Path, int] = {}
        for (owner, system), table in self._tables.items():
            channels = table.channels(person)
            if owner not in ("", person) or not channels:
                continue
            stem = f"{prefix}_tracksys-{system}"
            path = place / f"{stem}_motion.tsv"
            _write_lines(path, table.rows(person, onset_ns))
            rows[path.relative_to(staging)] = len(table.stamps_ns)
            _write_json(place / f"{stem}_motion.json", motion_json(system, task, channels, table, duration_s))
            _write_lines(place / f"{stem}_channels.tsv", channel_lines(channels))
            _write_json(place / f"{stem}_channels.json", channels_json(channels))
        events = [event for event in self._events if event.user == person]
        if events:
            _write_lines(place / f"{prefix}_events.tsv", _event_lines(events, onset_ns))
            _write_json(place / f"{prefix}_events.json", _EVENT_COLUMNS)

        subject_and_session = prefix.partition("_task-")[0]
        scans = place.parent.relative_to(staging) / f"{subject_and_session}_scans.tsv"
        names = [f"motion/{path.name}" for path in rows]
        lines = _scan_lines(folder / scans, f"motion/{prefix}_", names, onset_ns)
        _write_lines(staging / scans, lines)
        return rows


def _scan_lines(path: Path, outdated: str, names: Iterable[str], onset_ns: int) -> list[str]:
    """Return the lines of a table of files with their times of acquisition.

    Args:
        path: the table of an earlier export, whose further columns and lines stay.
        outdated: beginning of the names of files whose lines go.
        names: files to add.
        onset_ns: when these were acquired, Unix ns.
    """
    lines = _table(path, "filename\tacq_time")
    header, *others = [line for name, line in lines.items() if not name.startswith(outdated)]
    acquired = datetime.fromtimestamp(onset_ns / NS_PER_S, UTC).strftime("%Y-%m-%dT%H:%M:%S.%fZ")
    columns = header.split("\t")
    new_lines: list[str] = []
    for name in names:
        cells = {"filename": name, "acq_time": acquired}
        row = [cells.get(column, MISSING) for column in columns]
        new_lines.append("\t".join(row))
    return [header, *others, *new_lines]


def _imu_cells(sample: ImuSample) -> list[tuple[BidsChannel, float]]:
    cells: list[tuple[BidsChannel, float]] = []
    for component, value in zip(QUATERNION, sample.orientation_xyzw, strict=True):
        channel = BidsChannel("arm", "ORNT", component, MISSING, "person", "forearm")
        cells.append((channel, value))
    cells += _cells("arm", "GYRO", sample.angular_velocity_radps, "rad/s", "arm", placement="forearm")
    return cells + _cells("arm", "ACCEL", sample.acceleration_mps2, "m/s^2", "arm", placement="forearm")


def _cells(
    point: str,
    kind: str,
    values: Sequence[float] | None,
    unit: str,
    frame: str = "room",
    *,
    placement: str = MISSING,
    owner: str = "",
) -> list[tuple[BidsChannel, float]]:
    cells: list[tuple[BidsChannel, float]] = []
    for component, value in zip(AXES, values or (), strict=False):
        channel = BidsChannel(point, kind, component, unit, frame, placement, owner)
        cells.append((channel, value))
    return cells


def _event_lines(events: Sequence[SelectionEvent], onset_ns: int) -> Iterator[str]:
    yield "\t".join(("onset", "duration", *_EVENT_COLUMNS))
    for event in sorted(events, key=lambda event: event.stamp_ns):
        onset = f"{(event.stamp_ns - onset_ns) / NS_PER_S:.6f}"
        texts = (event.event, event.object_id, event.kind, event.cause)
        yield "\t".join((onset, MISSING, *map(_text_cell, texts)))


def _text_cell(text: str, default: str = MISSING) -> str:
    """Return `text` on one line, so that no spreadsheet takes it for a formula."""
    return neutralize_formula(" ".join(text.split())) or default


def _table(path: Path, new_header: str) -> dict[str, str]:
    """Return the lines of a table by their first cells, its header first; `new_header` if it is not there.

    Raises:
        ConfigError: If it is no such table in UTF-8.
    """
    first = new_header.partition("\t")[0]
    if not path.exists():
        return {first: new_header}
    try:
        lines = path.read_text(encoding="utf-8-sig").splitlines()
    except UnicodeDecodeError as error:
        raise ConfigError(f"{path}: is not UTF-8 text; save it as tab-separated text in UTF-8") from error
    header = lines[0] if lines else ""
    if header.partition("\t")[0] != first:
        raise ConfigError(
            f"{path}: begins with {format_value(header[:40])}; save it as tab-separated text in UTF-8 whose "
            f"first column is {first}"
        )
    return {line.partition("\t")[0]: line for line in lines}


def _write_dataset(staging: Path, folder: Path, subjects: Collection[str]) -> None:
    """Write the files about the whole dataset; those of an earlier export stay."""
    participants = _table(folder / _PARTICIPANTS, "participant_id")
    header = next(iter(participants.values()))
    filler = f"\t{MISSING}" * header.count("\t")
    for subject in subjects:
        participants.setdefault(subject, f"{subject}{filler}")
    _write_lines(staging / _PARTICIPANTS, participants.values())
    if not (folder / _DESCRIPTION).exists():
        generator = {"Name": "PointIt", "Version": pointit_version() or MISSING}
        description = {"Name": folder.resolve().name, "BIDSVersion": BIDS_VERSION, "DatasetType": "raw"}
        _write_json(staging / _DESCRIPTION, {**description, "GeneratedBy": [generator]})
        _write_lines(staging / "README.md", [_README])


def _write_lines(path: Path, lines: Iterable[str]) -> None:
    with path.open("w", encoding="utf-8", newline="\n") as file:
        file.writelines(f"{line}\n" for line in lines)


def _write_json(path: Path, content: object) -> None:
    _write_lines(path, [json.dumps(content, indent=2, ensure_ascii=False)])
