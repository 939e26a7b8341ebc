"""Process of services: options, configuration, session, signals, exit code."""

import asyncio
import contextlib
import errno
import gc
import logging
import os
import signal
import sys
import threading
from collections.abc import Callable, Coroutine, Generator
from pathlib import Path
from typing import Any, Literal, NoReturn

import click

from pointit.runtime.bus.site_clock import SiteClock
from pointit.runtime.clock import Clock, WallClock
from pointit.runtime.config.config import Config, Layers
from pointit.runtime.config.environment_variables import LOG_FORMAT, check_spelling, environment_prefix
from pointit.runtime.config.parameters import iter_parameters
from pointit.runtime.config.yaml_file import read_yaml
from pointit.runtime.errors import EXIT_USAGE, ConfigError, PointItError, first_cause
from pointit.runtime.host.text_output import assume_dumb_terminal, escape_unencodable
from pointit.runtime.host.threads import exit_now, has_running_threads
from pointit.runtime.link.link import Link
from pointit.runtime.link.options import link_of, link_options
from pointit.runtime.machine import this_machine
from pointit.runtime.service.instance_takeover import claim_names
from pointit.runtime.service.logs import LOG_FORMATS, setup_logging
from pointit.runtime.service.service import AnyService, Launch, Scope, check_launches, run_services
from pointit.runtime.zenoh.zenoh_bus import ZenohBus
from pointit.schemas import SchemaError
from pointit.schemas.printable import plain
from pointit.schemas.system import check_user
from pointit.schemas.text import hide_secrets
from pointit.schemas.topics import SERVICE_ALIVE, check_name

log = logging.getLogger(__name__)

EXIT_FAILED = 1
END_TIMEOUT_S = 5.0
"""Time from a signal until the process is killed, s. Ending takes well below 2 s."""
MAX_CROWDING = 12.0
"""Maximum factor of `END_TIMEOUT_S` for machines on which many processes share each core."""
SWITCH_INTERVAL_S = 0.0001
"""Python's thread switch interval: with the default, a busy loop delays Zenoh's threads by tens of ms."""

STARTED_S = 5.0
"""Time after the start at which existing objects are frozen, s. By then a process has created its permanent
objects. Full garbage collections, which block a process of 20 users for about 50 ms, skip frozen objects."""
EXIT_FAULT = 70
"""An unforeseen error (sysexits' EX_SOFTWARE)."""
SETS = "set_"
"""Prefix of the internal names of options that set a parameter."""
CLOCK_TIMEOUT_S = 0.3
"""Timeout for the site's simulated time before a service starts, s. It usually takes ms."""
CLOCK_REQUEST_TIMEOUT_S = 2.0
"""The same if the command line requires simulated time, s. Many processes may start at once."""


def exit_with_parent() -> None:
    """End this process when its standard input closes: no child survives a killed parent."""

    def wait() -> None:
        while os.read(sys.stdin.fileno(), 1024):
            pass
        os.kill(this_machine().process_id, signal.SIGTERM)

    threading.Thread(target=wait, name="parent watch", daemon=True).start()


def run_until_shutdown(work: Coroutine[Any, Any, int]) -> int:
    """Run `work` until it ends or Ctrl-C or SIGTERM arrives. Return its exit code.

    A signal cancels the work. The exit code is then 0, since a requested end is no failure. Where Ctrl-C
    would kill the process (`SIG_DFL`), a second one is ignored.
    """
    sys.setswitchinterval(SWITCH_INTERVAL_S)
    runner = asyncio.Runner()
    with _cut_off(runner.get_loop()) as cut_off, runner:  # closing the runner waits for threads
        return runner.run(_until_signal(work, cut_off))


async def _until_signal(work: Coroutine[Any, Any, int], cut_off: threading.Timer) -> int:
    loop = asyncio.get_running_loop()
    task = loop.create_task(work, name="main")
    loop.call_later(STARTED_S, gc.freeze)
    is_ending = False

    def request_end() -> None:
        nonlocal is_ending
        if is_ending:
            return  # a second Ctrl-C must not cancel the clean-up
        is_ending = True
        cut_off.start()
        task.cancel()

    with _handled_signals(loop, request_end, lambda: is_ending):
        try:
            return await task
        except asyncio.CancelledError:
            if not is_ending:
                raise
            return 0
        except BaseExceptionGroup as group:
            raise first_cause(group) from group


@contextlib.contextmanager
def _cut_off(loop: asyncio.AbstractEventLoop) -> Generator[threading.Timer]:
    """Yield a timer that, once started, ends the process if the body takes too long to end."""
    has_ended = threading.Event()

    def end() -> None:
        # a process with a small share of a core is slow, not stuck
        timeout_s = END_TIMEOUT_S * crowding()
        if has_ended.wait(timeout_s - END_TIMEOUT_S):
            return
        tasks = asyncio.all_tasks(loop)
        names = ", ".join(sorted(task.get_name() for task in tasks))
        message = f"did not end within {timeout_s:.1f} s: {names}"
        sys.stderr.write(f"Error: {message}\n")
        sys.stderr.flush()
        os._exit(EXIT_FAILED)

    timer = threading.Timer(END_TIMEOUT_S, end)
    timer.daemon = True
    try:
        yield timer
    finally:
        timer.cancel()
        has_ended.set()


def crowding() -> float:
    """Return the number of processes that share a core of this machine, from 1 to `MAX_CROWDING`."""
    try:
        load = os.getloadavg()[0]
    except (AttributeError, OSError):  # Windows has none
        return 1.0
    return min(MAX_CROWDING, max(1.0, load / (os.cpu_count() or 1)))


@contextlib.contextmanager
def _handled_signals(
    loop: asyncio.AbstractEventLoop, request_end: Callable[[], None], is_ending: Callable[[], bool]
) -> Generator[None]:
    numbers = (signal.SIGINT, signal.SIGTERM)
    previous = {number: signal.getsignal(number) for number in numbers}
    try:
        for number in numbers:
            loop.add_signal_handler(number, request_end)
    except NotImplementedError:  # Windows: asyncio.run turns Ctrl-C into a cancellation by itself
        yield
        return
    try:
        yield
    finally:
        for number, handler in previous.items():
            loop.remove_signal_handler(number)
            would_kill = number == signal.SIGINT and handler is signal.SIG_DFL
            if would_kill and is_ending():
                # another one must not kill the process before it reports its end
                signal.signal(number, signal.SIG_IGN)
            elif handler is not None:  # a handler that Python did not set
                signal.signal(number, handler)  # a shell starts background processes with SIGINT ignored


def run_program(command: click.Command, *, at_once: bool = False) -> NoReturn:
    """Run a click command as the only work of this process, see `run_command`. Exit without joining threads.

    `at_once`: skip `atexit` handlers of others, too.
    """
    escape_unencodable()
    assume_dumb_terminal()
    try:
        run_command(command)
    except SystemExit as end:
        if at_once or has_running_threads():
            exit_now(end.code if isinstance(end.code, int) else EXIT_FAULT)
        raise


def run_command(command: click.Command, arguments: list[str] | None = None) -> NoReturn:
    """Run a click command. An error becomes one sentence on standard error and an exit code.

    0 done, or ended as requested; 1 it failed (no answer, an address is in use); 2 an argument, a file or a
    variable is wrong; 70 a fault of the program, whose traceback goes to the log; 130 Ctrl-C before work.
    """
    try:
        result = command.main(args=arguments, standalone_mode=False)
    except click.exceptions.Abort:
        sys.exit(130)
    except click.ClickException as error:
        error.show()
        sys.exit(error.exit_code)
    except PointItError as error:
        message = plain(hide_secrets(str(error)))
        click.echo(f"Error: {message}", err=True)
        sys.exit(EXIT_USAGE if isinstance(error, ConfigError | SchemaError) else EXIT_FAILED)
    except Exception as error:
        if isinstance(error, OSError) and error.errno == errno.ENOSPC:
            click.echo(f"Error: the disk is full: {error.filename or 'the output'} is cut off", err=True)
            sys.exit(EXIT_FAILED)
        # Anything else is a mistake of ours, of which users see one sentence, and developers the log
        log.critical("fault of the program", exc_info=error)
        fault = plain(hide_secrets(f"{type(error).__name__}: {error}"))
        click.echo(f"Error: a fault of PointIt itself ({fault}), see the log", err=True)
        sys.exit(EXIT_FAULT)
    sys.exit(result if isinstance(result, int) else 0)


def service_command(service: type[AnyService], plugin: str = "") -> click.Command:
    """Return the command that runs `service`, with one option for each of its parameters.

    `plugin`: the service's name in messages if it belongs to another package.
    """

    def callback(**options: Any) -> int:
        setup_logging(options["log_level"])
        user = options.get("user") or ""
        if user:
            check_user(user)
        name = options.get("name") or ""
        if name:
            check_name(name)

        # The options of parameters are those with a path
        values: dict[tuple[str, ...], str | None] = {}
        for option, value in options.items():
            path = _parameter_path(option)
            if path:
                values[path] = value
        files = [options["config"]] if options["config"] else []
        config = load_config(service, files, values)

        # Whatever is wrong is reported before a session is opened
        link = link_of(options["site"], options["connect"], options["listen"])
        launch = Launch(service=service, config=config, user=user, name=name, plugin=plugin, is_alone=True)
        check_launches([launch], link.addresses)
        if options["while_parent_lives"]:
            exit_with_parent()
        # With the default, a site of wall time must not wait long for a time that nobody publishes
        timeout_s: float | None = None
        if options["clock"] == "site":
            source = click.get_current_context().get_parameter_source("clock")
            is_default = source is click.core.ParameterSource.DEFAULT
            timeout_s = CLOCK_TIMEOUT_S if is_default else CLOCK_REQUEST_TIMEOUT_S
        return run_until_shutdown(_serve(launch, link, timeout_s))

    scope = "several" if service.SEVERAL else service.SCOPE
    about = (service.__doc__ or "").strip()
    return _command(service.NAME, scope, about, service.CONFIG, callback)


def unavailable_command(
    name: str, scope: Scope, about: str, config: type[Config], error: ConfigError
) -> click.Command:
    """Return the command of a service that is not installed: a help text, and `error` when run."""

    def callback(**_options: Any) -> NoReturn:
        raise error

    return _command(name, scope, about, config, callback)


def _command(
    name: str,
    scope: Scope | Literal["several"],
    about: str,
    config: type[Config],
    callback: Callable[..., int],
) -> click.Command:
    file_option = click.Option(
        ["--config"], type=click.Path(path_type=Path), help="YAML file with parameters of this service"
    )
    clock_option = click.Option(
        ["--clock"],
        type=click.Choice(["site", "wall"]),
        default="site",
        help="the simulated time that the site publishes (wall time while there is none), or wall time",
    )
    parent_option = click.Option(["--while-parent-lives"], is_flag=True, hidden=True)
    parameters: list[click.Parameter] = [
        file_option,
        *link_options(),
        clock_option,
        *log_options(),
        parent_option,
    ]

    # The help shows them in this order: what a service cannot start without is the first
    if scope == "user":
        user_option = click.Option(["--user"], required=True, help="owner of the service, the key's {user}")
        parameters.insert(0, user_option)
    if scope == "several":
        parameters.insert(0, click.Option(["--name"], help="its name, where a site has several of its kind"))
    prefix = environment_prefix(name)
    note = f"Every parameter may also stand in a YAML file (--config) or in a variable {prefix}<PARAMETER>."
    about = f"{about}\n\n{note}"
    return _ServiceCommand(name, config=config, callback=callback, params=parameters, help=about)


class _ServiceCommand(click.Command):
    """The command of a service: `params`, and an option for each parameter of its configuration.

    Plug-ins are imported if the arguments name them, all of them for the help.
    """

    def __init__(self, name: str, *, config: type[Config], **attributes: Any) -> None:
        super().__init__(name, **attributes)
        self._config = config
        self._named: set[str] | None = None

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Parse `args`, with the options of the plug-ins that they name."""
        if not {*ctx.help_option_names}.isdisjoint(args):
            return super().parse_args(ctx, args)
        options = [word[2:] for word in args if word.startswith("--")]
        self._named = {option.partition(".")[0] for option in options}
        try:
            return super().parse_args(ctx, [*args])
        except click.NoSuchOption:
            self._named = None  # the error suggests an option of any
            return super().parse_args(ctx, args)

    def get_params(self, ctx: click.Context) -> list[click.Parameter]:
        """Return all options."""
        options: list[click.Parameter] = []
        for leaf in iter_parameters(self._config, plugins=self._named):
            about = leaf.field.description or ""
            option = click.Option(
                [SETS + "__".join(leaf.path), leaf.option],
                metavar=f"<{leaf.type_name}>",
                help=f"{about}  [default: {leaf.default}]",
            )
            options.append(option)

        # Between the options of all services and --help, which click appends
        common = super().get_params(ctx)
        own_count = len(self.params)
        return [*common[:own_count], *options, *common[own_count:]]


def load_config(
    service: type[AnyService], files: list[Path], options: dict[tuple[str, ...], str | None]
) -> Config:
    """Return the configuration of `service` from files, environment and options.

    Raises:
        ConfigError: names source, field and value.
    """
    layers = Layers(service.CONFIG.REPLACED)
    for file in files:
        layers.add(read_yaml(file), str(file))
    for variable in os.environ:
        check_spelling(variable, [service.NAME])
    layers.add_environment(os.environ, environment_prefix(service.NAME))
    for path, text in options.items():
        if text is not None:
            option = ".".join(path).replace("_", "-")
            layers.add_text(path, text, f"--{option}")
    return layers.build(service.CONFIG)


def log_options() -> list[click.Parameter]:
    """Return the options for the level and the form of logs."""
    level = click.Option(
        ["--log-level"],
        type=click.Choice(["debug", "info", "warning", "error"]),
        default="info",
        help="least severe level that is logged",
    )
    form = click.Option(
        ["--log-format"],
        type=click.Choice(LOG_FORMATS),
        callback=_choose_log_format,
        expose_value=False,
        is_eager=True,
        help="format of the log if standard error is not a terminal; also set by the variable "
        f"{LOG_FORMAT}  [default: plain]",
        show_default=False,
    )
    return [level, form]


def _choose_log_format(ctx: click.Context, param: click.Parameter, value: str | None) -> None:
    """Set the variable that `setup_logging` reads, and that processes started from here inherit."""
    del ctx, param
    if value is not None:
        os.environ[LOG_FORMAT] = value


async def _serve(launch: Launch, link: Link, clock_timeout_s: float | None) -> int:
    if link.listen:
        link = Link(site=link.site, listen=link.listen)
    bus = await ZenohBus.open(link)
    try:
        clock, _ = await asyncio.gather(_choose_clock(bus, clock_timeout_s), _claim_names(bus, launch))
        log.info("%s runs on site %s", launch.instance, link.site)
        await run_services([launch], bus, clock)
    finally:
        await bus.close()
    return 0


async def _claim_names(bus: ZenohBus, launch: Launch) -> None:
    if launch.is_single and bus.link.connect:
        own = f"another --user than {launch.user}" if launch.user else "a --name of its own"
        advice = f"give this one {own}, or end the other one first"
        await claim_names(bus, SERVICE_ALIVE, {launch.instance}, advice)


async def _choose_clock(bus: ZenohBus, timeout_s: float | None) -> Clock:
    if timeout_s is None:
        return WallClock()
    clock = SiteClock(bus)
    if not await clock.wait_for_tick(timeout_s) and timeout_s > CLOCK_TIMEOUT_S:
        log.warning("this site publishes no simulated time; wall time is used until it does")
    return clock


def _parameter_path(parameter: str) -> tuple[str, ...]:
    if not parameter.startswith(SETS):
        return ()
    return tuple(parameter.removeprefix(SETS).split("__"))
