"""Configuration: precedence of sources, and messages about mistakes."""

import contextlib
from pathlib import Path
from typing import Annotated, Literal

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import AfterValidator, Field

from pointit.runtime.config.config import Config, Layers
from pointit.runtime.config.environment_variables import check_environment, environment_prefix
from pointit.runtime.config.parameters import iter_parameters
from pointit.runtime.config.yaml_file import read_yaml
from pointit.runtime.errors import ConfigError
from pointit.runtime.service.process import load_config
from pointit.services.registry import PROCESSES
from pointit.services.selector.service import Selector


def refuse(_value: object) -> object:
    raise ValueError("name a span in m")


class Arm(Config):
    length_m: float = Field(default=0.7, gt=0, description="shoulder to finger, m")
    side: Literal["left", "right"] = Field(default="right", description="which arm")


class Limits(Config):
    rate_hz: float | None = Field(default=None, description="highest rate, Hz; as it comes if empty")


class Part(Config):
    name: str
    size: int = 1


class Sample(Config):
    """The configuration under test."""

    count: int = Field(default=3, ge=0, description="how many")
    label: str = Field(default="none yet", description="what to call it")
    is_on: bool = Field(default=False, description="whether it runs")
    offsets_m: tuple[float, ...] = Field(default=(0.0, 1.0), description="places, m")
    weights: dict[str, float] = Field(default={"a": 1.0}, description="share of each")
    arm: Arm = Arm()
    limits: Limits = Limits()


class Large(Sample):
    corner_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    parts: tuple[Part, ...] = ()
    by_name: dict[str, Part] = Field(default={}, description="others")
    spare: Part | None = None
    span: Annotated[object, AfterValidator(refuse)] = None


class Needy(Config):
    path: Path = Field(description="where it is")


def test_later_sources_win_field_by_field() -> None:
    layers = Layers()
    assert layers.build(Sample) == Sample()
    layers.add({"count": 4, "arm": {"length_m": 0.5, "side": "left"}, "weights": {"b": 2.0}}, "first.yaml")
    layers.add({"arm": {"length_m": 0.6}}, "second.yaml")
    layers.add_environment(
        {"POINTIT_X__ARM__LENGTH_M": "0.8", "POINTIT_X__LABEL": "env", "POINTIT_Y__COUNT": "9", "HOME": "/"},
        "POINTIT_X__",
    )
    layers.add_text(("label",), "option", "--label")
    config = layers.build(Sample)
    assert config.count == 4
    assert config.arm == Arm(length_m=0.8, side="left")
    assert config.label == "option"
    assert config.weights == {"b": 2.0}


@pytest.mark.parametrize(
    ("values", "sentence"),
    [
        ({"count": -1}, "file.yaml: count: must be at least 0 (got -1)"),
        ({"count": "many"}, "file.yaml: count: write a whole number (got 'many')"),
        ({"is_on": "maybe"}, "file.yaml: is_on: write true or false (got 'maybe')"),
        ({"arm": {"length_m": 0}}, "file.yaml: arm.length_m: must be above 0 (got 0)"),
        ({"arm": {"side": "up"}}, "file.yaml: arm.side: use one of 'left' or 'right' (got 'up')"),
        ({"arm": {"sde": "left"}}, "file.yaml: arm: no parameter sde; did you mean side?"),
        ({"arm": 3}, "file.yaml: arm: write a mapping with length_m, side (got 3)"),
        ({"offsets_m": 3}, "file.yaml: offsets_m: write a list such as [a, b] (got 3)"),
        ({"offsets_m": [1, float("nan")]}, "file.yaml: offsets_m.1: must be a finite number (got nan)"),
        ({"corner_m": [1, 2]}, "file.yaml: corner_m.2: is missing in [1, 2]; write as many"),
        ({"parts": [{"name": "a"}, {"nme": "b"}]}, "file.yaml: parts.1.name: is missing; give it a value"),
        ({"by_name": {"a": {"name": "x", "szie": 1}}}, "by_name.a: no parameter szie; did you mean size?"),
        ({"span": "wide"}, "file.yaml: span: name a span in m (got 'wide')"),
        ({"count": -1, "label": [3], "x": 1}, "(got -1) (and 2 more mistakes)"),
    ],
)
def test_a_mistake_in_a_file_names_file_field_and_value(values: dict[str, object], sentence: str) -> None:
    layers = Layers()
    layers.add(values, "file.yaml")
    with pytest.raises(ConfigError) as caught:
        layers.build(Large)
    assert sentence in str(caught.value)
    assert "\n" not in str(caught.value)


def test_an_error_names_the_source_that_took_precedence() -> None:
    layers = Layers()
    layers.add({"arm": {"length_m": "long", "side": "left"}}, "file.yaml")
    layers.add_environment({"POINTIT_X__ARM__LENGTH_M": "longer"}, "POINTIT_X__")
    with pytest.raises(ConfigError, match=r"^variable POINTIT_X__ARM__LENGTH_M: arm.length_m: .*'longer'"):
        layers.build(Sample)

    layers.add_text(("arm", "length_m"), "-1", "--arm.length-m")
    with pytest.raises(ConfigError, match=r"^--arm.length-m: arm.length_m: .*got -1"):
        layers.build(Sample)

    layers.add_text(("arm", "length_m"), "1", "--arm.length-m")
    assert layers.build(Sample).arm == Arm(length_m=1, side="left")
    layers.add_environment({"POINTIT_X__COUNTT": "3"}, "POINTIT_X__")
    with pytest.raises(ConfigError, match=r"variable POINTIT_X__COUNTT: no parameter countt; did you mean c"):
        layers.build(Sample)
    with pytest.raises(ConfigError, match="path: is missing"):
        Layers().build(Needy)


@pytest.mark.parametrize(
    ("field", "text", "value"),
    [
        ("label", "'7'", "7"),
        ("label", "wall #3", "wall #3"),
        ("offsets_m", "[1, 2.5]", (1.0, 2.5)),
        ("weights", "{x: 1}", {"x": 1.0}),
    ],
)
def test_text_is_read_as_the_field_wants_it(field: str, text: str, value: object) -> None:
    layers = Layers()
    layers.add_text((field,), text, "--" + field)
    assert getattr(layers.build(Sample), field) == value


@pytest.mark.parametrize("text", ["[1, 2", "{a: ", "a: b: c", "'x", "\x00", "{w},{x},{y},{z}"])
def test_text_that_is_no_value(text: str) -> None:
    with pytest.raises(ConfigError, match=r"^--offsets-m: is not a value .* in double quotes, such as"):
        Layers().add_text(("offsets_m",), text, "--offsets-m")


@given(st.text())
def test_any_text_is_a_value_or_a_config_error(text: str) -> None:
    layers = Layers()
    with contextlib.suppress(ConfigError):  # anything else is a traceback for a person
        layers.add_text(("label",), text, "--label")
        assert isinstance(layers.build(Sample).label, str)


TEN = ", ".join(["*a{0}"] * 10)
BOMB = b"a0: &a0 [1, 1, 1, 1, 1, 1, 1, 1, 1, 1]\n" + b"".join(
    f"a{n + 1}: &a{n + 1} [{TEN.format(n)}]\n".encode() for n in range(9)
)
MERGED_BOMB = b"a0: &a0 {b: 1, c: 2, d: 3, e: 4}\n" + b"".join(
    f"a{n + 1}: &a{n + 1}\n  {{<<: [{TEN.format(n)}]}}\n".encode() for n in range(9)
)
"""Ten to the power of ten values each when unfolded."""


def test_yaml_files(tmp_path: Path) -> None:
    file = tmp_path / "a.yaml"
    file.write_text("count: 4\narm:\n  side: left\n", encoding="utf-8")
    layers = Layers()
    layers.add(read_yaml(file), str(file))
    assert layers.build(Sample) == Sample(count=4, arm=Arm(side="left"))
    file.write_text("# nothing\n", encoding="utf-8")
    assert read_yaml(file) == {}


@pytest.mark.parametrize(
    ("content", "sentence"),
    [
        (b"count: 4\narm: [1\nlabel: x\n", "is not YAML in line 3"),
        (b"count: 4\n\tlabel: x\n", "is not YAML in line 2"),
        (b"\xff\xfe\x00", "line 1 is not UTF-8; save the file as UTF-8"),
        ("a: 1\nb: Küche\n".encode("latin-1"), "line 2 is not UTF-8; save the file as UTF-8"),
        ("a: 1\n".encode("utf-16"), "line 1 is not UTF-8; save the file as UTF-8"),
        (b"- 1\n- 2\n", "a mapping of names to values was expected, got list"),
        (b"a: !!python/object/apply:os.getcwd []\n", "is not YAML in line 1"),
        (b"a: 1\nb: 2\na: 3\n", "line 3: the key 'a' occurs twice, first in line 1; keep one"),
        (b"a: 1\nb: 0x" + b"f" * 100_000, "line 2: a number has more than 1000 digits"),
        (b"a: !!int " + b"5" * 1001, "line 1: a number has more than 1000 digits"),
        (b"a: !!bool maybe", "is not YAML at a tag ('maybe')"),
        (b"a: !!timestamp x", "is not YAML at a tag ("),
        (b"a: '\0'", "is not YAML (unacceptable character"),
        (b"a: !!int [1]", "is not YAML at a tag ("),
        (b"a: " + b"[" * 150 + b"]" * 150, "is nested too deeply"),
        (b"a: &a [*a]", "is nested too deeply"),
        (b"a: &a {b: [{c: *a}]}", "is nested too deeply"),
        (BOMB, "line 6: aliases unfold to more than"),
        (MERGED_BOMB, "line 11: aliases unfold to more than"),
        (b"a: 1\n---\nb: 2\n", "is not YAML in line 2"),
        (b"# " + b"x" * 4 * 1024 * 1024, "is too large, at most 4 MiB are read"),
    ],
)
def test_a_broken_file_raises_one_sentence(tmp_path: Path, content: bytes, sentence: str) -> None:
    file = tmp_path / "broken.yaml"
    file.write_bytes(content)
    with pytest.raises(ConfigError) as caught:
        read_yaml(file)
    assert str(caught.value).startswith(f"{file}: {sentence}")
    assert "\n" not in str(caught.value)


def test_a_hundred_thousand_levels_are_one_sentence(tmp_path: Path) -> None:
    file = tmp_path / "deep.yaml"
    file.write_bytes(b"a: " + b"[" * 100_000)
    with pytest.raises(ConfigError, match=r"is nested too deeply|exceeded maximum nesting depth") as caught:
        read_yaml(file)  # libyaml has a limit of its own from 0.2.6 on
    assert "\n" not in str(caught.value)


def test_merged_keys_may_be_overridden(tmp_path: Path) -> None:
    file = tmp_path / "merged.yaml"
    file.write_text("a: &a {x: 1, y: 2}\nb: &b {<<: *a, y: 3}\nc: {<<: [*b, *a], y: 4}\n")
    assert read_yaml(file) == {"a": {"x": 1, "y": 2}, "b": {"x": 1, "y": 3}, "c": {"x": 1, "y": 4}}


def test_a_file_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"absent.yaml: cannot be read \(no such file"):
        read_yaml(tmp_path / "absent.yaml")
    with pytest.raises(ConfigError, match="cannot be read"):
        read_yaml(tmp_path)


def test_every_parameter_is_listed_with_option_type_and_default() -> None:
    assert {leaf.option: (leaf.type_name, leaf.default) for leaf in iter_parameters(Sample)} == {
        "--count": ("int", "3"),
        "--label": ("text", "none yet"),
        "--is-on": ("bool", "False"),
        "--offsets-m": ("list of float", "[0.0, 1.0]"),
        "--weights": ("mapping of text to float", "{'a': 1.0}"),
        "--arm.length-m": ("float", "0.7"),
        "--arm.side": ("one of left, right", "right"),
        "--limits.rate-hz": ("float", "none"),
    }
    assert [leaf.default for leaf in iter_parameters(Needy)] == ["required"]


def test_file_replaces_a_mapping_and_an_option_changes_one_entry() -> None:
    layers = Layers(("by_name",))
    layers.add({"by_name": {"a": {"name": "x"}}, "arm": {"length_m": 0.5}}, "scenario.yaml")
    layers.add({"by_name": {"b": {"name": "y"}, "c": {"name": "z"}}, "arm": {"side": "left"}}, "mine.yaml")
    layers.add({"arm": {"side": "left"}}, "without.yaml")
    assert layers.values["by_name"].keys() == {"b", "c"}
    layers.add_text(("by_name", "b", "name"), "w", "--set")
    layers.add_environment({"POINTIT_X__BY_NAME__C__NAME": "v"}, "POINTIT_X__")
    config = layers.build(Large)
    assert {name: part.name for name, part in config.by_name.items()} == {"b": "w", "c": "v"}
    assert layers.values["arm"] == {"length_m": 0.5, "side": "left"}
    layers.add_text(("by_name",), "{d: {name: u}}", "--set")
    assert list(layers.build(Large).by_name) == ["d"]


SERVICES = [process.name for process in PROCESSES]


def test_variables_of_services_are_accepted() -> None:
    fine = {f"{environment_prefix(name)}ANYTHING": "1" for name in SERVICES}
    check_environment({**fine, "POINTIT_DATA": "/", "HOME": "/", "POINTITX": "", "XPOINTIT_Y": ""}, SERVICES)


@pytest.mark.parametrize(
    ("variable", "said"),
    [
        ("POINTIT_SELEKTOR__X", "there is no service SELEKTOR; did you mean POINTIT_SELECTOR__X?"),
        ("POINTIT_SELECTOR_WINDOW_S", "before the parameter, write POINTIT_SELECTOR__WINDOW_S"),
        ("POINTIT_SELECTOR", "before the parameter, write POINTIT_SELECTOR__<PARAMETER>"),
        ("POINTIT_ROBOT_REPLAY_SPEED", "write POINTIT_ROBOT_REPLAY__SPEED"),
        ("POINTIT_QQQQQQ__X", "`pointit list` shows services"),
    ],
)
def test_a_variable_without_effect_is_reported_with_the_nearest_name(variable: str, said: str) -> None:
    with pytest.raises(ConfigError) as caught:
        check_environment({variable: "1"}, SERVICES)
    assert str(caught.value).startswith(f"variable {variable}: ")
    assert said in str(caught.value)


def test_one_service_alone_knows_how_its_own_are_spelt(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("POINTIT_PUI_MAP", "lab")  # none of its business
    load_config(Selector, [], {})
    monkeypatch.setenv("POINTIT_SELECTOR_WINDOW_S", "0.5")
    with pytest.raises(ConfigError, match="write POINTIT_SELECTOR__WINDOW_S"):
        load_config(Selector, [], {})
