"""The cards of a home: answers their request, hears presses, lights the lamp of the turn, writes files.

No core: it waits for people and lamps, and writes files.
"""

import asyncio
import contextlib
import logging
import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from pointit.bridges.home_assistant.entities import HomeEntity, entities_of
from pointit.bridges.home_assistant.home_connection import HomeConnection, NoHomeAssistantError
from pointit.bridges.home_assistant.setup.contradiction import label_of
from pointit.bridges.home_assistant.setup.home_address import HomeAddress
from pointit.bridges.home_assistant.setup.home_files import HomeFiles, advice_on, lights_of
from pointit.bridges.home_assistant.setup.home_kind import kind_of
from pointit.bridges.home_assistant.setup.listed_lamps import (
    fitting_lamps,
    limited_advice,
    listable_entities,
    unlisted_note,
)
from pointit.bridges.home_assistant.setup.lit_lights import LitLights, LitLightsFile
from pointit.bridges.home_assistant.setup.next_step import MAX_TEXT, NextStep, next_step, places_to_repeat
from pointit.bridges.home_assistant.setup.press_rays import NoMovementError, PressRays, WaitingError
from pointit.bridges.home_assistant.setup.progress import AWAY_RAD, SetupProgress
from pointit.bridges.home_assistant.setup.shown_lamps import shown_lamps
from pointit.bridges.home_assistant.setup.stored_setup import ChosenLamp, End, is_of_map
from pointit.bridges.home_assistant.setup.turn_light import TurnLight
from pointit.geometry import vector
from pointit.geometry.vector import Vec3
from pointit.maps.file import parse_map_file
from pointit.runtime.bus.service_bus import ServiceBus
from pointit.runtime.errors import PointItError, RefusedError
from pointit.runtime.host.state_file import StateFile, site_folder
from pointit.runtime.service.person_messages import PersonMessages
from pointit.schemas import ButtonEvent, HomeLamp, HomeSetup, ImuSample, PointingRay, SetUpHome
from pointit.schemas.base import MAX_ID
from pointit.schemas.home import MAX_SENTENCE
from pointit.schemas.text import one_line
from pointit.schemas.topics import BUTTON, IMU, RAY

log = logging.getLogger(__name__)

ANSWERED_S = 5.0
"""Time since the last request of a card after which no lamp shows its turn, s: the page is closed."""
SHOWN_S = 2.5
"""Time for which a lamp shows which one it is, s."""
TICK_S = 0.25
MIN_PAUSE_S = 0.4
"""Time between two presses that count, s."""
ENTITIES_PERIOD_S = 5.0
"""Interval at which the list of all entities is read again while a card shows it, s."""


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

        # Cards
        self._connection: HomeConnection | None = None
        self._entities: Sequence[HomeEntity] = ()
        self._entities_s = -math.inf
        self._problem = ""
        self._acting = asyncio.Lock()
        self._tasks = set[asyncio.Task[None]]()
        # Presses, and the lamp whose turn it is
        self._rays = PressRays()
        self._is_motion_missing = False
        """The problem is that no movement arrives."""
        self._pressed_s = -math.inf
        self._press_direction: Vec3 | None = None
        """Direction of the last press, {H}, until the person points elsewhere."""
        self._refusal = ""
        """Reason of an act that was refused in that direction, or `""`."""
        self._answered_s = -math.inf
        self._shown = ("", -math.inf)
        """Lamp that shows which one it is, and until when."""
        file = site_folder(bus.site, "home-assistant") / "lit_lights.json"
        self._lit = LitLights(StateFile[LitLightsFile].at(file, LitLightsFile))
        self._turn_light = TurnLight(self._lit, bus, state_of=state_of, wake=wake, wanted=self._wanted_light)

        # A home that is not set up is reported from the start
        bus.subscribe(RAY, self._on_ray)
        bus.subscribe(IMU, self._on_imu)
        bus.subscribe(BUTTON, self._on_button)
        self._report_progress()
        self._messages = PersonMessages(bus, "home-assistant")
        self._reacted = ""
        """Lamp that reacted last to the person."""
        self._guided = ""
        """Person who is led."""
        self._bus.call_later(TICK_S, self._keep_guiding)

    @property
    def entities(self) -> set[str]:
        """Return the entities whose states matter here."""
        chosen = {lamp.id for lamp in self.progress.state.lamps}
        lit = {self._turn_light.lamp, *self._lit.entities} - {""}
        return chosen | lit

    @property
    def _is_connected(self) -> bool:
        """Return True if the home at the shown address is connected, and has accepted."""
        return self._connection is not None and self.progress.state.trial is None

    @property
    def _is_waiting(self) -> bool:
        """Return True if the home, which has lamps whose turn it may be, does not answer."""
        state = self.progress.state
        if not self.address.url or self._is_connected or state.step not in ("place", "try"):
            return False
        return not all(is_of_map(lamp.id) for lamp in state.lamps)

    @property
    def _next_step(self) -> NextStep | None:
        """Return the next step of the person, or None."""
        target = self.progress.target
        lamp = "" if target is None else target[0]
        return next_step(
            self.progress,
            is_lit=bool(lamp) and self._is_lit(lamp),
            goes_off=bool(lamp) and self._lit.was_unknown(lamp),
            is_waiting=self._is_waiting,
        )

    def _keep_guiding(self) -> None:
        self._guide()
        self._bus.call_later(TICK_S, self._keep_guiding)

    def _guide(self) -> None:
        """Tell the person their next step: phone, panel and headset show it as the card does."""
        step = self._next_step
        user = self.progress.state.user if step is not None else ""
        if self._guided and self._guided != user:
            self._messages.end_guidance(self._guided)
        self._guided = user
        if step is not None and user:
            self._messages.guide(user, step.text, step.choices)

    @property
    def hovered(self) -> set[str]:
        """Return the lamp that is brighter now because it is its turn."""
        return self._turn_light.hovered

    # Requests of cards.

    async def act(self, query: SetUpHome, connection_problem: str) -> HomeSetup:
        """Do what a person wants at the cards, and return what they show. Raises PointItError."""
        self._answered_s = self._loop.time()
        async with self._acting:
            if query.act != "read" or query.choice:
                await self._act_once(query)
            await self._read_entities()
            return await self._make_reply(connection_problem)

    async def _act_once(self, query: SetUpHome) -> None:
        """Do one act. Its refusal is the problem that cards show until the next act. Raises PointItError."""
        if query.user and query.act != "hand" and query.user != self.progress.state.user:
            raise RefusedError(f"{query.user} does not set up this home now")
        self._problem = ""
        try:
            await self._perform_act(query)
            await self._store_progress()
        except WaitingError:  # the next step says it, as long as it is so
            raise
        except PointItError as error:
            self._problem = str(error)
            raise
        finally:
            self._guide()

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
            "beside": progress.confirm,
            "mistaken": progress.replace_beside,
        }
        name = query.choice or query.act
        if name in without_values:
            without_values[name]()
        elif query.choice:
            self._correct_lamps(query)

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

    def _correct_lamps(self, query: SetUpHome) -> None:
        """Do an act on lamps that are placed. Raises RefusedError."""
        progress = self.progress
        if query.choice == "exchange":
            progress.exchange(query.lamps)
        elif query.choice == "met":
            progress.meet(query.lamps[0] if query.lamps else "")
        elif query.choice == "other":
            self._correct_tried()
        elif query.choice == "repeat":
            progress.repeat(query.lamps[0] if query.lamps else "", query.place)

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

    def _correct_tried(self) -> None:
        """Exchange the lamp that is tried with the one that reacted, or have it pointed at again."""
        progress = self.progress
        tried = progress.tried_lamp
        reacted = self._reacted if self._reacted in {lamp.lamp for lamp in progress.state.placed} else ""
        progress.correct(reacted)
        if reacted and reacted != tried:
            names = f"{label_of(progress.state, tried)} and {label_of(progress.state, reacted)}"
            self._messages.tell(progress.state.user, one_line(f"{names} are exchanged.", MAX_TEXT))

    def on_act(self, user: str, entity: str) -> None:
        """Note that a lamp reacts to `user`."""
        if user == self.progress.state.user:
            self._reacted = entity

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
            lamps.append(ChosenLamp(id=entity.entity, label=label, area=area, kind=kind_of(entity)))
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
        is_map_enough = bool(state.lamps) and all(is_of_map(lamp.id) for lamp in state.lamps)
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
        no_target: tuple[str, End] = ("", "")
        name, end = target or no_target
        is_aligning = bool(name) and progress.is_aligning
        is_lit = bool(name) and self._is_lit(name)
        goes_off = bool(name) and self._lit.was_unknown(name)

        # While lamps are placed, the page shows the draft: the map without its things.
        is_placing = state.step == "place"
        map_file = self.files.map
        if is_placing and self.files.draft.exists():
            map_file = self.files.draft

        step = self._next_step
        pose_m: tuple[float, float] | None = None
        pose_yaw_rad = 0.0
        if progress.pose is not None:
            pose_m, pose_yaw_rad = progress.pose
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
            advice=limited_advice(advice),
            next_step="" if step is None else step.text,
            choices=() if step is None else step.choices,
            tried=progress.tried_lamp,
            beside=progress.beside,
            is_short_walk=state.is_short_walk,
            is_waiting=self._is_waiting,
            may_repeat=places_to_repeat(state),
        )

    async def _shown_lamps(self) -> tuple[HomeLamp, ...]:
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

        return shown_lamps(progress, listed, self._entities, self._state_of)

    # Presses.

    def _process_press(self) -> None:
        """Note a press with the rays before it. Raises RefusedError."""
        now_s = self._loop.time()
        if self._is_waiting:
            raise WaitingError("your home does not answer: wait until it does")
        try:
            direction = self._rays.direction_at(now_s, self.progress.state.user)
        except NoMovementError:
            self._is_motion_missing = True
            raise
        if now_s - self._pressed_s < MIN_PAUSE_S:
            return
        self._pressed_s = now_s
        self.progress.press(
            direction.azimuth_rad, direction.elevation_rad, direction.eyes_m, direction.spread_rad
        )
        self._press_direction = direction.mean

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
            except WaitingError:
                pass  # the next step says it, as long as it is so
            except PointItError as error:
                self._problem = str(error)
                self._messages.tell(self.progress.state.user, one_line(str(error), MAX_TEXT))
            self._guide()

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
        self._rays.add(self._loop.time(), ray)
        if self._is_motion_missing:
            self._is_motion_missing = False
            self._problem = ""
        self.progress.on_arm(ray.direction)
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
        self._turn_light.begin()
        try:
            while not self.address_changed.is_set():
                await self._turn_light.update(connection)
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

    def _is_lit(self, lamp: str) -> bool:
        """Return True if a lamp shows its turn by its light: not while its home does not answer."""
        if is_of_map(lamp):
            return True
        if not self._is_connected:
            return False
        state = self._state_of(lamp).get("state")
        return lamp.startswith("light.") and state in ("on", "off")

    def _wanted_light(self) -> tuple[str, bool]:
        """Return the lamp that is to be lit, or `""`, and whether it is its turn and not only a look."""
        name, until_s = self._shown
        now_s = self._loop.time()
        if now_s < until_s:
            return ("" if is_of_map(name) else name), False
        target = self.progress.target
        if target is None or now_s - self._answered_s > ANSWERED_S:
            return "", True
        lamp, _ = target
        return ("" if is_of_map(lamp) else lamp), True


def _only_lamp(query: SetUpHome) -> str:
    """Return the lamp of an act. Raises RefusedError: there is none."""
    if not query.lamps:
        raise RefusedError("say which lamp")
    return query.lamps[0]
