"""A whole site in this process: for scripts, notebooks and tests."""

import asyncio
import contextlib
import functools
import json
import tempfile
from collections.abc import AsyncGenerator, Callable, Generator, Mapping, Sequence
from contextlib import AbstractAsyncContextManager
from pathlib import Path
from types import TracebackType

from pointit.api.loop_thread import LoopThread
from pointit.api.requests import as_sequence
from pointit.api.site import Site
from pointit.api.sync_site import SyncSite
from pointit.launch.plan.launches import LOCALIZATIONS, Choices, check_settings, robot_of
from pointit.launch.plan.plan import read_scenario
from pointit.launch.plan.scenario_catalog import scenario_launches
from pointit.launch.run.running_scenario import ServiceGroup
from pointit.runtime.bus.memory_bus import MemoryBus
from pointit.runtime.clock import WallClock
from pointit.runtime.config.yaml_file import WrittenFloat, WrittenInt
from pointit.runtime.errors import ConfigError, PointItError, first_cause
from pointit.runtime.host.state_file import using_state_directory
from pointit.runtime.link.link import Link
from pointit.runtime.service.service import Launch, check_launches
from pointit.runtime.virtual_time import VirtualClock, is_virtual
from pointit.runtime.zenoh.zenoh_bus import ZenohBus

DEFAULT_SCENARIO = "scenario_4"


class Run:
    """A site that `pointit.run` starts: a `Site` in an `async with` block, a `SyncSite` in a `with` block."""

    def __init__(self, launches: Callable[[], list[Launch]], listen: str, *, virtual: bool) -> None:
        """Start what `launches` returns; others may join at `listen` unless it is `""`."""
        self.check = launches
        """Return the services without starting them. Raises: ConfigError: As on entering."""
        self._site = functools.partial(_running_site, launches, listen)
        self._virtual = virtual
        self._running: AbstractAsyncContextManager[Site] | None = None
        self._sync: SyncSite | None = None

    async def __aenter__(self) -> Site:
        if self._virtual and not is_virtual():
            raise ConfigError(
                "virtual time needs a loop of its own: use `with pointit.run(...)`, or run this coroutine by "
                "`pointit.run_virtually(main())`"
            )
        self._running = self._site()
        return await self._running.__aenter__()

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> bool | None:
        running = self._running
        self._running = None
        return None if running is None else await running.__aexit__(kind, error, trace)

    def __enter__(self) -> SyncSite:
        self._sync = SyncSite(self._site(), LoopThread(virtual=self._virtual))
        return self._sync

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        site = self._sync
        self._sync = None
        if site is not None:
            site.close()


def run(
    scenario: str | Path = DEFAULT_SCENARIO,
    *,
    users: int | str | Sequence[str] = 1,
    virtual: bool = False,
    seed: int = 0,
    localize: bool | str = False,
    imu: str | Sequence[str] = (),
    output: str = "",
    settings: Mapping[str, object] | None = None,
    listen: str = "",
    leds: str = "",
) -> Run:
    """Start a whole site in this process, as `pointit run` does, without a page and without stored state.

    `async with pointit.run() as site` gives a `Site` in the time of the running loop (see `run_virtually`),
    `with pointit.run() as site` a `SyncSite`. Its services end with the block.

    Args:
        scenario: a shipped one, or the path of a .yaml file.
        users: number of people, who are called `user1`, `user2` and so on, or their name or names.
        virtual: in a `with` block, time passes only while a call waits, and then at once.
        seed: of all random number generators. In virtual time the same seed gives the same run.
        localize: people are located by pointing: at lamps (True or `lamps`), or by following a robot
            (`robot` or `robot:NAME`).
        imu: IMU of the first person, or of each in turn, as for `pointit run --imu`. Others are simulated.
        output: of light, as for `pointit run --output`.
        settings: parameters of services, such as `{"selector.dwell_s": 0.8}`.
        listen: address at which other processes may join, such as `tcp/127.0.0.1:7447`; not in virtual time.
        leds: old name of `output`.

    Raises:
        ConfigError: On entering, if the scenario or a parameter cannot be used.
        ListenError: On entering, if the address is in use.
        PointItError: On leaving, if a service of the site has failed.
    """
    if isinstance(localize, str) and not LOCALIZATIONS.fullmatch(localize):
        raise ConfigError(f"localize: {localize!r} is no way to localize; write lamps, robot or robot:NAME")

    # Called in a thread, since plug-ins are imported and files are read
    def launches() -> list[Launch]:
        chosen = [_setting(name, value) for name, value in (settings or {}).items()]
        robot = robot_of(localize) if isinstance(localize, str) else None
        choices = Choices(
            seed=seed,
            localize=bool(localize),
            robot=robot,
            imu=as_sequence(imu),
            output=output or leds,
            settings=chosen,
        )
        people = users if isinstance(users, int) else as_sequence(users)
        planned = scenario_launches(read_scenario(str(scenario)), choices, people)
        check_settings(planned, choices)
        addresses = (listen,) if listen else ()
        check_launches(planned, addresses)
        return planned

    return Run(launches, listen, virtual=virtual)


def _setting(name: str, value: object) -> str:
    if isinstance(value, WrittenInt | WrittenFloat):  # as they were written
        return f"{name}={value}"
    try:
        return f"{name}={json.dumps(value)}"
    except (TypeError, ValueError) as error:
        raise ConfigError(f"settings: {name} cannot be {value!r}: {error}") from error


@contextlib.asynccontextmanager
async def _running_site(launches: Callable[[], list[Launch]], listen: str) -> AsyncGenerator[Site]:
    if listen and is_virtual():
        raise ConfigError(f"listen={listen!r}: nobody can join a site in virtual time; leave it out")
    planned = await asyncio.to_thread(launches)
    if listen:
        bus = await ZenohBus.open(Link(listen=(listen,)), patience_s=0.0)
    else:
        bus = MemoryBus()
    clock = VirtualClock() if is_virtual() else WallClock()

    # A state directory of its own, since a run must not depend on the one before
    try:
        with tempfile.TemporaryDirectory(prefix="pointit-") as folder:
            async with Site.on(bus, clock) as site:

                def on_end() -> None:
                    try:
                        group.check()
                    except Exception as error:  # noqa: BLE001 - whatever it was, the site is told
                        site.fail(_failure(error))

                group = ServiceGroup(planned, bus, clock, link=None, on_end=on_end)
                try:
                    with _failures_named(), using_state_directory(Path(folder)):
                        await group.begin()
                    yield site
                    with _failures_named():
                        group.check()
                finally:
                    await group.end()
    finally:
        await bus.close()


@contextlib.contextmanager
def _failures_named() -> Generator[None]:
    try:
        yield
    except PointItError:
        raise
    except Exception as error:
        raise _failure(error) from error


def _failure(error: BaseException) -> PointItError:
    cause = first_cause(error)
    if isinstance(cause, PointItError):
        return cause
    return PointItError(f"a service of the site has failed ({type(cause).__name__}: {cause}); see the log")
