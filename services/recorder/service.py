"""Reads every topic and presence of the site, and hands them undecoded to the thread that writes them."""

import asyncio
import functools
import logging
import tempfile
import time
from typing import ClassVar

from pointit.recording.head import make_head
from pointit.runtime.bus.contract import AnyTopic, Undecoded
from pointit.runtime.errors import ConfigError
from pointit.runtime.host.state_file import expand_home
from pointit.runtime.service.service import Context, Scope, Service
from pointit.schemas import NS_PER_S, Message
from pointit.schemas.problems import UNWRITABLE
from pointit.schemas.topics import ANY, IMU, PRESENCES, RAY, SERVICE_ALIVE, TOPICS, WRIST, Presence
from pointit.services.recorder.config import RecorderConfig
from pointit.services.recorder.sink import Arrival, Pseudonyms, Sink
from pointit.services.service_plugin import add_all_rows

log = logging.getLogger(__name__)

REPORT_S = 0.5
PROGRESS_S = 10.0
"""Periods of metrics and of lines in the log, s."""
ALONE_S = 3.0
"""Time without any other service after which the log says so."""
NOT_OF_SITE = ("recorder", "router")
"""Services that tell nothing of a session."""


class Recorder(Service[RecorderConfig]):
    """Records everything that travels on the site in a file that Foxglove and Lichtblick open, too."""

    NAME: ClassVar[str] = "recorder"
    SCOPE: ClassVar[Scope] = "site"
    CONFIG = RecorderConfig
    TIME_MAY_STEP: ClassVar[bool] = True
    IS_COMMAND: ClassVar[bool] = False
    """If True, it ends when writing fails, and reports if no service runs. If False, within a run, its health
    reports write errors."""

    @classmethod
    def validate_config(cls, config: RecorderConfig) -> None:
        """Check that a file can be made in the folder, and that there are topics to leave out."""
        folder = expand_home(config.file or "x").resolve().parent
        if not folder.is_dir():
            raise ConfigError(f"{config.file}: its folder does not exist; create it, or record elsewhere")
        try:
            tempfile.TemporaryFile(dir=folder).close()  # rights alone do not tell, such as root's
        except OSError as error:
            why = error.strerror or error
            raise ConfigError(
                f"{config.file or folder}: cannot be written ({why}); record in another folder"
            ) from error
        known = {part for topic in TOPICS for part in topic.key.split("/") if "{" not in part}
        for part in config.without:
            if part not in known:
                raise ConfigError(
                    f"without {part}: no topic is called so; choose from {', '.join(sorted(known))}"
                )

    def __init__(self, config: RecorderConfig, context: Context) -> None:
        super().__init__(config, context)
        add_all_rows()  # their services may run in other processes
        now_ns = self.clock.now_ns()
        path = expand_home(config.file or f"pointit-{self.bus.site}-{now_ns // NS_PER_S}.mcap")
        head = make_head(
            self.bus.site, now_ns, seed=config.seed, without=config.without, pseudonyms=config.pseudonyms
        )
        self._sink = Sink(path.resolve(), head, Pseudonyms() if config.pseudonyms else None)
        self._began_s = time.monotonic()
        self._reported: set[tuple[str, str]] = set()
        self._others: set[str] = set()
        self._alone_s: float | None = self._began_s if self.IS_COMMAND else None
        """Monotonic time since which no other service is there. None if there is one, or it was reported."""
        self.has_received = False
        """True if anything of the site has been received."""
        for presence in PRESENCES:
            self.bus.watch(presence, functools.partial(self._on_presence, presence))
        for topic in TOPICS:
            if not set(config.without) & set(topic.key.split("/")):
                name = config.person if config.person and topic in (IMU, WRIST, RAY) else ANY
                self.bus.tap(topic, functools.partial(self._on_message, topic), name)
        log.info("recording to %s", self._sink.path)

    @property
    def problem(self) -> str:
        """Return an error message if nothing more is written, else `""`."""
        return self._sink.problem

    async def run(self) -> None:
        """Report until cancelled."""
        reported_s = self._began_s
        try:
            while not (self.IS_COMMAND and self.problem):
                await asyncio.sleep(REPORT_S)
                self._report()
                if time.monotonic() - reported_s >= PROGRESS_S:
                    reported_s = time.monotonic()
                    log.info("%s so far", self._figures())
        finally:
            await self._sink.close()
            self._report()
            log.info("%s in %s", self._figures(), self._sink.path)

    def _figures(self) -> str:
        sink = self._sink
        lasted_s = time.monotonic() - self._began_s
        return f"recorded {sink.entries} messages, {sink.size / 1e6:.2f} MB, {lasted_s:.0f} s"

    def _report(self) -> None:
        sink = self._sink
        self.bus.set_metric("recorded", float(sink.entries), "messages")
        self.bus.set_metric("size", sink.size / 1e6, "MB")
        self._warn(UNWRITABLE, sink.problem)
        for cause, count in list(sink.left_out.items()):
            self._warn("left-out", f"{count} messages are not in the recording: {cause}", cause)
        for each in self.bus.problems:
            if (each.code, each.subject) not in self._reported:
                self._reported.add((each.code, each.subject))
                log.warning("not everything is recorded: %s", each.sentence)
        if self._alone_s is not None and time.monotonic() - self._alone_s >= ALONE_S:
            self._alone_s = None
            log.warning(
                "no service runs on site %s%s: `pointit doctor` tells of problems, Ctrl-C ends the recording",
                self.bus.site,
                " any more" if self.has_received else "",
            )

    def _warn(self, code: str, sentence: str, subject: str = "") -> None:
        """Show `sentence` in health, and log it if it is a new kind of trouble."""
        if sentence and (code, subject) not in self._reported:
            log.error("%s", sentence)
            self._reported.add((code, subject))
        self.bus.warn(code, sentence, subject)

    def _on_message(self, topic: AnyTopic, message: Message | Undecoded, name: str) -> None:
        self._should_record(name)
        self._sink.add(Arrival(self.clock.now_ns(), topic, name, message))

    def _on_presence(self, presence: Presence, name: str, *, present: bool) -> None:
        if self._should_record(name) and presence is SERVICE_ALIVE:
            (self._others.add if present else self._others.discard)(name)
            if self._others:
                self._alone_s = None
            elif not present and self.IS_COMMAND:
                self._alone_s = time.monotonic()
        self._sink.add(Arrival(self.clock.now_ns(), presence, name, present))

    def _should_record(self, name: str) -> bool:
        is_of_site = not name.startswith(NOT_OF_SITE)
        self.has_received = self.has_received or is_of_site
        return is_of_site


SERVICE = Recorder
