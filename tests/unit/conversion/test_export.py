"""A recording as CSV tables: messages, pointing acts and selections."""

import csv
import signal
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner
from mcap.reader import make_reader
from mcap.writer import Writer

import pointit.schemas as models
from pointit.cli.main import command
from pointit.conversion.acts import ActDetector, PointingAct, SelectionCsvRow
from pointit.conversion.export_csv import FILES, columns_of, export_csv
from pointit.recording import container
from pointit.recording.entries import Entry, Exchange
from pointit.recording.reader import Recording
from pointit.runtime.errors import ConfigError
from pointit.schemas import ActOutcome, Cursor, Hover, SelectionEvent, TrackedObject, TrackedObjects, topics
from tests.unit.conversion.session import BEGAN_NS, at, said, write

LEVEL = (0.0, 0.0, 0.0, 1.0)


def table(path: Path) -> list[dict[str, str]]:
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def session() -> list[Entry]:
    boxes = tuple(
        models.TrackedObject(id=name, kind="red", position_m=(1.0, 2.0, 0.5)) for name in ("a", "b")
    )
    chosen = models.SelectionEvent(
        stamp_ns=at(1.5), event="selected", object_id="a", user="anna", cause="dwell"
    )
    speed = Exchange[models.SetSpeed, models.Done](
        stamp_ns=at(2.0), query=models.SetSpeed(speed_mps=0.5), reply=models.Done(message="it runs")
    )
    return [
        said(0.0, topics.USER_ALIVE, "anna", True),
        said(0.5, topics.IMU, "anna", models.ImuSample(stamp_ns=at(0.4), seq=3, orientation_xyzw=LEVEL)),
        said(1.0, topics.OBJECTS, "conveyor", models.TrackedObjects(stamp_ns=at(1.0), objects=boxes)),
        *(
            said(each, topics.HOVER, "anna", models.Hover(stamp_ns=at(each), object_id="a"))
            for each in (1.0, 1.25, 1.5)
        ),
        said(1.5, topics.SELECTION_EVENTS, "", chosen),
        said(1.6, topics.STRIPS_FRAME, "", models.StripsFrame(stamp_ns=at(1.6), strips=(), light_s=0.0)),
        said(2.0, topics.SET_SPEED, "", speed),
    ]


def test_every_message_is_a_row_with_units_in_the_columns(tmp_path: Path) -> None:
    exported = export_csv(session(), BEGAN_NS, tmp_path)
    (sample,) = table(tmp_path / "imu.csv")
    assert sample["time_s"] == "0.4"
    assert (sample["stamp_ns"], sample["user"], sample["seq"]) == (str(at(0.4)), "anna", "3")
    assert (sample["orientation_x"], sample["orientation_w"]) == ("0.0", "1.0")
    assert sample["angular_velocity_x_radps"] == ""
    assert [(row["id"], row["tracker"], row["position_y_m"]) for row in table(tmp_path / "objects.csv")] == [
        ("a", "conveyor", "2.0"),
        ("b", "conveyor", "2.0"),
    ]
    assert exported.rows["objects.csv"] == 2
    assert exported.left_out == {"strips/frame": 1}


def test_selections_acts_and_requests_are_tables(tmp_path: Path) -> None:
    export_csv(session(), BEGAN_NS, tmp_path)
    (selection,) = table(tmp_path / "selections.csv")
    assert (selection["user"], selection["object_id"], selection["pointed_s"]) == ("anna", "a", "0.5")
    (act,) = table(tmp_path / "acts.csv")
    assert (act["object_kind"], act["outcome"], act["duration_s"]) == ("red", "selected", "0.5")
    (request,) = table(tmp_path / "requests.csv")
    assert (request["request"], request["time_s"]) == ("conveyor/set_speed", "2.0")
    assert '"speed_mps":0.5' in request["query"]
    assert "it runs" in request["reply"]


def test_the_dictionary_describes_every_column(tmp_path: Path) -> None:
    export_csv(session(), BEGAN_NS, tmp_path)
    described = [(row["file"], row["column"]) for row in table(tmp_path / "columns.csv")]
    found = [
        (path.name, column)
        for path in tmp_path.glob("*.csv")
        if path.name != "columns.csv"
        for column in path.read_text().splitlines()[0].split(",")
    ]
    assert sorted(described) == sorted(found)
    units = {(row["file"], row["column"]): row["unit"] for row in table(tmp_path / "columns.csv")}
    assert units["objects.csv", "velocity_x_mps"] == "m/s"
    assert units["imu.csv", "orientation_x"] == ""


def test_columns_name_the_turn_of_cues_and_never_say_none(tmp_path: Path) -> None:
    columns = {column.name: column for column in columns_of(models.Feedback)}
    cue = models.Feedback(stamp_ns=1, cue="target", turn_rad=(0.25, -0.5))
    assert (columns["turn_right_rad"].get(cue), columns["turn_up_rad"].get(cue)) == (0.25, -0.5)
    assert "turn_0_rad" not in columns
    export_csv(session(), BEGAN_NS, tmp_path)
    assert "None" not in (tmp_path / "columns.csv").read_text()


def test_columns_of_a_table_have_different_names() -> None:
    for topic in topics.TOPICS:
        names = [column.name for column in columns_of(topic.message)]
        assert len(names) == len(set(names)), topic.key
    assert set(FILES) <= {topic.key for topic in topics.TOPICS}


def test_a_covariance_has_a_named_column_for_each_entry(tmp_path: Path) -> None:
    pose = models.UserPose(
        stamp_ns=at(0.0),
        position_m=(1.0, 2.0, 0.0),
        yaw_rad=0.5,
        covariance=(1.0, 2.0, 3.0, 2.0, 5.0, 6.0, 3.0, 6.0, 9.0),
    )
    export_csv([said(0.0, topics.POSE, "anna", pose)], BEGAN_NS, tmp_path)
    (row,) = table(tmp_path / "poses.csv")
    assert (row["covariance_x_yaw_m_rad"], row["covariance_y_y_m2"], row["covariance_yaw_yaw_rad2"]) == (
        "3.0",
        "5.0",
        "9.0",
    )


def test_a_list_is_one_cell_of_json(tmp_path: Path) -> None:
    message = models.Localization(stamp_ns=at(0.0), phase="sampling", ahead=("ben", "carl"))
    export_csv([said(0.0, topics.LOCALIZATION, "anna", message)], BEGAN_NS, tmp_path)
    (row,) = table(tmp_path / "localizations.csv")
    assert row["ahead"] == '["ben","carl"]'


def test_no_recorded_text_is_a_spreadsheet_formula(tmp_path: Path) -> None:
    bad = models.SelectionEvent(stamp_ns=at(0.0), event="refused", object_id='=HYPERLINK("x")', kind="@kind")
    export_csv([said(0.0, topics.SELECTION_EVENTS, "", bad)], BEGAN_NS, tmp_path)
    (row,) = table(tmp_path / "events.csv")
    assert (row["object_id"], row["kind"]) == ('\'=HYPERLINK("x")', "'@kind")


def test_tables_are_replaced_only_on_request_and_then_completely(tmp_path: Path) -> None:
    (tmp_path / "own.csv").write_text("mine")
    export_csv(session(), BEGAN_NS, tmp_path)
    with pytest.raises(ConfigError, match=r"has acts\.csv and 7 more; give another folder, or --overwrite"):
        export_csv(session()[:2], BEGAN_NS, tmp_path)
    assert (tmp_path / "objects.csv").exists()
    export_csv(session()[:2], BEGAN_NS, tmp_path, overwrite=True)
    assert {path.name for path in tmp_path.iterdir()} == {
        *("own.csv", "columns.csv", "selections.csv", "acts.csv", "imu.csv")
    }


def test_nothing_remains_of_an_export_onto_a_full_disk(tmp_path: Path) -> None:
    (tmp_path / "imu.csv.part").symlink_to("/dev/full")
    with pytest.raises(ConfigError, match=r"cannot be written \(no space left on device\)"):
        export_csv(session(), BEGAN_NS, tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_nothing_stays_of_an_interrupted_export(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted(_: Recording) -> Iterator[Entry]:
        yield session()[1]
        signal.raise_signal(signal.SIGTERM)
        yield session()[2]

    path = write(tmp_path / "session.mcap", session())
    monkeypatch.setattr(Recording, "entries", interrupted)
    before = signal.signal(signal.SIGTERM, signal.SIG_IGN)  # the command has to listen by itself
    try:
        result = CliRunner().invoke(command, ["export", str(path), "--to", str(tmp_path / "tables")])
    finally:
        signal.signal(signal.SIGTERM, before)
    assert result.exit_code != 0
    assert list((tmp_path / "tables").iterdir()) == []


def test_an_export_that_lacks_messages_of_a_damaged_file_fails(tmp_path: Path) -> None:
    path = write(tmp_path / "session.mcap", session())
    data = path.read_bytes()
    with path.open("rb") as file:
        first, *_, last = (place for place in container.records(file) if place.opcode == 6)
    place = first.offset + 200
    path.write_bytes(data[:place] + bytes([data[place] ^ 0xFF]) + data[place + 1 : last.offset + last.length])
    arguments = ["export", str(path), "--to", str(tmp_path / "tables")]
    result = CliRunner().invoke(command, arguments, standalone_mode=False)
    assert result.return_value == 1, result.output
    assert "messages that have lost their description: 1" in result.stderr


@pytest.mark.parametrize("name", ["/of_a_newer_pointit", "/users/user1/imu"])
def test_export_fails_when_a_channel_is_unknown(tmp_path: Path, name: str) -> None:
    path = tmp_path / "session.mcap"
    with write(path, session()).open("rb") as source:
        metadata = list(make_reader(source).iter_metadata())
    with path.open("wb") as target:
        writer = Writer(target)
        writer.start()
        for record in metadata:
            writer.add_metadata(record.name, dict(record.metadata))
        channel = writer.register_channel(name, "json", 0)
        writer.add_message(channel, BEGAN_NS, b"{}", BEGAN_NS)
        writer.finish()

    arguments = ["export", str(path), "--to", str(tmp_path / "tables")]
    result = CliRunner().invoke(command, arguments, standalone_mode=False)

    assert result.return_value == 1, result.output
    assert f"1 messages are left out (1 of {name})" in result.stderr


def test_command_exports_a_recording_and_names_what_has_no_table(tmp_path: Path) -> None:
    path = write(tmp_path / "session.mcap", session())
    result = CliRunner().invoke(command, ["export", str(path), "--to", str(tmp_path / "tables")])
    assert result.exit_code == 0, result.output
    assert f"{tmp_path / 'tables' / 'imu.csv'}: 1 rows" in result.stdout
    assert "Messages without a table: 1 of strips/frame." in result.stdout
    assert len(table(tmp_path / "tables" / "objects.csv")) == 2


def hover(found: ActDetector, begin_s: float, end_s: float, object_id: str, user: str = "anna") -> None:
    for tick in range(round(begin_s * 50), round(end_s * 50) + 1):
        found.on_hover(user, Hover(stamp_ns=at(tick / 50), object_id=object_id, miss_rad=0.01, progress=0.5))


def happened(time_s: float, what: str, object_id: str, user: str = "anna", **more: Any) -> SelectionEvent:
    return SelectionEvent.model_validate(
        {"stamp_ns": at(time_s), "event": what, "object_id": object_id, "user": user, **more}
    )


Step = tuple[float, float, str] | SelectionEvent
"""Begin and end of hovers of an object, or an event."""
ACTS: dict[str, tuple[list[Step], list[tuple[str, float, float, str]]]] = {
    "an act lasts as long as the cursor is on the object": (
        [(1.0, 1.5, "a"), (1.52, 2.0, "b")], [("a", 1.0, 0.5, "none"), ("b", 1.52, 0.48, "none")]),
    "a short slip off the object does not end an act, a long one does": (
        [(1.0, 1.2, "a"), (1.22, 1.4, ""), (1.42, 2.0, "a"), (2.02, 2.5, ""), (2.52, 3.0, "a")],
        [("a", 1.0, 1.0, "none"), ("a", 2.52, 0.48, "none")]),
    "an act ends when hovers stop": (
        [(1.0, 1.2, "a"), (9.0, 9.2, "a")], [("a", 1.0, 0.2, "none"), ("a", 9.0, 0.2, "none")]),
    "an event just after the act is its outcome, one long after is not": (
        [(1.0, 1.5, "a"), (1.52, 1.9, "b"), happened(1.6, "refused", "a"), happened(5.0, "selected", "b")],
        [("a", 1.0, 0.5, "refused"), ("b", 1.52, 0.38, "none")]),
    "a second outcome on the same object is another act": (
        [(1.0, 1.5, "a"), happened(1.5, "selected", "a"), (1.52, 2.5, "a"), happened(2.5, "deselected", "a")],
        [("a", 1.0, 1.5, "selected"), ("a", 1.5, 1.0, "deselected")]),
    "what somebody else does is no outcome": (
        [(1.0, 1.5, "a"), happened(1.4, "selected", "a", user="ben")], [("a", 1.0, 0.5, "none")]),
}  # fmt: skip


@pytest.mark.parametrize("name", ACTS)
def test_acts_are_found(name: str) -> None:
    found = ActDetector(BEGAN_NS)
    steps, expected = ACTS[name]
    for step in steps:
        if isinstance(step, SelectionEvent):
            found.on_event(step)
        else:
            hover(found, *step)
    found.end()
    assert [(act.object_id, act.begin_s, act.duration_s, act.outcome) for act in found.acts] == expected


def test_people_point_at_the_same_time() -> None:
    found = ActDetector(BEGAN_NS)
    for user in ("anna", "ben"):
        hover(found, 1.0, 1.2, "a", user)
    found.end()
    assert {act.user for act in found.acts} == {"anna", "ben"}


def only_act(found: ActDetector) -> PointingAct:
    found.end()
    (act,) = found.acts
    return act


def only_selection(found: ActDetector) -> SelectionCsvRow:
    found.end()
    (row,) = found.selections
    return row


def test_an_act_has_its_outcome_kind_distance_and_surface() -> None:
    found = ActDetector(BEGAN_NS)
    box = TrackedObject(id="a", kind="red", position_m=(1.0, 0.0, 0.0))
    found.on_objects("conveyor", TrackedObjects(stamp_ns=at(0.0), objects=(box,)))
    for tick in range(3):
        cursor = Cursor(
            stamp_ns=at(1.0), surface="belt", surface_id="b1", point_m=(1.0, 0.0, 0.0), range_m=2.0 + tick
        )
        found.on_cursor("anna", cursor)
        found.on_hover("anna", Hover(stamp_ns=at(1.0 + tick / 10), object_id="a", miss_rad=0.3 - tick / 10))
    found.on_event(happened(1.25, "selected", "a", cause="dwell", confidence=0.9))

    act = only_act(found)
    assert (act.object_kind, act.surface, act.surface_id) == ("red", "belt", "b1")
    assert (act.outcome, act.outcome_after_s, act.cause, act.confidence) == ("selected", 0.25, "dwell", 0.9)
    assert act.range_m == 3.5  # the first cursor came before the act
    assert act.miss_rad is not None
    assert round(act.miss_rad, 9) == 0.1


def test_a_selection_has_the_pointing_before_it_and_its_end() -> None:
    found = ActDetector(BEGAN_NS)
    hover(found, 1.0, 1.5, "a")
    found.on_event(happened(1.5, "selected", "a", kind="red", cause="dwell"))
    found.on_event(happened(4.0, "deselected", "a", user="ben"))
    row = only_selection(found)
    assert (row.user, row.object_id, row.object_kind, row.cause) == ("anna", "a", "red", "dwell")
    assert (row.selected_s, row.pointed_s, row.kept_s) == (1.5, 0.5, 2.5)
    assert (row.ended_by, row.ended_s, row.ended_user) == ("deselected", 4.0, "ben")


@pytest.mark.parametrize("result", ["done", "failed"])
def test_act_and_its_selection_have_the_carriers_result(result: str) -> None:
    found = ActDetector(BEGAN_NS)
    hover(found, 1.0, 1.5, "a")
    found.on_event(happened(1.5, "selected", "a", carriers=("home",)))
    found.on_event(happened(2.1, "deselected", "a"))
    assert found.selections == [], "its result is not known"
    told = {"stamp_ns": at(3.0), "event_ns": at(1.5), "event": "selected", "object_id": "a", "result": result}
    found.on_outcome(ActOutcome.model_validate(told))
    found.end()
    assert found.acts[0].outcome == {"done": "selected", "failed": "refused"}[result]
    assert only_selection(found).ended_by == {"done": "deselected", "failed": "failed"}[result]


def test_deselection_after_a_failure_is_no_act_of_the_person() -> None:
    found = ActDetector(BEGAN_NS)
    hover(found, 1.0, 3.0, "a")
    found.on_event(happened(1.5, "selected", "a", carriers=("home",)))
    found.on_event(happened(2.1, "deselected", "a", reason="not done: no power"))
    assert only_act(found).duration_s == 2.0


def test_a_dispatched_object_has_its_bay() -> None:
    found = ActDetector(BEGAN_NS)
    found.on_event(happened(1.5, "selected", "a"))
    found.on_event(happened(4.0, "dispatched", "a", bay="2"))
    row = only_selection(found)
    assert (row.ended_by, row.bay, row.ended_user, row.pointed_s) == ("dispatched", "2", "", None)


def test_takeover_ends_one_selection_and_begins_another() -> None:
    found = ActDetector(BEGAN_NS)
    found.on_event(happened(1.0, "selected", "a"))
    found.on_event(happened(2.0, "selected", "a", user="ben"))
    found.end()
    assert [(row.user, row.ended_by, row.ended_user) for row in found.selections] == [
        ("anna", "deselected", "ben"),
        ("ben", "recording", ""),
    ]


def test_end_of_an_unselected_object_is_no_selection() -> None:
    found = ActDetector(BEGAN_NS)
    found.on_event(happened(1.0, "left", "a"))
    found.on_event(happened(1.0, "refused", "a"))
    found.end()
    assert found.selections == []
