"""Files of views."""

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pointit.runtime.errors import ConfigError
from pointit.scan.views import Survey, parse_survey, read_survey, to_json
from tests.unit.scan.photographs import LAMPS, photographs, specs


def test_a_survey_is_the_same_after_json() -> None:
    survey = Survey(tuple(specs()), tuple(LAMPS), tuple(photographs(2)))
    assert parse_survey(to_json(survey)) == survey


def test_a_survey_that_an_editor_gave_a_byte_order_mark_is_read(tmp_path: Path) -> None:
    survey = Survey(tuple(specs()), tuple(LAMPS), tuple(photographs(2)))
    path = tmp_path / "views.json"
    path.write_bytes(b"\xef\xbb\xbf" + to_json(survey))
    assert read_survey(path) == survey


@pytest.mark.parametrize(
    ("data", "says"),
    [
        ("x", "JSON"),
        ('{"views": [{"width": 1280}]}', "height"),
        ('{"strips": [{"name": "a", "count": 1}]}', "1 pixels"),
        ('{"strips": [{"name": "a", "count": 9}, {"name": "a", "count": 9}]}', "same name"),
        ('{"strips": [{"name": "a", "count": 9, "pitch_m": 60}]}', "pitch"),
        ('{"strips": [{"name": "../a", "count": 9}]}', "use 1 to 64 letters"),
        ('{"lamps": [{"name": "a\\nb"}]}', "use 1 to 64 letters"),
        ('{"views": [{"width": 0, "height": 0, "sightings": []}]}', "image"),
        ('{"known_lenght": {}}', "known_lenght"),
        ('{"strips": [{"name": "a", "count": 9, "pitch": 0.01}]}', "pitch"),
        ('{"lamps": [{"name": "a", "colour": 1}]}', "colour"),
        ('{"views":[{"width":9,"height":9,"sightings":[{"name":"b","pixel":0,"u":1,"v":1,"w":1}]}]}', "w: "),
        ('{"views": [{"width": 64, "height": 64, "sightings": [], "gravity": [0, 9.8, 0]}]}', "gravity"),
        ('{"views":[{"width":99,"height":99,"sightings":[{"name":"b","pixel":0,"u":1,"v":1}]}]}', "'b'"),
    ],
)
def test_a_wrong_survey_is_an_error_that_names_it(data: str, says: str) -> None:
    with pytest.raises(ConfigError, match=says):
        parse_survey(data)


@given(st.binary(max_size=80))
def test_any_bytes_are_a_survey_or_an_error_of_one_sentence(data: bytes) -> None:
    try:
        survey = parse_survey(data)
    except ConfigError as error:
        assert "\n" not in str(error)  # noqa: PT017 - both outcomes are right
    else:
        assert isinstance(survey, Survey)


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"none\.json"):
        read_survey(tmp_path / "none.json")
