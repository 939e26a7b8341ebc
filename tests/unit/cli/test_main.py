"""The front page, the lazy groups, what a typo gets, and commands that other packages add."""

import importlib
import importlib.metadata
import sys
from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import NoReturn

import click
import pytest
from click.testing import CliRunner, Result

from pointit.cli.commands import COMMANDS
from pointit.cli.common import lazy
from pointit.cli.common.lazy import HEADING, LAB, LazyEntry, LazyGroup
from pointit.cli.main import EXAMPLES, PATHS, command, front, main
from pointit.runtime.errors import ConfigError
from pointit.runtime.host.extras import remedy
from pointit.services.registry import process
from tests.support import strangers
from tests.support.invoked import python


def invoke(*arguments: str) -> tuple[int, str]:
    """Return exit code and everything printed."""
    result = CliRunner().invoke(command, list(arguments), prog_name="pointit")
    return result.exit_code, result.output


@pytest.mark.parametrize("arguments", [(), ("--help",), ("-h",)])
def test_the_front_page_teaches(arguments: tuple[str, ...]) -> None:
    code, text = invoke(*arguments)
    assert code == 0
    lines = text.splitlines()
    for heading, part in COMMANDS.items():
        entries = [entry for entry in part if not entry.package]
        assert f"{heading}:" in lines or not entries
        for entry in entries:
            assert sum(line.split() == [entry.name, *entry.about.split()] for line in lines) == 1, entry.name
    assert len(EXAMPLES) == 3
    for example, _ in EXAMPLES:
        assert example in text
    assert "Start with `pointit run`" in text


def test_the_version_is_the_distributions() -> None:
    assert invoke("--version") == (0, f"pointit {importlib.metadata.version('pointit')}\n")


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        ("toppics", "no command 'toppics'; did you mean topic?"),
        ("plott", "no command 'plott'; did you mean map plot or map point?"),
        ("lst", "no command 'lst'; did you mean list or listen?"),
        ("topic echoo", "no action 'echoo'; did you mean echo?"),
        ("service lst", "no action 'lst'; did you mean list?"),  # not taken for a service
        ("service run pointin", "no service 'pointin'; did you mean pointing?"),
        ("list service", "no section 'service'; did you mean services?"),
    ],
)
def test_an_unknown_name_gets_one_sentence_with_the_near_ones(words: str, sentence: str) -> None:
    assert invoke(*words.split()) == (2, f"Error: {sentence}\n")


def test_without_near_names_all_are_told() -> None:
    code, text = invoke("xyzzy")
    assert code == 2
    assert all(path[0] in text for path in PATHS)
    assert "conveyor-sim" in invoke("service", "run", "xyzzy")[1]


def loaded_after(*arguments: str) -> set[str]:
    script = (
        "import sys, io, contextlib\n"
        "from pointit.cli.main import command\n"
        "with contextlib.redirect_stdout(io.StringIO()):\n"
        f"    command.main({list(arguments)!r}, standalone_mode=False)\n"
        "print(*sys.modules)"
    )
    done = python("-c", script, check=True)
    return set(done.stdout.split())


def test_the_front_page_loads_no_command() -> None:
    loaded = loaded_after("--help")
    rooms = ("run", "inspect", "people", "maps", "site")
    assert not [name for name in loaded if name.startswith(tuple(f"pointit.cli.{room}" for room in rooms))]
    assert not loaded & {"zenoh", "pydantic", "rich", "numpy", "scipy", "pointit_lab", "importlib.metadata"}


@pytest.mark.parametrize(
    ("line", "heavy"),
    [
        *((line, {"zenoh", "scipy", "numpy", "serial", "yaml"}) for line in ("topic list", "service list")),
        *((line, {"matplotlib"}) for line in ("map list", "map check lab", "map plot --help")),
    ],
)
def test_a_command_loads_nothing_heavy_that_it_does_not_need(line: str, heavy: set[str]) -> None:
    assert not loaded_after(*line.split()) & heavy


def test_to_start_a_scenario_loads_nothing_that_takes_long() -> None:
    loads = "from pointit.cli.run.run import run; from pointit.services.registry import PROCESSES; import sys"
    rows = "[row.load() for row in PROCESSES if row.room == 'services' or row.name == 'web']"
    done = python("-c", f"{loads}; {rows}; print(*sys.modules)", check=True)
    loaded = set(done.stdout.split())
    assert loaded >= {"numpy", "starlette"}
    assert not loaded & {"scipy", "matplotlib", "foxglove"}


def test_a_service_without_a_terminal_loads_no_rich() -> None:
    loads = "import sys, pointit.services.pui.service; from pointit.runtime.service import logs, process"
    done = python("-c", f"{loads}; logs.setup_logging(); print(*sys.modules)", check=True)
    assert not set(done.stdout.split()) & {"rich", "scipy"}


def test_garbage_is_collected_again_once_the_command_is_loaded() -> None:
    script = (
        "import atexit, gc, sys; from pointit.__main__ import begin\n"
        "atexit.register(lambda: print(gc.isenabled(), gc.get_freeze_count() > 1000, file=sys.stderr))\n"
        "begin()"
    )
    done = python("-c", script, "service", "list", check=True)
    assert done.stderr.split() == ["True", "True"]


def test_pointit_alone_is_a_run_and_says_so(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    typed: list[str] = []

    def run_program(_command: object) -> NoReturn:
        typed.extend(sys.argv)
        raise SystemExit

    monkeypatch.setattr("pointit.runtime.service.process.run_program", run_program)
    monkeypatch.setattr(sys, "argv", ["pointit"])
    with pytest.raises(SystemExit):
        main()
    assert typed == ["pointit", "run"]
    assert "`pointit --help` shows all commands" in capsys.readouterr().err


def test_a_service_documents_every_parameter_with_type_unit_and_default() -> None:
    code, text = invoke("service", "run", "pointing", "--help")
    assert code == 0
    told = " ".join(text.split())
    assert (
        "--stale-after-s <float> maximum age of a sample, or time in the future, for which a ray is"
        " published, s [default: 0.2]" in told
    )
    assert "--user" in told


def test_a_service_that_needs_an_extra_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    row = process("web")

    def lacks(module: str) -> object:
        raise ModuleNotFoundError(f"No module named {module!r}", name="starlette.routing")

    monkeypatch.setattr(importlib, "import_module", lacks)
    with pytest.raises(ConfigError, match=r"^web needs `scripts/setup web` in the folder of PointIt$"):
        row.load()
    with pytest.raises(ModuleNotFoundError):  # that is nothing that can be installed
        replace(row, extra="").load()


@pytest.mark.parametrize(("name", "lacks"), [("foxglove", "foxglove"), ("web", "starlette")])
def test_help_of_a_service_works_before_its_extra_is_installed(name: str, lacks: str) -> None:
    script = f"import sys; sys.modules[{lacks!r}] = None; from pointit.__main__ import begin; begin()"

    def run(option: str) -> tuple[int, str, str]:
        done = python("-c", script, "service", "run", name, option)
        return done.returncode, " ".join(done.stdout.split()), done.stderr

    remedy = f"{name} needs `scripts/setup {name}` in the folder of PointIt"
    code, told, _ = run("--help")
    assert code == 0
    assert remedy in told
    assert all(option in told for option in ("--site", "--host", "--port"))
    assert run("--port=0") == (2, "", f"Error: {remedy}\n")


def test_underscores_do_for_hyphens() -> None:
    bare = click.Command("led-driver")
    group = LazyGroup(entries=[LazyEntry(name="led-driver", about="", load=lambda: bare)])
    assert group.resolve_command(click.Context(group), ["led_driver", "-x"]) == ("led-driver", bare, ["-x"])


def test_bad_service_parameter_names_source_field_and_value() -> None:
    words = "service run pointing --user anna --stale-after-s soon"
    done = python("-m", "pointit", *words.split())
    assert done.returncode == 2
    assert done.stderr.startswith("Error: --stale-after-s: stale_after_s: ")
    assert "'soon'" in done.stderr
    assert done.stderr.count("\n") == 1


WAVES = """
import click

@click.command()
@click.option("--times", default=1, help="how often")
def wave(times):
    click.echo("wave " * times)

NOTHING = 3
"""
LACKS = "cannot be imported (ModuleNotFoundError: No module named 'no_such_part')"


def call(*arguments: str) -> Result:
    return CliRunner().invoke(front(), list(arguments), prog_name="pointit", standalone_mode=False)


def refusal(*arguments: str) -> str:
    error = call(*arguments).exception
    assert isinstance(error, ConfigError | click.ClickException)
    return error.format_message() if isinstance(error, click.ClickException) else str(error)


@contextmanager
def with_command(folder: Path, module: str, line: str, source: str = WAVES) -> Generator[None]:
    with strangers.installed(folder, module, source, commands=line):
        yield


def test_command_of_a_package_is_listed_unimported_and_called(tmp_path: Path) -> None:
    with with_command(tmp_path, "stranger_waves", "wave = stranger_waves:wave"):
        info = tmp_path / "strangers_parts-1.0.dist-info"
        with (info / "METADATA").open("a", encoding="utf-8") as file:
            file.write("Summary: tools of ours\n\nSummary: not this\n")
        lines = call("--help").output.splitlines()
        shown = lines[lines.index(f"{HEADING}:") + 1]
        assert " ".join(shown.split()) == "wave tools of ours (strangers-parts)"
        assert "stranger_waves" not in sys.modules
        assert refusal("wive") == "no command 'wive'; did you mean wave?"
        assert "stranger_waves" not in sys.modules
        assert call("wave", "--times", "2").output == "wave wave \n"
    assert HEADING not in call("--help").output


@pytest.mark.parametrize(
    ("source", "sentence"),
    [
        (
            "import no_such_part",
            f"command 'wave' of strangers-parts {LACKS}; update or uninstall strangers-parts",
        ),
        ("wave = 3", "command 'wave': stranger_broken:wave is no Command"),
    ],
)
def test_command_that_cannot_be_loaded_costs_no_other_one(tmp_path: Path, source: str, sentence: str) -> None:
    with with_command(tmp_path, "stranger_broken", "wave = stranger_broken:wave", source):
        try:
            assert "wave" in call("--help").output
            assert refusal("wave") == sentence
            assert call("map", "list").exception is None
        finally:
            sys.modules.pop("stranger_broken", None)


@pytest.mark.parametrize("name", ["run", "evaluate"])
def test_name_of_a_command_of_ours_is_not_given_away(tmp_path: Path, name: str) -> None:
    with with_command(tmp_path, "stranger_thief", f"{name} = stranger_thief:wave"):
        told = " ".join(call("--help").output.split())
        assert f"strangers-parts adds no command '{name}', which is a name of PointIt's own" in told
        assert HEADING not in told
        assert "--times" not in call(name, "--help").output
    assert "stranger_thief" not in sys.modules


def test_package_without_metadata_hides_no_other_command(tmp_path: Path) -> None:
    damaged = tmp_path / "aaa-1.0.dist-info"
    damaged.mkdir()
    (damaged / "entry_points.txt").write_text("[pointit.commands]\nwaste = aaa:waste\n", encoding="utf-8")
    with with_command(tmp_path, "stranger_beside", "wave = stranger_beside:wave"):
        assert "(strangers-parts)" in call("--help").output


def test_commands_of_the_laboratory_say_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(lazy, "GROUP", "pointit.no_commands")
    help_text = call("--help").output
    assert "laboratory" not in help_text
    assert "evaluate" not in help_text
    for name in ("load", "evaluate"):
        assert refusal(name, "--help") == (
            f"`pointit {name}` is a command of {LAB}, which is not installed; run {remedy('lab')}"
        )


def test_commands_are_of_the_first_version_on_the_path(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for folder, package, text in (
        ("first", "waves-2.0", "[pointit.commands]\nwave = new:wave\n"),
        ("second", "waves-1.0", "[pointit.commands]\nwave = old:wave\nold = old:old\n"),
        ("second", "silent-1.0", "[pointit.commands]\n[console_scripts]\nscript = silent:main\n"),
    ):
        info = tmp_path / folder / f"{package}.dist-info"
        info.mkdir(parents=True)
        (info / "METADATA").write_text(f"Name: {package.partition('-')[0]}\n", encoding="utf-8")
        (info / "entry_points.txt").write_text(text, encoding="utf-8")
    monkeypatch.setattr(sys, "path", [str(tmp_path / "first"), str(tmp_path / "second")])
    assert [(each.name, each.package) for each in lazy.declared()] == [("wave", "waves")]
