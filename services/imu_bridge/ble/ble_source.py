"""The link to one wrist by Bluetooth: found by a scan, connected again, watched for silence.

No core: it waits for a radio.
"""

import asyncio
import contextlib
import functools
import logging
from collections.abc import Callable, Generator, Sequence

from pointit.runtime.clock import Clock, wait_up_to
from pointit.runtime.config.parameters import set_option
from pointit.runtime.config.plugins import Discover, FoundDevice
from pointit.runtime.errors import ConfigError
from pointit.runtime.service.plugin_guard import WarningSink
from pointit.schemas import Feedback
from pointit.schemas.text import first_of
from pointit.services.imu_bridge.ble.radio import (
    CONNECT_S,
    END_S,
    Advertisement,
    client_of,
    describe_error,
    require_bleak,
    scanning,
)
from pointit.services.imu_bridge.ble.wrist import (
    BleConfig,
    ButtonChange,
    ButtonGestures,
    Connection,
    Gesture,
    Kind,
    LinkError,
    Wrist,
)
from pointit.services.imu_bridge.sources import (
    Deliver,
    Disconnected,
    Item,
    Press,
    RawReading,
    Reading,
    Reconnected,
    Signal,
)

log = logging.getLogger(__name__)

SCAN_S = 5.0
"""Duration of a scan, s. After one without a result there is a warning, and the next begins."""
COMPARE_S = 1.0
"""Time for which further wrists are searched when the first is found and no address was given, s."""
NAMED = 5
"""Number of wrists within reach that a warning names."""
SILENCE_S = 2.0
"""Time without a reading after which a connected wrist is configured again, then reset, s."""
ASK_S = 60.0
"""Period of asking for the battery, s."""
STOP_S = 0.3
"""Time to stop the stream at the end, s; imu-bridge gives a source one second in all."""
FIRST_WAIT_S = 0.2
MAX_WAIT_S = 5.0
"""Waits between connections: doubled from the first to the last while they are short."""
MANY = 10
"""Number of notifications without a reading from which a wrist is not called silent."""
SHORT_S = 10.0
"""Connections below this count as short, s."""
SERIAL_NUMBER = "00002a25-0000-1000-8000-00805f9b34fb"


class TimedButton:
    """Gestures of a button in the time of the event loop."""

    def __init__(self, on_gesture: Callable[[Gesture], None]) -> None:
        """Call `on_gesture` for each gesture as soon as it is complete."""
        self._on_gesture = on_gesture
        self._gestures = ButtonGestures()
        self._timer: asyncio.TimerHandle | None = None

    def change(self, *, is_down: bool) -> None:
        """Handle a change of the button."""
        now_s = asyncio.get_running_loop().time()
        gesture = self._gestures.down(now_s) if is_down else self._gestures.up(now_s)
        self._deliver_gesture(gesture)

    def release(self) -> None:
        """Forget what is pending, such as when the connection ends."""
        self._gestures = ButtonGestures()
        self._schedule()

    def _deliver_gesture(self, gesture: Gesture | None) -> None:
        self._schedule()
        if gesture is not None:
            self._on_gesture(gesture)

    def _schedule(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
        due_s = self._gestures.due_s
        loop = asyncio.get_running_loop()
        self._timer = None if due_s is None else loop.call_at(due_s, self._on_due)

    def _on_due(self) -> None:
        gesture = self._gestures.wait(asyncio.get_running_loop().time())
        self._deliver_gesture(gesture)


class WristSearch:
    """Finds the wrist that is wanted, or the first one, and from then on that one alone."""

    def __init__(
        self, kind: Kind, config: BleConfig, warnings: WarningSink, warn: Callable[[str], None]
    ) -> None:
        """Search for wrists of a `kind`; `warn` shows why none is found."""
        self._kind = kind
        self._config = config
        self._warnings = warnings
        self._warn = warn
        self._wanted = config.sensor.lower()
        self.used = ""
        """Identity of the wrist that was used first, or `""`. No other one replaces it."""
        self.refused: set[str] = set()
        """Identities of wrists with another serial number than the wanted one."""

    async def find(self) -> Advertisement:
        """Return the first advertisement of the wrist, however long that takes."""
        while True:
            advertisements: dict[str, Advertisement] = {}
            next_advertisement: asyncio.Future[Advertisement] = asyncio.get_running_loop().create_future()
            listener = functools.partial(self._on_advertisement, advertisements, next_advertisement)
            with contextlib.suppress(TimeoutError):
                async with scanning(self._config.adapter, listener), asyncio.timeout(SCAN_S):
                    advertisement = await next_advertisement
                    if not (self.used or self._is_address):
                        await asyncio.sleep(COMPARE_S)
                        self._warn_others(advertisement, advertisements)
                    return advertisement
            self.refused.clear()
            self._warn(self._absence_message(advertisements))

    def _on_advertisement(
        self,
        advertisements: dict[str, Advertisement],
        next_advertisement: asyncio.Future[Advertisement],
        advertisement: Advertisement,
    ) -> None:
        is_wanted_address = advertisement.address.lower() == self._wanted
        if not is_wanted_address and not self._kind.includes(advertisement):
            return
        identity = self.identify(advertisement)
        advertisements[identity] = advertisement
        if next_advertisement.done() or identity in self.refused:
            return
        if self._is_eligible(advertisement):
            next_advertisement.set_result(advertisement)

    def identify(self, advertisement: Advertisement) -> str:
        """Return the identity of a wrist in lower case: its address, or the identifier of its kind."""
        return self._kind.identify(advertisement).lower()

    def is_named(self, advertisement: Advertisement) -> bool:
        """Return True if the wanted text is its identity, its address, or begins its name."""
        wanted = self._wanted
        if not wanted:
            return False
        if wanted in (self.identify(advertisement), advertisement.address.lower()):
            return True
        return advertisement.name.lower().startswith(wanted)

    def _is_eligible(self, advertisement: Advertisement) -> bool:
        """Return True unless it cannot be the wanted one. Serial numbers are known when it is connected."""
        if self.used:
            return self.identify(advertisement) == self.used
        if not self._wanted:
            return True
        if self._kind.has_serial_number and not self._is_address:
            kind_names = tuple(name.lower() for name in self._kind.names)
            if not self._wanted.startswith(kind_names):  # it may be a serial number
                return True
        return self.is_named(advertisement)

    @property
    def _is_address(self) -> bool:
        """Return True if the wanted wrist is named by its address."""
        return ":" in self._wanted or self._wanted.count("-") == 4

    def _warn_others(self, used: Advertisement, advertisements: dict[str, Advertisement]) -> None:
        """Warn if other wrists are as eligible as `used`. A serial number is unique."""
        used_identity = self.identify(used)
        others: list[str] = []
        for identity, advertisement in advertisements.items():
            if identity != used_identity and self._is_eligible(advertisement):
                others.append(advertisement.label)

        # A wanted text that is no beginning of a name is an address or a number, which fits one wrist alone
        is_named = self._wanted != "" and used.name.lower().startswith(self._wanted)
        is_ambiguous = is_named or not self._wanted
        message = ""
        if others and is_ambiguous:
            kind = self._kind
            option = set_option("imu-bridge", f"{kind.plugin}.sensor", "ADDRESS")
            message = (
                f"several wrists of the kind {kind.label} are within reach: {used.label} is used, not "
                f"{first_of(others, NAMED)}; give the address of the right one by {option}"
            )
        self._warnings.warn("sensors", message)

    def _absence_message(self, advertisements: dict[str, Advertisement]) -> str:
        label = self._kind.label
        wanted = self._config.sensor
        if advertisements and self.used:
            wanted = self.used
        absence = f"no {label} is heard"
        if wanted:
            absence = f"{label} {wanted} is not heard"
        labels = [advertisement.label for advertisement in advertisements.values()]
        others = first_of(labels, NAMED) or "none"
        if wanted == self.used != "":
            option = set_option("imu-bridge", f"{self._kind.plugin}.sensor", "ADDRESS")
            others += f"; to use one of them: {option}"
        return (
            f"{absence}; searching: switch it on, bring it near, and disconnect it from other programs "
            f"and phones (others within reach: {others})"
        )


@contextlib.contextmanager
def _logging_failure(action: str) -> Generator[None]:
    """Log a failed command to a wrist. A lost wrist is reported by its link, so this is no warning."""
    try:
        yield
    except Exception as error:  # noqa: BLE001 - of any system's radio
        log.debug("cannot %s: %s", action, describe_error(error))


class BleSource:
    """A source of orientations whose wrist is linked by Bluetooth Low Energy."""

    def __init__(self, wrist: Wrist, config: BleConfig, clock: Clock, warnings: WarningSink) -> None:
        self._wrist = wrist
        self._config = config
        self._wanted = config.sensor.lower()
        self._clock = clock
        self._warnings = warnings
        self._search = WristSearch(wrist.kind, config, warnings, self._warn)
        self._is_open = False
        """True while items are delivered."""
        self._was_open = False
        self._is_paused = False
        """True while it is silent for a reason that a person must remove."""
        self._received_s = 0.0
        self._useless = 0
        """Notifications without a reading since the last one with."""
        self._is_warned = False
        self._shorts = 0
        """Short connections one behind the other."""
        self._button = TimedButton(self._on_gesture)
        self._cue: Sequence[tuple[float, bytes]] = ()
        self._cue_came = asyncio.Event()

    def cue(self, feedback: Feedback) -> None:
        """Play `feedback` on the wrist at once, in place of an earlier one. Does not block."""
        if not self._is_open:
            return
        commands = self._wrist.cue(feedback)
        if commands:
            self._cue = commands
            self._cue_came.set()

    async def run(self, deliver: Deliver) -> None:
        """Deliver readings until cancelled."""
        self._deliver = deliver
        loop = asyncio.get_running_loop()
        label = self._wrist.kind.label
        wait_s = FIRST_WAIT_S
        while True:
            # One connection, from the search until it is lost or refused
            lasted_s = pause_s = 0.0
            try:
                advertisement = await self._search.find()
                label = f"{self._wrist.kind.label} {advertisement.address}"
                began_s = loop.time()
                try:
                    await self._use_wrist(advertisement)
                finally:
                    lasted_s = loop.time() - began_s
            except LinkError as error:
                problem = f"{label} {error}"
                pause_s = error.pause_s
            except Exception as error:  # noqa: BLE001 - errors of bleak and its backends, which differ by system
                problem = f"{label} cannot be used: {describe_error(error)}"
            else:
                problem = f"{label} is another one"

            # A wrist that drops each connection at once is left alone for longer and longer
            if lasted_s < SHORT_S:
                self._shorts += 1
                wait_s = min(2.0 * wait_s, MAX_WAIT_S)
            else:
                self._shorts = 0
                wait_s = FIRST_WAIT_S

            # Report it once: `Disconnected` has the reason, too
            times = f", {self._shorts} times now" if self._shorts > 2 else ""
            after = f" after {pause_s:.0f} s" if pause_s else ""
            problem = f"{problem}{times}; searching again{after}"
            if self._was_open:
                self._warn("")
                self._was_open = False
                deliver(Disconnected(problem))
            else:
                self._warn(problem)
            await asyncio.sleep(max(wait_s, pause_s))

    async def _use_wrist(self, advertisement: Advertisement) -> None:
        """Connect, and deliver until the connection is lost. Returns if it is not the wanted wrist."""
        lost = self._lost = asyncio.Event()
        self._failure = LinkError("has lost the connection: bring it near, or charge it")
        client = client_of(advertisement.device, self._config.adapter, lost.set)
        connection = Connection(client)
        is_wanted = False
        try:
            # Connect, listen before the wrist is started, and configure it unless it has run on
            async with asyncio.timeout(CONNECT_S):
                await client.connect()
                if not await self._is_wanted(advertisement, connection):
                    self._search.refused.add(self._search.identify(advertisement))
                    return
                is_wanted = True
                self._search.used = self._search.identify(advertisement)
                self._wrist.begin(advertisement.address)
                for characteristic in self._wrist.notifications:
                    on_data = functools.partial(self._on_data, characteristic)
                    await client.start_notify(characteristic, on_data)
                runs_on = await self._wrist.resume(connection)
                if not runs_on:
                    await self._wrist.configure(connection)

            # Deliver from here on. Silence counts from now: a wrist takes a moment to start.
            self._received_s = asyncio.get_running_loop().time()
            self._start_delivery(keeps_yaw=runs_on)
            if advertisement.rssi_dbm is not None:
                self._deliver(Signal(advertisement.rssi_dbm))
            await self._stream(connection)
        except asyncio.CancelledError:  # only then: one that runs on keeps its yaw for the next connection
            with _logging_failure("stop the stream"):
                async with asyncio.timeout(STOP_S):
                    if is_wanted and not lost.is_set():
                        await self._wrist.stop(connection)
            raise
        finally:
            self._is_open = False
            self._button.release()
            with _logging_failure("disconnect"):
                async with asyncio.timeout(END_S):
                    await client.disconnect()

    def _start_delivery(self, *, keeps_yaw: bool) -> None:
        self._is_open = self._was_open = True
        self._is_paused = False
        self._deliver(Reconnected(keeps_yaw=keeps_yaw))

    async def _is_wanted(self, advertisement: Advertisement, connection: Connection) -> bool:
        """Return True if it is the wanted wrist; a serial number is known only when it is connected."""
        if not self._wanted or not self._wrist.kind.has_serial_number:
            return True
        if self._search.is_named(advertisement):
            return True
        data = await connection.read(SERIAL_NUMBER)
        number = data.rstrip(b"\0").decode("ascii", "replace")
        return number.strip().lower() == self._wanted

    async def _stream(self, connection: Connection) -> None:
        """Deliver until it is lost. Raises LinkError then, or if the wrist stays silent."""
        player = asyncio.create_task(self._play_cues(connection))
        try:
            await self._watch_silence(connection)
        finally:
            player.cancel()
            await asyncio.wait({player})

    async def _watch_silence(self, connection: Connection) -> None:
        loop = asyncio.get_running_loop()
        asked_s = loop.time() - ASK_S
        configured_s = 0.0
        while True:
            # Ask for what it does not send by itself
            if self._wrist.is_ready and loop.time() - asked_s >= ASK_S:
                asked_s = loop.time()
                async with asyncio.timeout(CONNECT_S):
                    for item in await self._wrist.ask(connection):
                        self._deliver(item)

            # A lost connection ends the wait at once
            if await wait_up_to(self._lost, SILENCE_S / 2):
                raise self._failure
            silent_s = loop.time() - max(self._received_s, configured_s)
            if silent_s < SILENCE_S:
                continue

            # Silent for a reason that only a person can remove: wait for that person
            obstacle = self._wrist.obstacle
            if obstacle is not None:
                if silent_s >= obstacle.timeout_s:
                    raise LinkError(obstacle.clause)
                self._warn(f"{self._wrist.kind.label} {obstacle.clause}")
                self._is_paused = True
                continue

            # Silent for no known reason: configure it again, then reset it
            if configured_s > self._received_s:
                await self._wrist.reset(connection)
                raise LinkError(f"is connected but is still {self._silence}, and was reset")
            self._warn(f"{self._wrist.kind.label} is connected but {self._silence}; it is configured again")
            self._is_open = False  # no reading of the new yaw origin before its `Reconnected`
            async with asyncio.timeout(CONNECT_S):
                await self._wrist.configure(connection)
            self._start_delivery(keeps_yaw=False)
            configured_s = loop.time()

    @property
    def _silence(self) -> str:
        if self._useless < MANY:
            return "silent"
        return f"without readings in {self._useless} notifications"

    def _on_data(self, characteristic: str, _sender: object, data: bytearray) -> None:
        was_ready = self._wrist.is_ready
        items = [*self._wrist.received(characteristic, bytes(data), self._clock.now_ns())]
        if self._wrist.is_ready and not was_ready:
            self._received_s = asyncio.get_running_loop().time()
        self._useless += self._is_open
        for item in items:
            if isinstance(item, LinkError):
                self._failure = item
                self._lost.set()
            elif self._is_open:
                self._pass_on(item)

    def _pass_on(self, item: Item | ButtonChange) -> None:
        if isinstance(item, ButtonChange):
            self._button.change(is_down=item.is_down)
            return
        if isinstance(item, Reading | RawReading):
            if self._is_paused:  # its orientation may not have followed meanwhile
                self._start_delivery(keeps_yaw=False)
            self._received_s = asyncio.get_running_loop().time()
            self._useless = 0
            if self._is_warned:
                self._warn("")
        self._deliver(item)

    def _on_gesture(self, gesture: Gesture) -> None:
        self._deliver(Press(self._clock.now_ns(), gesture))

    async def _play_cues(self, connection: Connection) -> None:
        while True:
            await self._cue_came.wait()
            self._cue_came.clear()
            for pause_s, command in self._cue:
                if pause_s and await wait_up_to(self._cue_came, pause_s):
                    break
                with _logging_failure("play a cue"):
                    await self._wrist.play(connection, command)

    def _warn(self, problem: str) -> None:
        self._is_warned = bool(problem)
        self._warnings.warn("link", problem)


def discover_ble(kind: Kind, adapter: str = "") -> Discover:
    """Return the search for wrists of a `kind`. Searches in one event loop share one scan."""

    async def discover(seconds: float) -> Sequence[FoundDevice]:
        require_bleak("the search by Bluetooth")
        advertisements: dict[str, Advertisement] = {}

        def on_advertisement(advertisement: Advertisement) -> None:
            if kind.includes(advertisement):
                advertisements[kind.identify(advertisement)] = advertisement

        try:
            async with scanning(adapter, on_advertisement):
                await asyncio.sleep(seconds)
        except Exception as error:  # errors of bleak and its backends, which differ by system
            raise ConfigError(describe_error(error)) from error
        return [_found_device(text, advertisement) for text, advertisement in advertisements.items()]

    return discover


def _found_device(text: str, advertisement: Advertisement) -> FoundDevice:
    details: dict[str, str | float] = {"name": advertisement.name}
    if advertisement.rssi_dbm is not None:
        details["rssi_dbm"] = advertisement.rssi_dbm
    return FoundDevice(text, advertisement.label, details)
