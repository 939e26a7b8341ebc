"""Keys are names as they are written, text fields get a value's text, and all readers agree on our YAML."""

import logging
import math
from pathlib import Path
from typing import Any, Literal

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st
from pydantic import Field

from pointit.runtime.config.config import Config, Layers, validate
from pointit.runtime.config.yaml_edit import dump_yaml, quoted
from pointit.runtime.config.yaml_file import load_yaml, parse_yaml, read_yaml
from pointit.runtime.errors import ConfigError

NASTY = (
    "01", "010", "007", "1", "1_0", "12:30", "2e1", "1.10", "1.0", "on", "Off", "no", "YES", "y", "null", "~",
    "true", "False", "2026-11-26", "2024-99-99", "0x1F", "0o17", "0b1", "=", "<<", ".inf", "-.5", "+1", "0",
    "08", "1:30.5", "1_000.5", ".nan", "1e3", "", "a b", "NULL", "None", "-", "?", "a: b", "a #b", "é", "😀",
)  # fmt: skip
WORDS = (
    st.sampled_from(NASTY) | st.text("0123456789.:_eExob+-~<=nyastrufl ", max_size=6) | st.text(max_size=4)
)
"""Names and texts that some reader takes for something else."""


class Part(Config):
    """A part with an id."""

    id: str = ""
    other: str | None = None


class Lamps(Config):
    """Fields of text in all forms, beside numbers."""

    name: str = ""
    users: tuple[str, ...] = ()
    groups: dict[str, tuple[str, ...]] = Field(default={})
    light: str | Part = ""
    people: int | tuple[str, ...] = 1
    count: int = 0
    length_m: float = 0.0
    is_on: bool = False
    mode: Literal["", "2", "True"] = ""
    path: Path = Path()


def lamps(text: str) -> Lamps:
    return validate(Lamps, parse_yaml(text.encode(), "lamps.yaml"))


@pytest.mark.parametrize(
    "name", [name for name in NASTY if name and name.isascii() and not set(name) & set(" ?")]
)
def test_key_is_its_literal_text_in_blocks_and_flow(name: str) -> None:
    assert parse_yaml(f"{name}:\n  {name}: {{{name}: 1}}\n".encode(), "x") == {name: {name: {name: 1}}}


def test_keys_that_differ_only_as_text_are_all_there() -> None:
    text = "1: a\n01: b\n001: c\n1.0: d\non: e\nyes: f\ntrue: g\n~: h\nnull: i\n12:30: j\n750: k\n"
    names = ["1", "01", "001", "1.0", "on", "yes", "true", "~", "null", "12:30", "750"]
    assert list(parse_yaml(text.encode(), "x")) == names


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        (
            "a: 1\nlamps:\n  07: 1\n  b: 2\n  07: 3\n",
            "line 5: the key '07' occurs twice, first in line 3; keep one",
        ),
        ("{on: 1, 'on': 2}", "line 1: the key 'on' occurs twice, first in line 1; keep one"),
        ('~: 1\nb: 2\n"~": 3\n', "line 3: the key '~' occurs twice, first in line 1; keep one"),
    ],
)
def test_duplicate_key_is_an_error_with_both_lines(text: str, sentence: str) -> None:
    with pytest.raises(ConfigError) as caught:
        parse_yaml(text.encode(), "x.yaml")
    assert str(caught.value) == f"x.yaml: {sentence}"


def test_merge_key_merges_aliases_only_and_is_otherwise_a_name() -> None:
    text = "base: &base {a: 1}\nlist: {<<: [*base], b: 2}\nnames: {<<: {c: 3}, '=': 4}\n"
    assert parse_yaml(text.encode(), "x") == {
        "base": {"a": 1},
        "list": {"a": 1, "b": 2},
        "names": {"<<": {"c": 3}, "=": 4},
    }


def test_key_that_is_an_anchor_leaves_the_anchored_value() -> None:
    assert parse_yaml(b"a: &x 8\nb: {*x : 1}\n", "x") == {"a": 8, "b": {"8": 1}}


NULLS = ("null", "~")
PLAIN = [w for w in NASTY if w and w.isascii() and not set(w) & set(" ?-,:") and w.lower() not in NULLS]


@pytest.mark.parametrize("word", [*PLAIN, "12:30"])
def test_a_field_of_text_gets_the_literal_text(word: str) -> None:
    made = lamps(
        f"name: {word}\nusers: [a, {word}]\ngroups: {{{word}: [{word}]}}\n"
        f"light: {{id: {word}, other: {word}}}\npeople: [{word}]\n"
    )
    assert made.name == made.users[1] == made.people[0] == word  # pyrefly: ignore[bad-index]
    assert made.groups == {word: (word,)}
    assert made.light == Part(id=word, other=word)
    assert lamps(f"light: {word}").light == word


def test_null_in_a_field_of_text_is_refused() -> None:
    assert lamps("light: {id: a, other: null}").light == Part(id="a")
    layers = Layers()
    layers.add(parse_yaml(b"users: [a, ~]", "x"), "x.yaml")
    with pytest.raises(ConfigError, match=r"x.yaml: users.1: write text.*None"):
        layers.build(Lamps)


def test_mistake_is_named_beside_a_name_like_a_number() -> None:
    layers = Layers()
    layers.add(parse_yaml(b"name: 010\ncount: many\n", "x"), "x.yaml")
    with pytest.raises(ConfigError, match=r"^x.yaml: count: write a whole number \(got 'many'\)$"):
        layers.build(Lamps)


@pytest.mark.parametrize(
    ("field", "word", "value"),
    [
        ("count", "060", 60),
        ("count", "08", 8),
        ("count", "1_000", 1000),
        ("count", "0x1F", 31),
        ("count", "0o17", 15),
        ("count", "-0b11", -3),
        ("count", "+12", 12),
        ("length_m", "1e-3", 0.001),
        ("length_m", "2E1", 20.0),
        ("length_m", ".5", 0.5),
        ("length_m", "-1_0.5", -10.5),
        ("length_m", "01.50", 1.5),
        ("is_on", "on", True),
        ("is_on", "No", False),
        ("is_on", "TRUE", True),
        ("is_on", "False", False),
        ("is_on", "Y", True),
        ("is_on", "n", False),
        ("count", "2e1", 20),
        ("mode", "2", "2"),
        ("mode", "True", "True"),
        ("path", "010", Path("010")),
    ],
)
def test_non_text_field_has_one_value_in_files_and_options(field: str, word: str, value: object) -> None:
    assert getattr(lamps(f"{field}: {word}"), field) == value
    layers = Layers()
    layers.add_text((field,), word, f"--set x.{field}={word}")
    assert getattr(layers.build(Lamps), field) == value
    layers.add_environment({f"POINTIT_X__{field.upper()}": word}, "POINTIT_X__")
    assert getattr(layers.build(Lamps), field) == value


@pytest.mark.parametrize(
    ("word", "remedy"),
    [
        ("060", 'write 60, or "060"'),
        ("09", 'write 9, or "09"'),
        ("1_000", 'write 1000, or "1_000"'),
        ("0o17", 'write 15, or "0o17"'),
        ("0b11", 'write 3, or "0b11"'),
        ("1_0.50", 'write 10.5, or "1_0.50"'),
        ("on", 'write true, or "on"'),
        ("No", 'write false, or "No"'),
        ("1:30", 'write "1:30"'),
        ("2026-11-26", 'write "2026-11-26"'),
    ],
)
def test_a_value_on_which_readers_disagree_is_reported_once(
    word: str, remedy: str, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    file = tmp_path / "x.yaml"
    file.write_text(f"lamps:\n  {word}: {{a: {word}, b: [{word}]}}\nc: [1, {word}]\n")
    for _ in range(2):
        read_yaml(file)
    (record,) = caplog.records
    assert record.levelno == logging.WARNING
    assert record.getMessage().startswith(f"{file}: line 2: readers of YAML disagree about {word}")
    assert remedy in record.getMessage()
    assert record.getMessage().endswith("; line 3, too")


@pytest.mark.parametrize(
    "word",
    ["60", "-1.5", "1e-3", "007", "0", "0x1F", "'060'", '"on"', "true", "True", "FALSE", "y", "~", ".inf"],
)
def test_a_value_on_which_readers_agree_is_not_reported(word: str, caplog: pytest.LogCaptureFixture) -> None:
    parse_yaml(f"a: {word}\non: 1\n060: 2\n".encode(), f"{word}.yaml")
    assert not caplog.records


@pytest.mark.parametrize("word", ["on", "010", "1_0", "2026-11-26"])
def test_a_word_of_set_is_text_and_not_reported(word: str, caplog: pytest.LogCaptureFixture) -> None:
    layers = Layers()
    layers.add_text(("name",), word, f"--set x.name={word}")
    layers.add_environment({"POINTIT_X__LIGHT": word}, "POINTIT_X__")
    assert (layers.build(Lamps).name, layers.build(Lamps).light) == (word, word)
    assert not caplog.records


@given(WORDS)
def test_quoted_text_is_the_same_for_all_yaml_versions(text: str) -> None:
    ruamel = pytest.importorskip("ruamel.yaml")
    written = f"{{{quoted(text)}: [{quoted(text)}]}}"
    assert "\n" not in written
    assert load_yaml(written, "x") == yaml.safe_load(written) == {text: [text]}
    assert ruamel.YAML(typ="safe", pure=True).load(written) == {text: [text]}


@given(
    st.recursive(
        WORDS | st.integers() | st.floats(allow_nan=False) | st.booleans() | st.none(),
        lambda inner: st.lists(inner, max_size=3) | st.dictionaries(WORDS, inner, max_size=3),
    )
)
def test_dumped_value_is_read_again(value: Any) -> None:
    text = dump_yaml({"x": value})
    again = load_yaml(text, "x")
    assert again == {"x": value}
    assert dump_yaml(again) == text, "true is not 1"


def test_numbers_keep_their_text_when_a_file_is_written_again() -> None:
    text = "a: 010\nb: [1.10, 2e1, 0x1F, 1_0]\nc: 'on'\n'01': -.5\n"
    again = parse_yaml(dump_yaml(parse_yaml(text.encode(), "x")).encode(), "y")
    made = lamps(f"users: {again['b']}\nname: {again['a']}")
    assert made.users == ("1.10", "2e1", "0x1F", "1_0")
    assert made.name == "010"
    assert math.isclose(again["01"], -0.5)
