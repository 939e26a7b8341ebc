"""Subscribes to what viewers are shown, serves it to pages, and publishes input of mice and phones."""

import asyncio
import contextlib
import functools
import logging
from pathlib import Path
from typing import Any, ClassVar

from starlette.websockets import WebSocket

from pointit.bridges.web.config import WebConfig
from pointit.bridges.web.devices.devices import Devices
from pointit.bridges.web.model.history import EventHistory
from pointit.bridges.web.model.home_site import HomeSite
from pointit.bridges.web.model.map_editor import MapEditor
from pointit.bridges.web.model.people import PagePeople, WristMotion
from pointit.bridges.web.model.separability import FloorSeparability
from pointit.bridges.web.model.site_model import SiteModel
from pointit.bridges.web.pages.action import ActionContext
from pointit.bridges.web.pages.latest_values import MAX_KEYS, SlowLink
from pointit.bridges.web.pages.page_requests import answer_request, hello_of
from pointit.bridges.web.pages.page_session import Pages, PageSession
from pointit.bridges.web.playback.past_page import Visits
from pointit.bridges.web.playback.recent import Recent
from pointit.bridges.web.scan.scan_server import ScanServer
from pointit.bridges.web.scan.session import ScanLights, ScanSession, leds_per_m
from pointit.bridges.web.scan.simulated_room import SimulatedRoom
from pointit.bridges.web.scan.solver_process import SolverProcess
from pointit.bridges.web.server import access as exposure_check
from pointit.bridges.web.server.access import Access, new_token
from pointit.bridges.web.server.app import PAST, Downloads, application
from pointit.bridges.web.server.bundle import Bundle
from pointit.bridges.web.server.lan import Lan
from pointit.bridges.web.server.link_file import announced_link
from pointit.bridges.web.server.listener import HttpListener, open_port, url
from pointit.bridges.web.server.metrics_server import metrics_route
from pointit.bridges.web.site_metrics import SiteMetrics
from pointit.bridges.web.wire import (
    MAX_TOLD,
    Ack,
    AimAt,
    Answer,
    Ask,
    HeadsetMotion,
    PersonLine,
    Play,
    Role,
    Status,
)
from pointit.bridges.web.wrists.pairing import Pairing
from pointit.bridges.web.wrists.phone import PhoneHost, Phones
from pointit.bridges.web.wrists.wrist_control import WristControl
from pointit.runtime.clock import WallClock
from pointit.runtime.errors import RefusedError
from pointit.runtime.host.extras import pointit_version
from pointit.runtime.machine import this_machine
from pointit.runtime.service.service import Context, Scope, Service
from pointit.schemas import (
    Announced,
    Deployment,
    Environment,
    Feedback,
    Health,
    Interaction,
    LampColor,
    Localization,
    Message,
    SelectionEvent,
    StripsFrame,
    Understood,
    UserPose,
    UserProfile,
)
from pointit.schemas.topics import ANNOUNCED, SERVICE_ALIVE, STRIPS_FRAME, USER_ALIVE, Topic
from pointit.services.registry import SHOWN, person_of
from pointit.site.following import follow_site
from pointit.site.site_state import Change

log = logging.getLogger(__name__)

TICK_S = 1.0
"""Interval of status, metrics and checks for silent trackers."""

QUIET_S = 10.0
"""A warning about malformed messages is cleared this long (s) after the last one."""


class Web(Service[WebConfig]):
    """Web page: the scene, controls and health in a browser; its mouse or a phone as a person's wrist."""

    NAME: ClassVar[str] = "web"
    SCOPE: ClassVar[Scope] = "site"
    CONFIG = WebConfig
    TIME_MAY_STEP: ClassVar[bool] = True

    @classmethod
    def validate_config(cls, config: WebConfig) -> None:
        """Check that the page is not open to everyone, see `exposure_check`."""
        exposure_check.check(config)

    def __init__(self, config: WebConfig, context: Context) -> None:
        super().__init__(config, context)
        self._loop = asyncio.get_running_loop()

        # Access
        self._token = config.operator_token or new_token()
        access = Access(self._token, config.viewer_token or new_token())
        host_name, _ = exposure_check.address(config, config.port)
        access.know_hosts([host_name])
        if config.public_url:
            access.know_proxy(config.public_url)

        # State of the site, and what is kept of its past
        recent = Recent(self.bus.site)
        self._model = SiteModel(
            self.NAME,
            self._now_s(),
            recent,
            self._on_change,
            on_person=self._on_person,
            on_service=self._on_service,
        )
        self._history = EventHistory(self.bus, self.clock, self._model.cache)
        self._downloads = Downloads(recent, config.record_s, self.clock)
        version = pointit_version()
        self._metrics = SiteMetrics(self.bus.site, version, self._model.state)

        # People, and the wrists that pages move
        self._wrists = WristControl(config)
        self._pairing = Pairing()
        self._people = PagePeople(self.bus, self.clock)
        self._motion = WristMotion(
            wrists=self._wrists, people=self._people, clock=self.clock, ended=self._update_status
        )

        # Pages of now and of the past
        hello = functools.partial(hello_of, version=version, site=self.bus.site, language=config.language)
        home = HomeSite(self.bus, config.home_folder)
        self._pages = Pages(
            self._model.cache,
            self.bus,
            self._status,
            self._wrists.users_of,
            rate_hz=config.rate_hz,
            max_viewers=config.most_viewers,
            hello=functools.partial(hello, speaks=config.announce == "page", has_home=home.is_there),
        )
        self._visits = Visits(recent, self._pages, self.clock, version)

        # Phones. The actions are created last, as they need all other parts.
        bundle = Bundle()
        host = PhoneHost(
            wrists=self._wrists,
            now_ns=self.clock.now_ns,
            send=self._people.move,
            answer=lambda page, ask: answer_request(self._actions, page, "wrist", ask),
            changed=self._update_status,
            warnings=self.bus,
            greeting=hello("wrist", speaks=config.announce == "phone"),
        )
        self._phones = Phones(host, self._pairing, bundle)

        # Scan of the room
        self._solver = SolverProcess()
        self._lights = ScanLights(self.bus)
        scan_file = Path(config.scan_file or "room.yaml")
        self._scan = ScanSession(show=self._lights.show, solve=self._solver.solve, file=scan_file)
        self._scan_server = ScanServer(
            self._scan,
            access,
            bundle,
            is_wrist=self._phones.is_paired,
            token=config.scan_token,
            room=SimulatedRoom(config.scan_room) if config.scan_room else None,
        )

        # The server, and what its pages may do
        routes = [*self._phones.routes, *self._scan_server.routes, metrics_route(self._metrics, access)]
        app = application(access, bundle, self._open_page, self._downloads.answer, routes)
        self._separability = FloorSeparability()
        maps = MapEditor(self.bus)
        self._devices = Devices(
            bus=self.bus,
            maps=maps,
            address=config.devices_at,
            run_output=config.run_output,
            present=lambda: self._model.present,
            changed=self._update_status,
        )
        self._lan = Lan(config, self.bus.site, app)
        self._actions = ActionContext(
            bus=self.bus,
            people=self._people,
            wrists=self._wrists,
            pairing=self._pairing,
            phones=self._phones,
            lan=self._lan,
            access=access,
            separability=self._separability,
            maps=maps,
            scan=self._scan_server,
            devices=self._devices,
            home=home,
            present=lambda: self._model.present,
            changed=self._update_status,
        )

        # Own health
        self._link = SlowLink(this_machine().host_name)
        self._wall = WallClock()
        self._malformed = 0
        self._malformed_s = 0.0

        # The port is opened last: nobody would close it if another step failed
        for topic in SHOWN:
            self.bus.subscribe(topic, functools.partial(self._on_message, topic))
        follow_site(self._model.state, self.bus, self._now_s, ())
        listening_socket = open_port(config.host, config.port, "--port")
        self._listener = HttpListener(app, listening_socket)
        if config.lan:
            with contextlib.suppress(RefusedError):  # `run` tries again, and reports it
                self._lan.listen()

    async def run(self) -> None:
        """Serve until cancelled, then close every connection."""
        shown = contextlib.ExitStack()
        try:
            await self._listener.start()
            host, port = exposure_check.address(self.config, self._listener.port)
            page_url = url("http", host, port)
            log.info("the page is at %s/", page_url)
            if not self.config.operator_token:
                link = f"{page_url}/?token={self._token}"
                shown.enter_context(announced_link(self.bus, link))
            if self.config.lan:
                await self._open_lan()
            async with asyncio.TaskGroup() as group:
                group.create_task(self._tick(), name="web tick")
                group.create_task(self._history.run(), name="web history")
                group.create_task(self._devices.run(), name="web devices")
                group.create_task(self._motion.run(), name="web wrists")
        finally:
            # The listener after all that its connections wait for; the link at last, when nothing is open
            self._downloads.close()
            await self._scan.close()
            self._lights.close()
            self._solver.close()
            await self._phones.close()
            await self._lan.close()
            await self._listener.close()
            shown.close()

    @property
    def port(self) -> int:
        """Return the port of the listener."""
        return self._listener.port

    async def _open_lan(self) -> None:
        try:
            reply = await self._actions.open_lan()
            log.info("%s", reply["message"])
        except RefusedError as error:  # the page is useful on this machine all the same
            log.error("the page is not open to the local network: %s", error)  # noqa: TRY400 - a sentence
            self.bus.warn("lan", f"the page is not open to the local network: {error}")

    # Host of pages.

    def header(self) -> tuple[int, float]:
        """Return the site's time, ns, and its speed."""
        return self.clock.now_ns(), self.clock.speed

    async def answer(self, ask: Ask, session: PageSession) -> Answer:
        """Handle a page's request."""
        # a request of the table names robots, too: everybody may stop one that is called like a person
        role = session.role if ask.deed is None else session.rights(ask.name)
        return await answer_request(self._actions, session.page, role, ask)

    def aim(self, aim: AimAt, session: PageSession) -> None:
        """Point where a page's mouse does."""
        if session.role == "operator":
            self._wrists.aim(session.page, aim)

    def move_by_headset(self, motion: HeadsetMotion, session: PageSession) -> None:
        """Point as the wearer of a page's headset does, while the page may."""
        if session.rights(motion.user) == "viewer":  # e.g. the phone's link was revoked
            if self._wrists.release_from(motion.user, session.page):
                self._update_status()
            return
        try:
            measured = self._wrists.move_by_headset(session.page, motion, self.clock.now_ns())
        except RefusedError as error:
            self.malformed(f"{motion.kind}: {error}")
            return
        if measured is not None:
            pose, sample = measured
            if pose is not None:
                self._people.place(motion.user, pose)
            self._people.move(motion.user, sample)

    def play(self, play: Play) -> None:
        """Count it as malformed: this page shows what happens now."""
        self.malformed(f"{play.kind}: this page shows the present")

    def shown(self, ack: Ack) -> None:
        """Note that a page has shown a batch."""
        self._pages.shown(ack)

    def malformed(self, sentence: str) -> None:
        """Count a malformed message of a page."""
        self._malformed += 1
        self._malformed_s = self._now_s()
        self.bus.warn(
            "pages",
            f"a page has sent a malformed message ({sentence[:MAX_TOLD]}; {self._malformed} so far); "
            "load it again",
        )

    async def _open_page(self, socket: WebSocket, role: Role) -> None:
        if not await self._pages.admit(socket, role):
            return
        if socket.url.path == PAST:
            await self._visits.open(socket)
            return
        await self._history.is_asked.wait()  # a page's first batch contains past events
        paired_user = functools.partial(self._phones.paired_user, socket)
        await self._pages.open(socket, role, self, self._on_closed, paired_user)

    def _on_closed(self, page: str) -> None:
        self._people.forget_voice(page)
        if self._wrists.close(page):
            self._update_status()

    def _status(self) -> Status:
        """Return the status of the site for a page that moves no wrist."""
        now_s = self._now_s()
        lines: list[PersonLine] = []
        for user in self._people.names:
            paired = self._pairing.paired(user, now_s)
            lines.append(self._wrists.line(user, self.clock.now_ns(), paired=paired))
        status = self._model.status(
            lines,
            now_s,
            viewers=len(self._pages),
            lan_url=self._lan.url,
            speed=self.clock.speed,
            now_ns=this_machine().now_ns(),
        )
        return status.model_copy(update={"devices": self._devices.lines()})

    # Input from the bus.

    def _on_message(self, topic: Topic[Any], message: Message, name: str) -> None:
        has_room = self._model.take(topic, name, message, self.clock.now_ns(), self._now_s())
        if not has_room:
            self.bus.warn("keys", f"more than {MAX_KEYS} keys: {topic.key} of {name} is not shown to pages")
        if isinstance(message, Deployment):
            self._devices.on_deployment(message)
            self._update_status(now=not message.services)  # this process may end with the run
        self._pages.notify_pages(now=topic is STRIPS_FRAME)

    def _on_change(self, change: Change) -> None:
        """Pass a new message to the parts of the server that follow it."""
        self._metrics.take(change)
        name = change.name
        message = change.message
        match message:
            case SelectionEvent():
                self._history.add(message)
            case Health():
                self._link.hear(message, self._wall.now_ns(), self._now_s(), person_of(name))
            case Environment():
                self._on_map(message)
            # what moves a wrist: the person, their pose, and the progress of its localization
            case UserProfile():
                self._wrists.profile(name, message)
            case UserPose():
                self._wrists.pose(name, message)
            case Localization():
                self._wrists.localization(name, message)
                self._phones.localization(name, message)
            case Interaction():
                self._people.states[name] = message.state
                self._phones.interaction(name, message)
            case Announced() | Feedback() | Understood():
                self._phones.feedback(name, message)
            case StripsFrame() | LampColor():
                self._on_light(message, name)
            case _:
                pass

    def _on_map(self, room: Environment) -> None:
        self._wrists.room(room)
        self._separability.set_room(room)
        self._devices.on_map(room)
        self._phones.set_lamps(tuple(lamp.id for lamp in room.lamps))

        # In a scan, a lamp is a strip of one pixel
        strips = {strip.id: strip.pixels for strip in room.strips}
        lamps = {lamp.id: 1 for lamp in room.lamps if lamp.id not in strips}
        self._lights.set_lamps(lamps)
        self._scan.set_strips(strips | lamps, leds_per_m(room.strips))

    def _on_light(self, message: StripsFrame | LampColor, name: str) -> None:
        if isinstance(message, StripsFrame):
            self._scan_server.lights({strip.id: strip.rgb for strip in message.strips})
        else:
            self._lights.hear(name, message.color)
            self._scan_server.lights({name: bytes(message.color)})

    def _on_service(self, instance: str, present: bool) -> None:
        self._model.set_service(instance, present, self._now_s())
        if not present:
            self._phones.end_names_except(self._model.cache.names(ANNOUNCED))
        self._visits.remember(SERVICE_ALIVE, instance, present=present)
        self._history.set_service(instance, present=present)
        self._pages.notify_pages()
        self._update_status()

    def _on_person(self, user: str, present: bool) -> None:
        self._visits.remember(USER_ALIVE, user, present=present)
        if present:
            self._people.on_join(user)
        else:
            self._people.on_leave(user)
            self._wrists.forget(user)
            self._phones.forget(user)
        self._pages.notify_pages()
        self._update_status()

    # Time.

    async def _tick(self) -> None:
        while True:
            await asyncio.sleep(TICK_S)
            now_s = self._now_s()
            self._model.tick(now_s)
            self.bus.warn("link", self._link.sentence(now_s))
            self._pages.notify_pages()
            if now_s - self._malformed_s > QUIET_S:
                self.bus.clear("pages")
            self._pages.measure()
            self._pages.tell_status()

    def _update_status(self, *, now: bool = False) -> None:
        self._motion.wake()
        if now:
            self._pages.tell_status()
        else:
            self._pages.status_changed()

    def _now_s(self) -> float:
        return self._loop.time()


SERVICE = Web
