"""Mistakes of users: one sentence that names it, the right exit code, and nothing started in vain."""

import contextlib
import signal
import socket
from pathlib import Path

import pytest

from tests.support.commands import Commands, Ended
from tests.support.pace import within

PLACE = "about: a\nplaces: [{position_m: [0, 0, 0]}]\n"
RUN = ("run", "--no-view", "--duration", "60")


def one_sentence(ended: Ended, *parts: str, code: int = 2) -> None:
    assert ended.code == code, ended.err
    assert within(ended.took_s, 15.0)  # found before or at the start, not at the end
    assert "Traceback" not in ended.err
    assert ended.out == ""
    for part in parts:
        assert part in ended.sentence, ended.sentence
    assert "\n" not in ended.sentence


@pytest.mark.parametrize(
    ("arguments", "parts"),
    [
        (("nope",), ["no scenario 'nope'", "scenario_5, scenario_6, send_a_robot; or give a .yaml file"]),
        (("replay",), ["`pointit import FILE.csv --to FILE.mcap`", "`pointit replay FILE.mcap`"]),
        (("{folder}/none.yaml",), ["{folder}/none.yaml: cannot be read"]),
        (("{folder}/broken.yaml",), ["{folder}/broken.yaml: is not YAML in line "]),
        (("{folder}/places.yaml",), ["{folder}/places.yaml: places.0.position_m", "[1, 2]"]),
        (("{folder}/service.yaml",), ["{folder}/service.yaml: site: no service 'puj'"]),
        (("{folder}/parameter.yaml",), ["{folder}/parameter.yaml, pui: no parameter nope"]),
        (
            ("--config", "{folder}/section.yaml"),
            ["{folder}/section.yaml: 'puj' is no service", "did you mean pui?"],
        ),
        (("--config", "{folder}/value.yaml"), ["{folder}/value.yaml, selector: window_s: ", "'soon'"]),
        (("--set", "selector.window_s=soon"), ["--set selector.window_s=soon: window_s: ", "'soon'"]),
        (("--set", "selector"), ["--set 'selector': write service.parameter=value"]),
        (("--set", "imu-bridge.rate_hz=1"), ["imu-bridge is not among what this starts"]),
        (("--set", "pui.map={folder}/map.yaml"), ["{folder}/map.yaml: strips: ", "3"]),
        (("--set", "pui.map={folder}/none.yaml"), ["{folder}/none.yaml: cannot be read"]),
        (("--imu", "nonsense"), ["--imu 'nonsense': no IMU source 'nonsense' is installed"]),
        (("--imu", "replay:{folder}/none.csv"), ["{folder}/none.csv: cannot be read"]),
        (("--imu", "sim", "--imu", "sim"), ["--imu is given for 2 people", "--users"]),
        (("--leds", "nonsense"), ["--leds 'nonsense': no LED output 'nonsense' is installed"]),
        (("--summary", "{folder}/none/s.json"), ["--summary {folder}/none/s.json: there is no directory"]),
        (("--summary", "{folder}"), ["--summary {folder}: is a directory"]),
        (("--connect", "here"), ["'here' is no address", "tcp/127.0.0.1:7447"]),
        (("--listen", "tcp/127.0.0.1"), ["'tcp/127.0.0.1' is no address"]),
        (("--connect", "tcp/h:1", "--listen", "tcp/h:2"), ["--listen and --connect exclude each other"]),
        (("--site", "a/b"), ["site 'a/b'"]),
    ],
)
async def test_what_is_typed_or_written_wrong_is_named(
    commands: Commands, endpoint: str, tmp_path: Path, arguments: tuple[str, ...], parts: list[str]
) -> None:
    files = {
        "broken": "about: a\nplaces: [\n  - b\n",
        "places": "about: a\nplaces: [{position_m: [1, 2]}]\n",
        "service": PLACE + "site: {puj: {}}\n",
        "parameter": PLACE + "site: {pui: {nope: 3}}\n",
        "section": "puj: {}\n",
        "value": "selector: {window_s: soon}\n",
        "map": "strips: 3\n",
    }
    for name, text in files.items():
        (tmp_path / f"{name}.yaml").write_text(text)
    filled = [argument.replace("{folder}", str(tmp_path)) for argument in arguments]
    where = () if {"--listen", "--connect"} & set(arguments) else ("--listen", endpoint)
    ended = await commands.pointit(*RUN, *filled, *where)
    one_sentence(ended, *(part.replace("{folder}", str(tmp_path)) for part in parts))


async def test_a_wrong_variable_is_named(commands: Commands, endpoint: str) -> None:
    ended = await commands.pointit(
        *RUN, "--listen", endpoint, environment={"POINTIT_SELECTOR__WINDOW_S": "soon"}
    )
    one_sentence(ended, "variable POINTIT_SELECTOR__WINDOW_S: window_s: ", "'soon'")


async def test_a_wrong_map_does_not_pretend_to_have_run(commands: Commands, endpoint: str) -> None:
    summary = ("--json", "--set", "pui.map=/nowhere.yaml")
    one_sentence(await commands.pointit(*RUN, *summary, "--listen", endpoint), "/nowhere.yaml")


@pytest.mark.parametrize(
    ("option", "value"), [("--duration", "-3"), ("--speed", "0"), ("--seed", "-1"), ("--users", "1000")]
)
async def test_numbers_out_of_range(commands: Commands, option: str, value: str) -> None:
    one_sentence(await commands.pointit("run", option, value), f"'{option}'", "not in the range")


async def test_users_have_mistakes_of_their_own(commands: Commands, endpoint: str) -> None:
    where = ("--connect", endpoint)
    one_sentence(await commands.pointit("person", "add", "a b", *where), "user 'a b'")
    two = await commands.pointit("person", "add", "anna", "--imu", "sim", "--imu", "sim", *where)
    one_sentence(two, "--imu is given 2 times for one person")
    setting = await commands.pointit("person", "add", "anna", "--set", "pui.map=lab", *where)
    one_sentence(setting, "pui is not among what this starts")


async def test_a_taken_address(commands: Commands) -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        address = f"tcp/127.0.0.1:{server.getsockname()[1]}"
        ended = await commands.pointit(*RUN, "--listen", address)
    one_sentence(ended, f"cannot listen on {address}", "--connect", "--listen", code=1)


@pytest.mark.parametrize("arguments", [RUN, ("person", "add", "anna")])
async def test_nobody_is_there_to_join(commands: Commands, endpoint: str, arguments: tuple[str, ...]) -> None:
    command = commands.start(*arguments, "--connect", endpoint)
    await command.says(f"nobody answers at {endpoint} yet; trying again until somebody does")
    ended = await command.stop(signal.SIGINT)
    assert ended.code == 0
    assert within(ended.took_s, 4.0)
    assert "Traceback" not in ended.err
    assert ended.out == ""  # nothing has run


async def test_the_default_address_gives_way(commands: Commands) -> None:
    """Without an explicit address the next free one is used, and the run prints how others find it."""
    with contextlib.suppress(OSError), socket.create_server(("127.0.0.1", 7447)):  # or another process has it
        run = commands.start("run", "scenario_2", "--no-view")
        await run.says("tcp/127.0.0.1:7447 is in use; listening at tcp/127.0.0.1:")
        await run.says("scenario_2 of site lab at tcp/127.0.0.1:")
        assert (await run.stop()).code == 0
