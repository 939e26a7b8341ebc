"""The page of a run: where it is, who may see it, what is asked of it."""

import importlib.metadata
import socket
import sys
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any
from urllib.parse import parse_qs, urlsplit

import click
import pytest
from click.testing import CliRunner

from pointit.bridges.web.config import WebConfig
from pointit.cli import page as dashboard
from pointit.cli.main import command
from pointit.cli.page import PAGE_PART, RunPage
from pointit.cli.run import run as run_command
from pointit.cli.summary import write_summary
from pointit.launch import page
from pointit.launch.page import (
    MAX_PAGES_IN_RUN,
    PORT,
    PORTS_TO_TRY,
    Page,
    is_asked_of_page,
    page_link_file,
    page_of,
    where,
)
from pointit.launch.plan.launches import Choices, Settings
from pointit.launch.plan.plan import FloorPose, Plan, read_scenario
from pointit.launch.plan.scenario_catalog import PLACES, places
from pointit.launch.run.running_scenario import redact_secrets
from pointit.recording.entries import RecordingError
from pointit.runtime.errors import ConfigError, ListenError
from pointit.runtime.link.link import Credentials, Link, LinkFile
from pointit.schemas import KeyNameError
from tests.support.buses import free_port
from tests.support.invoked import python
from tests.unit.cli_run.drawn import monitor_of
from tests.unit.cli_run.stand_in import StandIn


def page_with(*settings: str, **asked: Any) -> Page:
    return page_of(Settings(settings=settings), asked={"port": 0, **asked})


def test_page_address_has_the_port_and_the_operators_token() -> None:
    made = page_with()
    config = made.config
    address = urlsplit(made.url)
    assert (address.scheme, address.hostname, address.port) == ("http", "127.0.0.1", config.port)
    assert config.port > 0  # any that is free was asked for, and is known before it is served
    assert parse_qs(address.query) == {"token": [config.operator_token]}
    assert made.viewer_url.partition("=")[2] == config.viewer_token
    assert not made.lan_url
    assert len(made.url) <= 70  # with `page: ` in a frame of 80 columns


def test_the_page_knows_the_output_of_its_run() -> None:
    chosen = {
        "no_web": False,
        "web_port": 0,
        "lan": False,
        "no_browser": True,
        "new_link": False,
        "site": "lab",
    }
    for output in ("ddp:kitchen.local", ""):
        (beside,) = PAGE_PART.add(read_scenario("shelf"), Choices(output=output), chosen).beside
        assert isinstance(beside, RunPage)
        assert (beside.page.config.run_output, beside.page.is_usual) == (output, True)


def test_without_a_wish_the_next_port_is_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    first = free_port()
    monkeypatch.setattr(page, "PORT", first)
    assert page_of(Settings()).config.port == first
    with socket.create_server(("127.0.0.1", first)):
        assert page_of(Settings()).config.port in range(first + 1, first + PORTS_TO_TRY)
    assert PORT == 8090


def test_requested_port_that_is_taken_is_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    port = free_port()
    with socket.create_server(("127.0.0.1", port)):
        sentence = refused(monkeypatch, "dashboard", "--port", str(port), kind=ListenError)
        assert sentence.endswith("address already in use; choose another port with --port")
        for asked, settings in (({"port": port}, ()), ({}, (f"web.port={port}",))):
            with pytest.raises(
                ListenError,
                match=rf"cannot listen at 127\.0\.0\.1:{port}: address already in use; .* --web-port",
            ):
                page_of(Settings(settings=settings), asked=asked)


def test_settings_win_over_options_and_options_over_the_scenario() -> None:
    below = {"rate_hz": 20.0, "record_s": 5.0, "lan": False}
    chosen = Settings(settings=["web.rate_hz=30", "web.operator_token=mine"])
    made = page_of(chosen, below=below, asked={"port": 0})
    config = made.config
    assert (config.rate_hz, config.record_s) == (30.0, 5.0)
    assert made.url.endswith("/?token=mine")
    with pytest.raises(ConfigError, match=r"--set web\.nope=1: no parameter nope"):
        page_with("web.nope=1")


def test_the_local_network_is_told_where_it_is_opened() -> None:
    made = page_with(lan=True, lan_port=0, lan_address="192.168.1.5")
    config = made.config
    assert made.lan_url == f"https://192.168.1.5:{config.lan_port}/?token={config.operator_token}"
    assert made.viewer_lan_url.endswith(config.viewer_token)
    assert config.host == "127.0.0.1"  # what is not encrypted stays on this machine


def test_port_in_the_host_is_that_of_the_page() -> None:
    port = free_port()
    page = page_of(Settings(settings=[f"web.host=127.0.0.1:{port}"]))
    assert page.config.port == port
    assert page.url.startswith(f"http://127.0.0.1:{port}/")


def test_published_port_is_in_the_address_of_the_page() -> None:
    made = page_with(published_port=4321)
    assert made.url.startswith("http://127.0.0.1:4321/?token=")
    assert made.config.port != 4321


def test_an_ipv6_host_stands_in_brackets() -> None:
    try:
        made = page_with(host="::1")
    except ListenError:
        pytest.skip("no IPv6 here")
    assert made.url.startswith("http://[::1]:")


def test_people_are_placed_by_the_scenario_or_the_command_line() -> None:
    scenario = read_scenario("scenario_4")
    told = places(scenario, Choices(poses=[None, FloorPose(x_m=1.0, y_m=2.0, yaw_deg=30.0)], localize=True))
    assert told["user1"] == scenario.places[0].model_dump()
    assert told["user2"] == {"position_m": (1.0, 2.0, 0.0), "yaw_deg": 30.0}
    assert told["user5"] == scenario.places[0].model_dump()
    assert len(told) == PLACES  # people may come while it is served
    assert page_of(Settings(), asked={"port": 0}, places=told).config.places.keys() == told.keys()


def test_several_pages_of_a_site_have_names_of_their_own() -> None:
    made = replace(page_with(), load=lambda: StandIn)
    assert [made.launch(number).instance for number in (1, 2, 3)] == ["web", "web.2", "web.3"]
    assert made.launch().instance == made.instance


def test_page_parameters_set_by_hand_are_checked_before_the_start() -> None:
    assert page_with().is_usual
    assert page_with(lan=True, port=0).is_usual
    assert not page_with("web.host=0.0.0.0").is_usual
    assert not page_with("web.operator_token=short").is_usual
    assert not page_of(Settings(), below={"rate_hz": 9.0}).is_usual


@pytest.mark.parametrize(
    ("settings", "asked", "is_open"),
    [
        ((), {}, False),
        (("web.rate_hz=9", "web.operator_token=a-token-of-mine"), {}, False),
        ((), {"lan": True}, True),
        (("web.lan=true",), {}, True),
        (("web.host=0.0.0.0", "web.published_port=8090"), {}, True),
        (("web.published_port=8090",), {}, True),
        (("web.viewer_token=a-token-for-guests",), {}, True),
    ],
)
def test_page_has_its_own_process_when_others_may_open_it(
    settings: tuple[str, ...], asked: dict[str, Any], *, is_open: bool
) -> None:
    opened = RunPage(page_with(*settings, **asked))

    assert opened.page.is_open_to_others is is_open
    assert opened.needs_own_process(Link(listen=("tcp/127.0.0.1:1",))) is is_open


@pytest.mark.parametrize(("settings", "limit"), [((), MAX_PAGES_IN_RUN), (("web.most_viewers=50",), 50)])
def test_page_in_the_process_of_a_run_has_few_viewers(settings: tuple[str, ...], limit: int) -> None:
    beside = RunPage(replace(page_with(*settings), load=lambda: StandIn))

    launched = beside.launch().config
    assert isinstance(launched, WebConfig)
    assert launched.most_viewers == limit


def test_page_beside_processes_has_its_own_process() -> None:
    assert RunPage(page_with(), has_processes=True).needs_own_process(Link(listen=("tcp/127.0.0.1:1",)))


def test_page_of_a_secured_site_has_its_own_process(tmp_path: Path) -> None:
    now = datetime.now(UTC)
    file = LinkFile(
        site="plant", name="a", role="supervisor", generation=1, endpoints=(), valid_from=now, valid_until=now
    )
    link = Link(connect=("tls/a:1",), credentials=Credentials(folder=tmp_path, link=file))

    assert RunPage(page_with()).needs_own_process(link)


def test_run_imports_no_server_when_the_page_is_another_process() -> None:
    script = (
        "import sys; from types import SimpleNamespace as Bus\n"
        "from pointit.cli.page import RunPage; from pointit.launch.page import page_of\n"
        "from pointit.launch.plan.launches import Settings; from pointit.runtime.link.link import Link\n"
        "page = RunPage(page_of(Settings(), asked={'port': 0, 'lan': True}))\n"
        "with page.joined(Bus(site='lab', link=Link(listen=('tcp/a:1',)))): launch = page.launch()\n"
        "print(launch.instance, launch.config.devices_at, *sys.modules)"
    )
    instance, address, *modules = python("-c", script, check=True).stdout.split()
    assert (instance, address) == ("web", "tcp/a:1")
    assert not set(modules) & {"starlette", "uvicorn"}


def test_the_extra_is_looked_for_without_loading_it(monkeypatch: pytest.MonkeyPatch) -> None:
    assert page.is_available()
    find = importlib.metadata.version

    def without(name: str) -> str:
        if name == "segno":
            raise importlib.metadata.PackageNotFoundError(name)
        return find(name)

    monkeypatch.setattr("pointit.runtime.host.extras.version", without)
    assert not page.is_available()
    script = (
        "import sys, pointit.cli.run.run, pointit.launch.page as page\n"
        "page.is_available(); print(*sys.modules)"
    )
    done = python("-c", script, check=True)
    assert not set(done.stdout.split()) & {"starlette", "uvicorn", "cryptography", "segno", "mcap"}


def test_settings_of_the_page_are_recognized() -> None:
    assert is_asked_of_page(["pui.map=lab", "web.rate_hz=3"])
    assert not is_asked_of_page(["pui.map=web"])


def test_reported_command_line_has_no_secrets() -> None:
    typed = ["run", "--set", "web.operator_token=abc", "--set", "web.port=1", "--set=web.viewer_token=def"]
    told = redact_secrets(typed)
    assert told == ["run", "--set", "web.operator_token=…", "--set", "web.port=1", "--set=web.viewer_token=…"]


def invoke(monkeypatch: pytest.MonkeyPatch, *arguments: str, has_extra: bool = True) -> BaseException | None:
    monkeypatch.setattr("pointit.cli.page.is_available", lambda: has_extra)
    result = CliRunner().invoke(command, list(arguments), standalone_mode=False)
    return result.exception


def refused(
    monkeypatch: pytest.MonkeyPatch,
    *arguments: str,
    has_extra: bool = True,
    kind: type[Exception] = ConfigError,
) -> str:
    """Return the sentence with which a command ends."""
    error = invoke(monkeypatch, *arguments, has_extra=has_extra)
    assert isinstance(error, kind)
    return str(error)


def test_a_dashboard_is_not_opened_to_a_network_without_encryption(monkeypatch: pytest.MonkeyPatch) -> None:
    sentence = refused(monkeypatch, "dashboard", "--host", "192.168.1.5")
    assert sentence.startswith("--host 192.168.1.5: a page on a network needs HTTPS")
    assert "use --lan" in sentence


@pytest.mark.parametrize(
    ("host", "port", "is_lan", "values"),
    [
        ("[::1]", None, False, {"host": "::1"}),
        ("[::1]:8123", None, False, {"host": "::1", "port": 8123}),
        ("localhost:0", None, False, {"host": "localhost", "port": 0}),
        (" 127.0.0.1 ", 8123, False, {"host": "127.0.0.1", "port": 8123}),
        ("[::]", None, True, {"lan": True, "lan_address": ""}),
        (
            "192.168.1.5:8500",
            8123,
            True,
            {"lan": True, "lan_address": "192.168.1.5", "lan_port": 8500, "port": 8123},
        ),
        ("[fd00::5]", None, True, {"lan": True, "lan_address": "fd00::5"}),
    ],
)
def test_address_of_a_dashboard_may_have_brackets_and_a_port(
    host: str, port: int | None, values: dict[str, object], *, is_lan: bool
) -> None:
    assert dashboard._port_settings(port, host, is_lan=is_lan) == values


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (("--host", "[::1"), "--host: '[::1' is not an address: write HOST or HOST:PORT"),
        (("--host", "::1:99999"), "--host: '::1:99999' is not an address"),
        (("--host", "[::1]:5", "--port", "6"), "--host [::1]:5 and --port 6 differ: remove one of the ports"),
        (("--host", "[fd00::5]"), "--host [fd00::5]: a page on a network needs HTTPS"),
    ],
)
def test_address_that_a_dashboard_cannot_use_is_one_sentence(
    monkeypatch: pytest.MonkeyPatch, arguments: tuple[str, ...], sentence: str
) -> None:
    assert refused(monkeypatch, "dashboard", *arguments).startswith(sentence)


@pytest.mark.parametrize(
    "arguments",
    [("run", "--lan"), ("run", "--web-port", "0"), ("run", "--set", "web.rate_hz=3"), ("dashboard",)],
)
def test_without_the_extra_it_is_said(monkeypatch: pytest.MonkeyPatch, arguments: tuple[str, ...]) -> None:
    sentence = refused(monkeypatch, *arguments, has_extra=False)
    assert sentence.endswith("the page needs `scripts/setup web` in the folder of PointIt")


@pytest.mark.parametrize("arguments", [("--lan",), ("--web-port", "0"), ("--new-link",)])
def test_no_page_and_something_of_it(monkeypatch: pytest.MonkeyPatch, arguments: tuple[str, ...]) -> None:
    sentence = refused(monkeypatch, "run", "--no-web", *arguments)
    assert f"--no-web and {arguments[0]} exclude each other" in sentence
    sentence = refused(monkeypatch, "run", "--no-web", "--set", "web.rate_hz=3")
    assert "web is not among what this starts" in sentence


def test_run_without_the_extra_has_notes_at_start_and_end(
    monkeypatch: pytest.MonkeyPatch, plans: list[Plan]
) -> None:
    remedy = "the page needs `scripts/setup web` in the folder of PointIt"
    for arguments in ((), ("--no-web",)):
        assert invoke(monkeypatch, "run", *arguments, has_extra=False) is None
    without, unasked = plans
    assert without.notes[0] == f"{remedy}; --no-web runs without it and without this note"
    assert without.closing_note == f"There was no page: {remedy}."
    assert (unasked.closing_note, [note for note in unasked.notes if "page" in note]) == ("", [])


def test_the_afterword_stands_below_the_summary(capsys: pytest.CaptureFixture[str]) -> None:
    plan = Plan(name="mine", launches=(), link=Link(), closing_note="There was no page.")
    write_summary(plan, monitor_of(), 1.0)
    assert capsys.readouterr().out.splitlines()[-1] == "There was no page."
    write_summary(replace(plan, as_json=True), monitor_of(), 1.0)
    assert "There was no page." not in capsys.readouterr().out


def test_run_keeps_the_stored_link_without_new_link(
    monkeypatch: pytest.MonkeyPatch, plans: list[Plan]
) -> None:
    mine = ("--set", "web.operator_token=a-token-of-mine")
    for arguments in ((), (), mine, ("--new-link",), ("--site", "other"), (), ("--new-link", *mine)):
        assert invoke(monkeypatch, "run", "--web-port", "0", *arguments) is None
    pages = [each.page for plan in plans for each in plan.beside if isinstance(each, RunPage)]
    first, again, own, new, elsewhere, last, _ = (page.config.operator_token for page in pages)
    assert first == again
    assert own == "a-token-of-mine"
    assert len({first, new, elsewhere}) == 3
    assert last == new
    assert all(page.is_usual for page in pages[:2])  # else all is loaded
    assert any("--new-link does not change" in note for note in plans[-1].notes)


def test_bad_name_is_refused_before_the_site_is_searched(monkeypatch: pytest.MonkeyPatch) -> None:
    def look_round(*_: object) -> None:
        raise AssertionError("looked for the site")

    monkeypatch.setattr("pointit.cli.run.user.inspect_site", look_round)
    arguments = ("person", "add", "anna/x", "--connect", "tcp/127.0.0.1:1")
    assert refused(monkeypatch, *arguments, kind=KeyNameError).startswith("user 'anna/x'")


def test_a_wrong_port_is_a_mistake(monkeypatch: pytest.MonkeyPatch) -> None:
    assert isinstance(invoke(monkeypatch, "run", "--web-port", "70000"), click.BadParameter)


LINK = "http://127.0.0.1:8090/?token=of-the-operator"


def test_link_file_exists_with_the_page_and_redirects_there() -> None:
    with page_link_file("lab", LINK, "", "https://192.168.1.5:8443/?token=x") as path:
        assert path is not None
        text = path.read_text(encoding="utf-8")
        assert text.count("<a href=") == 2
        assert path.stat().st_mode & 0o777 == 0o600
    assert not path.exists()


@pytest.mark.parametrize("is_terminal", [False, True])
def test_only_a_terminal_is_shown_the_token(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, *, is_terminal: bool
) -> None:
    monkeypatch.setattr(sys.stderr, "isatty", lambda: is_terminal)
    file = tmp_path / "page-8090.html"
    assert (where(LINK, file) == LINK) == is_terminal
    assert ("of-the-operator" in where(LINK, None)) == is_terminal
    assert where(LINK, None).startswith("http://127.0.0.1:8090/")


def test_terminal_without_a_view_shows_the_token_hidden_in_logs(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level("INFO")
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    run_command._print_sentence(f"page: {LINK}")
    assert (capsys.readouterr().err, caplog.text) == (f"page: {LINK}\n", "")


def test_link_that_cannot_be_kept_is_a_warning(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    (tmp_path / "file").write_text("no folder")
    monkeypatch.setenv("POINTIT_STATE", str(tmp_path / "file"))
    with page_link_file("lab", LINK) as path:
        assert path is None
    assert "the link of the page could not be written to a file" in caplog.text
    assert "of-the-operator" not in caplog.text


@pytest.mark.parametrize("content", [None, b"", b"plainly no recording"])
def test_page_rejects_a_file_that_is_no_recording(tmp_path: Path, content: bytes | None) -> None:
    path = tmp_path / "lab.mcap"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(RecordingError, match=r"lab\.mcap"):
        CliRunner().invoke(command, ["page", str(path)], catch_exceptions=False)
