"""Messages and exit codes of commands."""

import asyncio
import errno
import gc
import os
import signal
from typing import ClassVar

import click
import pytest
from pydantic import Field

from pointit.runtime.config.config import Config
from pointit.runtime.config.parameters import iter_parameters
from pointit.runtime.errors import ConfigError, ConnectError
from pointit.runtime.service import process
from pointit.runtime.service.process import (
    CLOCK_REQUEST_TIMEOUT_S,
    CLOCK_TIMEOUT_S,
    run_command,
    run_until_shutdown,
    service_command,
)
from pointit.runtime.service.service import Scope, Service
from tests.support.invoked import python


class Arm(Config):
    length_m: float = Field(default=0.7, gt=0, description="shoulder to finger, m")


class SampleConfig(Config):
    rate_hz: float = Field(default=50, gt=0, description="how often, Hz")
    arm: Arm = Arm()


class Sample(Service[SampleConfig]):
    """Does nothing, often."""

    NAME: ClassVar[str] = "sample-one"
    SCOPE: ClassVar[Scope] = "user"
    CONFIG = SampleConfig


def ended(command: click.Command, *arguments: str) -> int:
    with pytest.raises(SystemExit) as caught:
        run_command(command, list(arguments))
    assert isinstance(caught.value.code, int)
    return caught.value.code


def raising(error: BaseException) -> click.Command:
    def callback() -> None:
        raise error

    return click.Command("x", callback=callback)


@pytest.mark.parametrize(
    ("error", "code"),
    [
        (ConfigError("a.yaml: broken"), 2),
        (click.UsageError("what?"), 2),
        (ConnectError("nobody answers"), 1),
        (click.ClickException("failed"), 1),
    ],
)
def test_errors_are_sentence_and_code(
    error: Exception, code: int, capsys: pytest.CaptureFixture[str]
) -> None:
    assert ended(raising(error)) == code
    shown = capsys.readouterr()
    assert shown.out == ""
    assert (
        shown.err.splitlines()[-1]
        == f"Error: {error.message if isinstance(error, click.ClickException) else error}"
    )
    assert "Traceback" not in shown.err


def test_unforeseen_error_gives_a_sentence_a_code_and_a_traceback(
    capsys: pytest.CaptureFixture[str], caplog: pytest.LogCaptureFixture
) -> None:
    assert ended(raising(ZeroDivisionError("oops"))) == 70
    assert "Error: a fault of PointIt itself (ZeroDivisionError: oops)" in capsys.readouterr().err
    assert [record.exc_info[0] for record in caplog.records if record.exc_info] == [ZeroDivisionError]


@pytest.mark.parametrize(
    ("error", "what"),
    [(OSError(errno.ENOSPC, "full"), "the output"), (OSError(errno.ENOSPC, "full", "a.mcap"), "a.mcap")],
)
def test_a_full_disk_is_no_fault_of_the_program(
    error: OSError, what: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert ended(raising(error)) == 1
    assert capsys.readouterr().err == f"Error: the disk is full: {what} is cut off\n"


@pytest.mark.parametrize(("result", "code"), [(0, 0), (3, 3), (None, 0)])
def test_the_code_is_what_the_command_returns(result: int | None, code: int) -> None:
    assert ended(click.Command("x", callback=lambda: result)) == code


def test_ctrl_c_before_the_work_begins() -> None:
    assert ended(raising(KeyboardInterrupt())) == 130


def kill_soon(number: int) -> int:
    async def work() -> int:
        asyncio.get_running_loop().call_later(0.05, os.kill, os.getpid(), number)
        return await asyncio.Event().wait()

    return run_until_shutdown(work())


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_having_been_asked_to_end_is_no_failure(number: int) -> None:
    before = signal.getsignal(number)
    assert kill_soon(number) == 0
    assert signal.getsignal(number) is before


def test_ctrl_c_is_ignored_again_afterwards_in_a_background_process() -> None:
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        assert kill_soon(signal.SIGINT) == 0
        assert signal.getsignal(signal.SIGINT) is signal.SIG_IGN
    finally:
        signal.signal(signal.SIGINT, before)


def test_an_error_during_shutdown_is_a_failure() -> None:
    async def work() -> int:
        asyncio.get_running_loop().call_later(0.05, os.kill, os.getpid(), signal.SIGTERM)
        try:
            return await asyncio.Event().wait()
        finally:
            raise ConnectError("could not say goodbye")

    with pytest.raises(ConnectError):
        run_until_shutdown(work())


def test_an_exception_group_prints_its_message_for_people() -> None:
    async def fail(error: Exception) -> int:
        raise error

    async def work() -> int:
        raise ExceptionGroup(
            "a", [ExceptionGroup("b", [ZeroDivisionError()]), ExceptionGroup("c", [ConfigError("x")])]
        )

    with pytest.raises(ConfigError):
        run_until_shutdown(work())
    with pytest.raises(ZeroDivisionError):
        run_until_shutdown(fail(ExceptionGroup("a", [ExceptionGroup("b", [ZeroDivisionError()])])))


def test_help_documents_every_parameter(capsys: pytest.CaptureFixture[str]) -> None:
    assert ended(service_command(Sample), "--help") == 0
    words = " ".join(capsys.readouterr().out.split())
    assert "Does nothing, often." in words
    assert "POINTIT_SAMPLE_ONE__<PARAMETER>" in words
    for leaf in iter_parameters(SampleConfig):
        assert leaf.field.description is not None
        assert f"{leaf.option} <{leaf.type_name}> {leaf.field.description}" in words
        assert f"[default: {leaf.default}]" in words
    for option in ("--user", "--site", "--connect", "--listen", "--config", "--clock", "--log-level"):
        assert option in words


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--rate-hz", "-1"], "--rate-hz: rate_hz: must be above 0 (got -1)"),
        (["--arm.length-m", "long"], "--arm.length-m: arm.length_m: write a number"),
        (["--config", "absent.yaml"], "absent.yaml: cannot be read"),
        (["--user", "a/b"], "user 'a/b': use 1 to 64 letters"),
        (["--listen", "tcp/127.0.0.1:70000"], "there is no port 70000; use one up to 65535"),
        (["--connect", "tcp/127.0.0.1:70000"], "there is no port 70000; use one up to 65535"),
        (["--connect", "tcp/127.0.0.1:0"], "there is no port 0; use one up to 65535"),
        (["--listen", "tcp/127.0.0.1:-1"], "'tcp/127.0.0.1:-1' is no address"),
        (["--connect", "tcp/127.0.0.1:http"], "is no address"),
    ],
)
def test_a_wrong_argument_is_named(
    arguments: list[str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert ended(service_command(Sample), "--user", "anna", *arguments) == 2
    error = capsys.readouterr().err
    assert said in error
    assert "Traceback" not in error
    assert "another PointIt" not in error


def test_a_configuration_error_is_reported_before_connecting(capsys: pytest.CaptureFixture[str]) -> None:
    class Picky(Sample):
        @classmethod
        def validate_config(cls, config: SampleConfig) -> None:
            raise ConfigError(f"rate_hz: {config.rate_hz:g} is none of the recording's")

    # nobody answers at port 9: without the check this would wait for ever
    arguments = ("--user", "anna", "--connect", "tcp/127.0.0.1:9")
    assert ended(service_command(Picky), *arguments) == 2
    assert "Error: sample-one.anna: rate_hz: 50 is none of the recording's" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "patience_s"),
    [((), CLOCK_TIMEOUT_S), (("--clock", "site"), CLOCK_REQUEST_TIMEOUT_S), (("--clock", "wall"), None)],
)
def test_sites_time_is_followed_unless_wall_time_is_requested(
    arguments: tuple[str, ...], patience_s: float | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[float | None] = []

    async def serve(_launch: object, _link: object, clock_patience_s: float | None) -> int:
        asked.append(clock_patience_s)
        return 0

    monkeypatch.setattr(process, "_serve", serve)
    assert ended(service_command(Sample), "--user", "anna", *arguments) == 0
    assert asked == [patience_s]


LEAVING = """
import atexit, click, sys
from pointit.runtime.service.process import run_program

@click.command()
def command():
    print("said", end="")
    return 3

atexit.register(print, ", and more")
run_program(command, at_once={at_once})
"""


@pytest.mark.parametrize(("at_once", "said"), [(True, "said"), (False, "said, and more\n")])
def test_a_service_that_has_ended_waits_for_nothing_of_pythons(at_once: bool, said: str) -> None:
    done = python("-c", LEAVING.format(at_once=at_once))
    assert (done.returncode, done.stdout, done.stderr) == (3, said, "")


def test_full_collections_skip_objects_of_the_start(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("pointit.runtime.service.process.STARTED_S", 0.0)

    async def work() -> int:
        before = gc.get_freeze_count()
        made = [[n] for n in range(10_000)]
        for _ in range(5):
            await asyncio.sleep(0)
        return gc.get_freeze_count() - before - len(made)

    assert run_until_shutdown(work()) >= 0
