"""Receives every topic and presence of the site, and passes them undecoded to the thread that writes them."""

import asyncio
import functools
import logging
import tempfile
import time
from typing import ClassVar

from pointit.recording.head import make_head
from pointit.runtime.bus.contract import AnyTopic, Undecoded
from pointit.runtime.errors import ConfigError
from pointit.runtime.host.advised_commands import advised_commands
from pointit.runtime.host.state_file import expand_home
from pointit.runtime.service.service import Context, Scope, Service
from pointit.schemas import NS_PER_S, Message
from pointit.schemas.problems import UNWRITABLE
from pointit.schemas.text import system_reason
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
        """Check that a file can be created in the folder, and that the topics to leave out exist."""
        folder = expand_home(config.file or "x").resolve().parent
        if not folder.is_dir():
            raise ConfigError(f"{config.file}: its folder does not exist; create it, or record elsewhere")
        try:
            tempfile.TemporaryFile(dir=folder).close()  # permissions alone do not tell, such as root's
        except OSError as error:
            place = config.file or folder
            reason = system_reason(error)
            raise ConfigError(f"{place}: cannot be written ({reason}); record in another folder") from error

        # Each part of a key except placeholders selects topics
        known: set[str] = set()
        for topic in TOPICS:
            known.update(part for part in topic.key.split("/") if "{" not in part)
        for part in config.without:
            if part not in known:
                names = ", ".join(sorted(known))
                raise ConfigError(f"without {part}: no topic is called so; choose from {names}")

    def __init__(self, config: RecorderConfig, context: Context) -> None:
        super().__init__(config, context)
        add_all_rows()  # their services may run in other processes

        # The file, and its thread
        now_ns = self.clock.now_ns()
        path = expand_home(config.file or f"pointit-{self.bus.site}-{now_ns // NS_PER_S}.mcap")
        head = make_head(
            self.bus.site, now_ns, seed=config.seed, without=config.without, pseudonyms=config.pseudonyms
        )
        pseudonyms = Pseudonyms() if config.pseudonyms else None
        self._sink = Sink(path.resolve(), head, pseudonyms)

        # Reports to the operator
        self._began_s = time.monotonic()
        self._reported: set[tuple[str, str]] = set()
        self._others: set[str] = set()
        self._alone_s: float | None = self._began_s if self.IS_COMMAND else None
        """Monotonic time since which no other service is present. None: there is one, or it was reported."""
        self.has_received = False
        """True if anything of the site has been received."""

        # All topics. With `person`, motion data only of that person
        for presence in PRESENCES:
            self.bus.watch(presence, functools.partial(self._on_presence, presence))
        for topic in TOPICS:
            if set(config.without) & set(topic.key.split("/")):
                continue
            name = ANY
            if config.person and topic in (IMU, WRIST, RAY):
                name = config.person
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
                self._report_state()
                if time.monotonic() - reported_s >= PROGRESS_S:
                    reported_s = time.monotonic()
                    log.info("%s so far", self._progress())
        finally:
            await self._sink.close()
            self._report_state()
            log.info("%s in %s", self._progress(), self._sink.path)

    def _progress(self) -> str:
        """Return number, size and duration of the recording up to now, in words."""
        sink = self._sink
        duration_s = time.monotonic() - self._began_s
        return f"recorded {sink.entries} messages, {sink.size / 1e6:.2f} MB, {duration_s:.0f} s"

    def _report_state(self) -> None:
        """Report metrics and problems, and log each kind of problem once."""
        sink = self._sink
        self.bus.set_metric("recorded", float(sink.entries), "messages")
        self.bus.set_metric("size", sink.size / 1e6, "MB")

        # Problems of the file, then those of receiving
        self._warn(UNWRITABLE, sink.problem)
        for cause, count in list(sink.left_out.items()):
            self._warn("left-out", f"{count} messages are not in the recording: {cause}", cause)
        for problem in self.bus.problems:
            key = (problem.code, problem.subject)
            if key not in self._reported:
                self._reported.add(key)
                log.warning("not everything is recorded: %s", problem.sentence)

        # Log once that no service runs
        if self._alone_s is not None and time.monotonic() - self._alone_s >= ALONE_S:
            self._alone_s = None
            log.warning(
                "no service runs on site %s%s: %s finds out why, Ctrl-C ends the recording",
                self.bus.site,
                " any more" if self.has_received else "",
                advised_commands().command("pointit doctor"),
            )

    def _warn(self, code: str, sentence: str, subject: str = "") -> None:
        """Show `sentence` in health, and log it if it is a new kind of problem."""
        if sentence and (code, subject) not in self._reported:
            log.error("%s", sentence)
            self._reported.add((code, subject))
        self.bus.warn(code, sentence, subject)

    def _on_message(self, topic: AnyTopic, message: Message | Undecoded, name: str) -> None:
        self._note_sender(name)
        self._sink.add(Arrival(self.clock.now_ns(), topic, name, message))

    def _on_presence(self, presence: Presence, name: str, *, present: bool) -> None:
        is_of_session = self._note_sender(name)
        if is_of_session and presence is SERVICE_ALIVE:
            self._note_service(name, present=present)
        self._sink.add(Arrival(self.clock.now_ns(), presence, name, present))

    def _note_sender(self, name: str) -> bool:
        """Return True if `name` is of the session, from which something has been received then."""
        is_of_session = not name.startswith(NOT_OF_SITE)
        self.has_received = self.has_received or is_of_session
        return is_of_session

    def _note_service(self, name: str, *, present: bool) -> None:
        """Note the presence of another service, and since when there is none."""
        if present:
            self._others.add(name)
        else:
            self._others.discard(name)
        if self._others:
            self._alone_s = None
        elif not present and self.IS_COMMAND:
            self._alone_s = time.monotonic()


SERVICE = Recorder
