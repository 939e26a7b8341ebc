"""The cards of a home: answers their request, hears presses, lights the lamp of the turn, writes files.

No core: it waits for people and lamps, and writes files.
"""

import asyncio
import contextlib
import logging
import math
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from pointit.bridges.home_assistant.entities import HomeEntity, entities_of
from pointit.bridges.home_assistant.home_connection import HomeConnection, NoHomeAssistantError
from pointit.bridges.home_assistant.hover_feedback import UNKNOWN
from pointit.bridges.home_assistant.setup.home_address import HomeAddress
from pointit.bridges.home_assistant.setup.home_files import HomeFiles, advice_on, lights_of, sigmas_of
from pointit.bridges.home_assistant.setup.listed_lamps import (
    fitting_lamps,
    listable_entities,
    unlisted_note,
)
from pointit.bridges.home_assistant.setup.lit_lights import NO_STATE, LitLights, LitLightsFile
from pointit.bridges.home_assistant.setup.progress import AGAIN, ChosenLamp, End, SetupProgress
from pointit.geometry import vector
from pointit.geometry.vector import Vec3
from pointit.maps.file import parse_map_file
from pointit.runtime.bus.service_bus import ServiceBus
from pointit.runtime.errors import ConfigError, PointItError, RefusedError
from pointit.runtime.host.state_file import StateFile, site_folder
from pointit.schemas import ButtonEvent, HomeLamp, HomeSetup, ImuSample, PointingRay, SetUpHome
from pointit.schemas.base import MAX_ID
from pointit.schemas.home import LAMP, STRIP
from pointit.schemas.text import one_line
from pointit.schemas.topics import BUTTON, IMU, RAY

log = logging.getLogger(__name__)

ANSWERED_S = 5.0
"""Time since the last request of a card after which no lamp shows its turn, s: the page is closed."""
SHOWN_S = 2.5
"""Time for which a lamp shows which one it is, s."""
BLINK_S = 1.0
"""Time for which a lamp that is on is brighter, and then is not, s."""
TICK_S = 0.25
NO_REPORT_S = 4.0
"""Time at its turn after which a lamp that has reported no state is lit without, s."""
FOLLOW_S = 5.0
"""Time for a lamp to report that it is lit, s."""
PRESS_RAYS_S = 0.5
"""Time before a press of which the rays are averaged, s."""
MIN_RAYS = 3
MIN_PAUSE_S = 0.4
"""Time between two presses that count, s."""
AWAY_RAD = math.radians(12.0)
"""Angle from the direction of the last press from which a person points elsewhere."""
ENTITIES_PERIOD_S = 5.0
"""Interval at which the list of all entities is read again while a card shows it, s."""
MAX_SENTENCE = 500
MAX_ADVICE = 20


class SetupSession:
    """Sets up one home. Its lamps are lit while `run` has a connection."""

    def __init__(
        self,
        folder: Path,
        bus: ServiceBus,
        *,
        state_of: Callable[[str], Mapping[str, Any]],
        wake: Callable[[str], None],
    ) -> None:
        """Go on with what is stored in `folder`.

        Args:
            folder: of the home.
            bus: gets warnings, and has the rays and presses of people.
            state_of: returns the state of an entity in Home Assistant, empty if it is not known.
            wake: called with an entity whose hover may have changed.

        Raises:
            ConfigError: If what is stored cannot be used.
        """
        self.files = HomeFiles(folder)
        self.progress = SetupProgress(self.files.state.read())
        self.address = HomeAddress(self.files, self.progress)
        self.address_changed = asyncio.Event()
        """Set when another address or token is to be used."""
        self._bus = bus
        self._loop = asyncio.get_running_loop()
        self._state_of = state_of
        self._wake = wake

        # Cards
        self._connection: HomeConnection | None = None
        self._entities: Sequence[HomeEntity] = ()
        self._entities_s = -math.inf
        self._problem = ""
        self._acting = asyncio.Lock()
        self._tasks = set[asyncio.Task[None]]()
        # Presses, and the lamp whose turn it is
        self._rays: deque[tuple[float, PointingRay]] = deque(maxlen=100)
        self._pressed_s = -math.inf
        self._press_direction: Vec3 | None = None
        """Direction of the last press, {H}, until the person points elsewhere."""
        self._refusal = ""
        """Reason of an act that was refused in that direction, or `""`."""
        self._answered_s = -math.inf
        self._shown = ("", -math.inf)
        """Lamp that shows which one it is, and until when."""
        self._spot = ""
        """Entity of the lamp that is to be lit."""
        self._silent_s = -math.inf
        """Time since which it is to be lit on this connection, and has had no state."""
        self._ended_s: dict[str, float] = {}
        """Time at which the turn of a lit lamp was over."""
        file = site_folder(bus.site, "home-assistant") / "lit_lights.json"
        self._lit = LitLights(StateFile[LitLightsFile].at(file, LitLightsFile))

        # A home that is not set up is reported from the start
        bus.subscribe(RAY, self._on_ray)
        bus.subscribe(IMU, self._on_imu)
        bus.subscribe(BUTTON, self._on_button)
        self._report_progress()

    @property
    def entities(self) -> set[str]:
        """Return the entities whose states matter here."""
        chosen = {lamp.id for lamp in self.progress.state.lamps}
        lit = {self._spot, *self._lit.entities} - {""}
        return chosen | lit

    @property
    def _is_connected(self) -> bool:
        """Return True if the home at the shown address is connected, and has accepted."""
        return self._connection is not None and self.progress.state.trial is None

    @property
    def hovered(self) -> set[str]:
        """Return the lamp that is brighter now because it is its turn."""
        spot = self._spot
        if not spot or spot in self._lit.entities:
            return set()
        is_brighter = int(self._loop.time() / BLINK_S) % 2 == 0
        return {spot} if is_brighter else set()

    # Requests of cards.

    async def act(self, query: SetUpHome, connection_problem: str) -> HomeSetup:
        """Do what a person wants at the cards, and return what they show. Raises PointItError."""
        self._answered_s = self._loop.time()
        async with self._acting:
            if query.act != "read":
                self._problem = ""
                await self._perform_act(query)
                await self._store_progress()
            await self._read_entities()
            return await self._make_reply(connection_problem)

    async def _perform_act(self, query: SetUpHome) -> None:
        """Do one act. Raises PointItError."""
        progress = self.progress
        without_values: dict[str, Callable[[], None]] = {
            "press": self._process_press,
            "take_back": progress.take_back,
            "walk": progress.walk,
            "stay": progress.stay,
            "skip": progress.skip,
            "align": progress.start_aligning,
            "finish": progress.finish,
        }
        if query.act in without_values:
            without_values[query.act]()

        # The others have values of their own
        elif query.act in ("connect", "without"):
            self._set_address(query)
        elif query.act == "choose":
            await self._choose_lamps(query.lamps)
        elif query.act == "show":
            name = query.lamps[0] if query.lamps else ""
            self._shown = (name, self._loop.time() + SHOWN_S)
        elif query.act == "hand":
            progress.take_hand(query.hand, query.user)
        elif query.act == "stand":
            progress.stand(query.place)
        elif query.act == "go":
            progress.go(query.step or progress.state.step)

    def _set_address(self, query: SetUpHome) -> None:
        if query.act == "connect":
            self.address.connect(query.url, query.secret)
        else:
            self.address.without_home()
        self._entities_s = -math.inf
        self.address_changed.set()

    async def _choose_lamps(self, names: Sequence[str]) -> None:
        offered = {lamp.id: lamp for lamp in await self._offered_lamps()}
        offered |= {lamp.id: lamp for lamp in self.progress.state.lamps}  # one may be missing for a moment
        for name in names:
            if name not in offered:
                raise RefusedError(f"there is no {name} any more: choose again")
        chosen = [offered[name] for name in dict.fromkeys(names)]
        self.progress.choose(chosen, tuple(offered))

    def _report_progress(self) -> None:
        """Report a home that is not set up yet: `pointit doctor` and the page show it."""
        sentence = "the home is not set up yet: go on with its cards in the page"
        if self.progress.state.step == "done":
            sentence = ""
        self._bus.warn("set-up", sentence, severity="note")

    async def _store_progress(self) -> None:
        """Locate the lamps once all presses are there. Store the state after the files from it."""
        progress = self.progress
        state_before = progress.state

        # Each fit may leave out lamps, and then is made once more
        while progress.is_complete and progress.state.lamps:
            room = await asyncio.to_thread(progress.fit)
            progress.on_room(room)

        # The map if lamps were placed. If that fails, the presses are still there.
        is_placed = progress.state.step in ("try", "done") and progress.state.placed
        stored = await asyncio.to_thread(self.files.state.read)
        stored_placed = None if stored is None else stored.placed
        if is_placed and stored_placed != progress.state.placed:
            try:
                await asyncio.to_thread(self.files.write_map, progress.state)
            except PointItError:
                progress.state = state_before
                raise

        # The draft while lamps are pointed at, and the state
        if progress.state.step == "place" and not self.files.draft.exists():
            await asyncio.to_thread(self.files.write_draft)
        elif progress.state.step != "place":
            self.files.draft.unlink(missing_ok=True)
        if stored != progress.state:
            await asyncio.to_thread(self.files.state.write, progress.state)
        self._report_progress()

    async def _offered_lamps(self) -> list[ChosenLamp]:
        """Return all lamps that can be chosen."""
        lamps: list[ChosenLamp] = []
        for entity in listable_entities(self._entities):
            label = one_line(entity.name, MAX_ID)
            area = one_line(entity.area, MAX_ID)
            lamps.append(ChosenLamp(id=entity.entity, label=label, area=area))
        content = await asyncio.to_thread(self.files.read_map)
        return lamps + lights_of(parse_map_file(content, self.files.map))

    async def _read_entities(self) -> None:
        """Read the list of entities of Home Assistant again, if a card shows it and it is old."""
        connection = self._connection
        is_needed = self.progress.state.step in ("choose", "done")
        if connection is None or not is_needed:
            return
        now_s = self._loop.time()
        if now_s - self._entities_s < ENTITIES_PERIOD_S:
            return
        self._entities_s = now_s
        with contextlib.suppress(RefusedError, TimeoutError, NoHomeAssistantError):
            self._entities = await entities_of(connection)

    def _shown_problem(self, connection_problem: str) -> str:
        """Return the problem of the last act, else that of a connection that is needed, else `""`.

        An act that was refused is one: who points with a phone sees the page's cards, and no message of it.
        """
        state = self.progress.state
        if self._problem:
            return self._problem
        if self._refusal:
            return self._refusal
        if not self.address.url or self._is_connected:
            return ""
        if state.step == "connect":
            return connection_problem
        # Before a lamp is chosen, the card waits for those of the home
        is_map_enough = bool(state.lamps) and all(_is_of_map(lamp.id) for lamp in state.lamps)
        return "" if is_map_enough else connection_problem

    async def _make_reply(self, connection_problem: str) -> HomeSetup:
        """Return the content of the present card."""
        progress = self.progress
        state = progress.state
        target = progress.target
        problem = self._shown_problem(connection_problem)
        advice: list[str] = []
        if state.step == "try":
            content = await asyncio.to_thread(self.files.read_map)
            advice = await asyncio.to_thread(advice_on, content, self.files.map, state.places_m)
        elif state.step == "choose" and self._connection is not None:
            advice = list(self._connection.refusals)
        has_token = await asyncio.to_thread(lambda: self.address.has_secret)
        all_lamps = await self._shown_lamps()
        lamps = tuple(fitting_lamps(all_lamps))
        unlisted_count = len(all_lamps) - len(lamps)
        if state.step == "choose":
            unlisted_count += len(self._entities) - len(listable_entities(self._entities))
        if unlisted_count:
            advice.insert(0, unlisted_note(unlisted_count))

        # From here on nothing waits: place, poses and pose are those of one moment.
        name = ""
        end: End = ""
        is_aligning = False
        is_lit = False
        goes_off = False
        if target is not None:
            name, end = target
            is_aligning = progress.is_aligning
            is_lit = self._can_be_lit(name)
            goes_off = self._lit.was_unknown(name)

        # While lamps are placed, the page shows the draft: the map without its things.
        is_placing = state.step == "place"
        map_file = self.files.map
        if is_placing and self.files.draft.exists():
            map_file = self.files.draft

        pose_m: tuple[float, float] | None = None
        pose_yaw_rad = 0.0
        if progress.pose is not None:
            pose_m, pose_yaw_rad = progress.pose
        if len(advice) > MAX_ADVICE:
            left_out = len(advice) - MAX_ADVICE + 1
            advice[MAX_ADVICE - 1 :] = [f"there are {left_out} more such sentences: deal with these first"]
        shown_advice = tuple(one_line(sentence, MAX_SENTENCE) for sentence in advice)
        return HomeSetup(
            step=state.step,
            url=self.address.url,
            has_token=has_token,
            is_connected=self._is_connected,
            problem=one_line(problem, MAX_SENTENCE),
            lamps=lamps,
            hand=state.hand,
            user=state.user,
            place=progress.place,
            target=name,
            end=end,
            is_aligning=is_aligning,
            may_walk=progress.may_walk,
            can_take_back=is_placing and bool(state.presses),
            is_lit=is_lit,
            goes_off=goes_off,
            map=str(map_file),
            places_m=state.places_m,
            poses=progress.poses,
            pose_m=pose_m,
            pose_yaw_rad=pose_yaw_rad,
            advice=shown_advice,
        )

    async def _shown_lamps(self) -> list[HomeLamp]:
        """Return the lamps of the present card."""
        progress = self.progress
        state = progress.state
        # While lamps are chosen, all that there are; later, the chosen ones
        chosen = {lamp.id: lamp for lamp in state.lamps}
        listed = list(state.lamps)
        if state.step in ("choose", "done"):
            offered = {lamp.id: lamp for lamp in await self._offered_lamps()}
            for name, lamp in chosen.items():
                offered.setdefault(name, lamp)  # one that is missing for a moment stays in the list
            listed = list(offered.values())

        # The states that are followed are newer than those of the list of entities
        listed_states = {entity.entity: entity.state for entity in self._entities}
        sigmas = sigmas_of(state.placed)
        lamp_again = ""
        if progress.target is not None and progress.is_again:
            lamp_again = progress.target[0]
        lamps: list[HomeLamp] = []
        for lamp in listed:
            pressed_from = {press.place for press in state.presses if press.lamp == lamp.id}
            reason = state.left_out.get(lamp.id, "") or progress.reasons.get(lamp.id, "")
            if not reason and lamp.id == lamp_again:
                reason = AGAIN
            listed_state = listed_states.get(lamp.id, "")
            text = str(self._state_of(lamp.id).get("state", listed_state))
            lamps.append(
                HomeLamp(
                    id=lamp.id,
                    label=lamp.label,
                    area=lamp.area,
                    state=one_line(text, MAX_ID),
                    is_chosen=lamp.id in chosen,
                    is_new=bool(state.offered) and lamp.id not in state.offered,
                    is_placed=lamp.id in sigmas,
                    places=len(pressed_from),
                    direction_sigma_rad=sigmas.get(lamp.id),
                    reason=reason,
                )
            )
        return lamps

    # Presses.

    def _process_press(self) -> None:
        """Note a press with the rays before it. Raises RefusedError."""
        now_s = self._loop.time()
        rays = [ray for received_s, ray in self._rays if now_s - received_s <= PRESS_RAYS_S]
        user = self.progress.state.user
        if len(rays) < MIN_RAYS:
            raise RefusedError(
                f"no movement of {user} arrives: keep the phone's page open and allow its motion sensors, or "
                "switch the wristband on"
            )
        if now_s - self._pressed_s < MIN_PAUSE_S:
            return
        self._pressed_s = now_s

        # A hand shakes: its mean direction, and the eyes of the newest ray
        x, y, z = np.mean([ray.direction for ray in rays], axis=0).tolist()
        azimuth_rad = math.atan2(y, x)
        elevation_rad = math.atan2(z, math.hypot(x, y))
        eyes_m = rays[-1].origin_m[2]
        self.progress.press(azimuth_rad, elevation_rad, eyes_m)
        self._press_direction = (x, y, z)

    def refusal(self, user: str) -> str:
        """Return the reason for which an act of `user` is not carried out now, or `""`.

        With the last press the lamps are placed, and the person points at one of them still: they have not
        chosen it yet.
        """
        if user != self.progress.state.user or self._press_direction is None:
            return ""
        self._refusal = "you still point where you pressed: point elsewhere first, and then at it"
        return self._refusal

    async def _press_button(self) -> None:
        async with self._acting:
            self._problem = ""
            try:
                self._process_press()
                await self._store_progress()
            except PointItError as error:
                self._problem = str(error)

    def _on_button(self, _event: ButtonEvent, user: str) -> None:
        progress = self.progress
        if user != progress.state.user or progress.target is None:
            return
        task = self._loop.create_task(self._press_button(), name="press at a card")
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    def _on_ray(self, ray: PointingRay, user: str) -> None:
        if user != self.progress.state.user:
            return
        self._rays.append((self._loop.time(), ray))
        pressed = self._press_direction
        if pressed is not None and vector.angle_between(pressed, ray.direction) > AWAY_RAD:
            self._press_direction = None
            self._refusal = ""

    def _on_imu(self, sample: ImuSample, user: str) -> None:
        if user == self.progress.state.user:
            self.progress.on_epoch(sample.yaw_epoch)

    # Lamps that are lit.

    async def run(self, connection: HomeConnection) -> None:
        """Light the lamp whose turn it is, until the address changes.

        Raises:
            NoHomeAssistantError: If another address or token is to be used.
        """
        self._connection = connection
        self._entities_s = -math.inf
        self._spot = ""
        try:
            while not self.address_changed.is_set():
                await self._light_spot(connection)
                await asyncio.sleep(TICK_S)
        finally:
            self._connection = None
        raise NoHomeAssistantError("another address or token is used from now on")

    async def on_accepted(self) -> None:
        """Keep the address in use, since the home there answers. Raises PointItError: it cannot be stored."""
        async with self._acting:
            state_before = self.progress.state
            try:
                self.address.accept()
                await self._store_progress()
            except PointItError:
                self.progress.state = state_before
                raise
            # The state first: it says which secret belongs to which address, also after a kill
            await asyncio.to_thread(self.address.write)

    async def end_trial(self, reason: str) -> bool:
        """Return to the address that works, since the one in use has failed, and say so at the card.

        Return False if there is none to return to, or somebody has given another one meanwhile.
        """
        async with self._acting:
            if self.address_changed.is_set():
                return False
            working = self.address.end_trial()
            if not working:
                return False
            self._problem = f"{reason}. {working} is used as before"
            # A full disk ends no service: the next act stores it, and a restart ends the trial once more
            with contextlib.suppress(PointItError):
                await self._store_progress()
            return True

    def on_first_state(self, entity: str, state: Mapping[str, Any]) -> None:
        """Note the state of an entity that was not known on this connection."""
        self._lit.on_first_state(entity, state)

    def on_state(self, entity: str, state: Mapping[str, Any]) -> None:
        """Note a change of the state of an entity."""
        self._lit.on_state(entity, state)

    def _can_be_lit(self, lamp: str) -> bool:
        if _is_of_map(lamp):
            return True
        state = self._state_of(lamp).get("state")
        return lamp.startswith("light.") and state in ("on", "off")

    def _wanted_spot(self) -> str:
        now_s = self._loop.time()
        name, until_s = self._shown
        if now_s < until_s:
            return "" if _is_of_map(name) else name
        target = self.progress.target
        if target is None or now_s - self._answered_s > ANSWERED_S:
            return ""
        lamp, _ = target
        return "" if _is_of_map(lamp) else lamp

    async def _light_spot(self, connection: HomeConnection) -> None:
        """Light the lamp whose turn it is, and end the light of those whose turn is over."""
        now_s = self._loop.time()
        previous_spot = self._spot
        self._spot = self._wanted_spot()
        state = self._state_of(self._spot)
        if self._spot != previous_spot or state.get("state") != NO_STATE:
            self._silent_s = now_s

        # Without a state it cannot be restored: not for a look at the list, nor while it may still report
        is_turn = now_s >= self._shown[1]
        may_be_unknown = is_turn and now_s - self._silent_s >= NO_REPORT_S
        for entity in {previous_spot, self._spot} - {""}:
            self._wake(entity)
        try:
            if self._spot:
                call = self._lit.begin(self._spot, state, may_be_unknown=may_be_unknown)
                if call is not None:
                    context = UNKNOWN
                    with contextlib.suppress(RefusedError, TimeoutError):
                        context = await connection.call(call)
                    self._lit.on_result(call.entity, context)
            for entity in self._lit.entities:
                await self._end_light(connection, entity)
        except ConfigError as error:
            self._bus.warn("setup", f"lamps are not lit: {error}")

    async def _end_light(self, connection: HomeConnection, entity: str) -> None:
        """Switch a lamp off again whose turn is over."""
        if entity == self._spot:
            self._ended_s.pop(entity, None)
            return
        now_s = self._loop.time()
        ended_s = self._ended_s.setdefault(entity, now_s)
        call = self._lit.end(entity, self._state_of(entity), is_late=now_s - ended_s > FOLLOW_S)
        if call is not None:
            with contextlib.suppress(RefusedError, TimeoutError):
                await connection.call(call)
                self._lit.on_ended(entity, self._state_of(entity))
        if entity not in self._lit.entities:
            self._ended_s.pop(entity, None)


def _is_of_map(lamp: str) -> bool:
    return lamp.startswith((STRIP, LAMP))
