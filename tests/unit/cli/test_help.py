"""Help, options, errors, and listings of plug-ins."""

import asyncio
import inspect
import re
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

import click
import pytest
from click.testing import CliRunner

from pointit.cli.common.lazy import LazyGroup, walk
from pointit.cli.common.panels import PanelCommand
from pointit.cli.common.site_link import SiteAddress, default_address_note, notify_if_slow
from pointit.cli.inspect.listings import plugins, services
from pointit.cli.main import PATHS, command, front, wrap_message
from pointit.plugins import GROUPS
from pointit.runtime.errors import NoAnswerError
from pointit.services import registry
from tests.support import strangers

MOST_LINES = 24
"""Lines of a usual terminal."""


CONTEXT = {"context", "ctx", "_context"}
"""Arguments that `click.pass_context` adds."""


def loaded(words: Sequence[str]) -> click.Command:
    found: click.Command | None = command
    with click.Context(command) as context:
        for word in words:
            assert isinstance(found, click.Group)
            found = found.get_command(context, word)
    assert found is not None
    return found


@pytest.mark.parametrize("path", PATHS, ids=" ".join)
def test_every_command_documents_itself_with_an_example_in_80_columns(path: tuple[str, ...]) -> None:
    ended = CliRunner().invoke(command, [*path, "--help"], prog_name="pointit", terminal_width=80)
    assert ended.exit_code == 0
    assert max(map(len, ended.output.splitlines())) <= 80
    usage, _, body = ended.output.partition("\n")
    assert usage.startswith(f"Usage: pointit {' '.join(path)}")
    assert "Example" in body
    assert "\\" not in body  # click's mark for a block that stays as it is, misspelt
    assert "..." not in body.replace("LAMP[,LAMP...]", "")


@pytest.mark.parametrize("path", PATHS, ids=" ".join)
def test_help_of_a_command_has_at_most_24_lines(path: tuple[str, ...]) -> None:
    ended = CliRunner().invoke(command, [*path, "--help"], prog_name="pointit", terminal_width=100)
    assert len(ended.output.splitlines()) <= MOST_LINES
    found = loaded(path)
    if isinstance(found, PanelCommand) and found.usual:
        assert "--help-all" in ended.output
        told = CliRunner().invoke(command, [*path, "--help-all"], prog_name="pointit", terminal_width=100)
        assert all(option in told.output for each in found.params for option in each.opts if option[0] == "-")
        paragraphs = (found.help or "").split("\n\n")
        assert all(part.split()[-1] in told.output for part in [*paragraphs, found.epilog or "."])


@pytest.mark.parametrize("words", [(), ("map",), ("doctor",)], ids=" ".join)
def test_help_all_is_the_help_when_that_has_no_rest(words: tuple[str, ...]) -> None:
    short, whole = (CliRunner().invoke(command, [*words, asked]) for asked in ("--help", "--help-all"))
    assert whole.exit_code == 0
    assert whole.output == short.output


def test_the_laboratory_is_one_line_of_the_help() -> None:
    told = CliRunner().invoke(command, ["--help"], prog_name="pointit", terminal_width=80).output
    (line,) = [each for each in told.splitlines() if "evaluate" in each]
    assert line == "To measure, from the laboratory: pointit evaluate, pointit load"
    assert CliRunner().invoke(command, ["evaluate", "--help"], prog_name="pointit").exit_code == 0


@pytest.mark.parametrize("path", PATHS, ids=" ".join)
def test_every_parameter_has_an_argument_of_its_name(path: tuple[str, ...]) -> None:
    """A command whose function was renamed but not its options fails only when it is called."""
    found = loaded(path)
    if found.callback is None:
        return
    accepted = inspect.signature(inspect.unwrap(found.callback)).parameters
    names = {parameter.name for parameter in found.params if parameter.expose_value}
    if any(each.annotation is SiteAddress for each in accepted.values()):
        names -= {"connect"}  # `site` has both
    required = {
        name
        for name, each in accepted.items()
        if each.default is each.empty and each.kind not in (each.VAR_KEYWORD, each.VAR_POSITIONAL)
    }

    assert required - names <= CONTEXT, path
    if not any(each.kind is each.VAR_KEYWORD for each in accepted.values()):
        assert names <= set(accepted), path


@pytest.mark.parametrize("path", PATHS, ids=" ".join)
def test_every_option_is_explained(path: tuple[str, ...]) -> None:
    found = loaded(path)
    for parameter in found.get_params(click.Context(found, help_option_names=[])):
        if isinstance(parameter, click.Option):
            assert parameter.help, parameter.name


def test_errors_are_wrapped_between_words() -> None:
    sentence = (
        "where anna stands is not known: anna is not on this site, there is user1; add them with "
        "`pointit person add anna`, see "
        "tcp/an-address-that-is-longer-than-a-line.of.the.terminal.example.org:7447/and/on"
    )
    lines = f"Error: {wrap_message(sentence, 80)}".splitlines()
    assert " ".join(" ".join(lines).split()) == f"Error: {sentence}"
    assert max(len(line) for line in lines if "tcp/" not in line) <= 80
    assert wrap_message("short", 80) == "short"
    assert wrap_message(sentence) == sentence  # no terminal: one line, for grep


def test_errors_of_commands_are_wrapped_on_a_terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    def marked(text: str) -> str:
        return f"<{text}>"

    monkeypatch.setattr("pointit.cli.main.wrap_message", marked)
    runner = CliRunner()
    told = runner.invoke(command, ["person", "pose", "anna", "x"], standalone_mode=False).exception
    assert isinstance(told, click.ClickException)
    assert told.format_message().startswith("<'x' is neither a coordinate in metres")
    told = runner.invoke(command, ["run", "nowhere"], standalone_mode=False).exception
    assert str(told).startswith("<no scenario 'nowhere'")
    told = runner.invoke(command, ["run", "--pose", "z"], standalone_mode=False).exception
    assert isinstance(told, click.BadParameter)
    assert told.format_message().startswith("<Invalid value for '--pose'")


@click.command()
@click.option("--connect", multiple=True, default=("tcp/here:1",))
def _asks(connect: tuple[str, ...]) -> None:
    raise NoAnswerError(f"nothing{default_address_note('lab', connect)}")


@pytest.mark.parametrize(
    ("typed", "told"), [([], "nothing (site lab at tcp/here:1)"), (["--connect", "tcp/there:2"], "nothing")]
)
def test_an_address_that_was_not_typed_is_told(typed: list[str], told: str) -> None:
    assert str(CliRunner().invoke(_asks, typed).exception) == told


async def test_long_wait_is_announced_and_a_short_one_is_not(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    with notify_if_slow("waiting for the map …"):
        await asyncio.sleep(0)
    assert capsys.readouterr().err == ""
    monkeypatch.setattr("pointit.cli.common.site_link.SILENT_S", 0.01)
    with notify_if_slow("waiting for the map …"):
        await asyncio.sleep(0.1)
    assert capsys.readouterr().err == "waiting for the map …\n"


@pytest.mark.parametrize(("words", "asked"), [("run", "--help-all"), ("person add", "--help-all")])
def test_every_option_is_shown_once(words: str, asked: str) -> None:
    text = CliRunner().invoke(command, [*words.split(), asked], prog_name="pointit").output
    found = loaded(words.split())
    assert isinstance(found, PanelCommand)
    options = [option for option in found.params if isinstance(option, click.Option)]
    for option in options:
        assert len(re.findall(rf"^  {option.opts[0]}\b(?!-)", text, re.MULTILINE)) == 1, option.opts
    assert all(f"\n{heading}:\n" in text for heading in (*found.panels, "Other options"))


def test_help_of_run_has_ten_options_and_names_help_all() -> None:
    text = CliRunner().invoke(command, ["run", "--help"], prog_name="pointit").output
    shown = re.findall(r"^  (--[\w-]+)", text, re.MULTILINE)
    assert (len(shown), shown[-1]) == (11, "--help-all")


def test_panels_name_only_options() -> None:
    both = [loaded(["run"]), loaded(["person", "add"])]
    options = {option.name for each in both for option in each.params}
    panels = [each.panels for each in both if isinstance(each, PanelCommand)]
    assert {name for each in panels for names in each.values() for name in names} <= options
    assert {name for each in both if isinstance(each, PanelCommand) for name in each.usual} <= options


FRONT = front()
assert isinstance(FRONT, LazyGroup)
NUMBERS = [
    (path, option)
    for path, entry in walk(FRONT.entries)  # without parameters of services, which pydantic checks
    for option in entry.load().params
    if isinstance(option, click.Option) and isinstance(option.type, click.types.FloatParamType)
]


def test_there_are_numbers_to_look_at() -> None:
    assert len(NUMBERS) > 8


@pytest.mark.parametrize(("path", "option"), NUMBERS, ids=lambda value: str(getattr(value, "name", value)))
def test_nan_is_no_number(path: tuple[str, ...], option: click.Option) -> None:
    with pytest.raises(click.BadParameter, match="finite"):
        option.type.convert("nan", option, None)
    del path


COMMAND = "my-tally"
PACKAGE = "strangers-parts"
SUMMARY = "Parts of a radio"
ENTRIES = {
    "imu_sources": "plain-wave = strangers_plain:WAVING",
    "led_outputs": "plain-lamp = strangers_plain:LAMP",
    "selection_methods": "plain-way = strangers_plain:WAY",
    "recognisers": "plain-ears = strangers_plain:EARS",
    "services": "tally = strangers_plain:TALLY_SERVICE",
    "commands": f"{COMMAND} = strangers_plain:report\nrun = strangers_plain:run",
}


@pytest.fixture
def plain(tmp_path: Path) -> Iterator[None]:
    with strangers.installed(tmp_path, "strangers_plain", "raise RuntimeError", **ENTRIES):
        with (tmp_path / "strangers_parts-1.0.dist-info" / "METADATA").open("a") as metadata:
            metadata.write(f"Summary: {SUMMARY}\n")
        yield
    assert "strangers_plain" not in sys.modules


@pytest.mark.usefixtures("plain")
def test_plugins_are_listed_by_kind_without_importing_their_modules() -> None:
    group = front()
    with click.Context(group):
        rows = {row["use"]: row for row in plugins().rows if row["package"] == PACKAGE}
    assert {use: row["about"] for use, row in rows.items() if row["name"] != "run"} == {
        "--imu plain-wave": SUMMARY,
        "--output plain-lamp": SUMMARY,
        "--method plain-way": SUMMARY,
        "listen --recogniser plain-ears": SUMMARY,
        "--with tally": SUMMARY,
        f"pointit {COMMAND}": SUMMARY,
    }
    assert (
        f"{PACKAGE} adds no command 'run', which is a name of PointIt's own" in rows["pointit run"]["about"]
    )


@pytest.mark.usefixtures("plain")
def test_service_of_another_package_is_listed_without_importing_its_module() -> None:
    (row,) = (row for row in services().rows if row["name"] == "tally")
    assert row["about"] == f"{SUMMARY} ({PACKAGE})"
    assert (row["scope"], row["reads"]) == (None, None)
    assert [row["name"] for row in services().rows if row["name"] == "web"] == ["web"]
    assert "tally" not in [row.name for row in registry.PROCESSES]


def test_own_plug_ins_are_listed_with_summary_and_argument() -> None:
    rows = {row["name"]: row for row in plugins().rows}
    for group in GROUPS.values():
        for name in group.names:
            plugin = group.get(name)
            assert rows[name]["about"] == plugin.summary
            assert rows[name]["use"].endswith(f"{name}{plugin.value}")
