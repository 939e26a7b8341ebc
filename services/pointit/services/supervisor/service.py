"""Reads a person's button, wrist and localization, writes their interaction, their profile and cues."""

import asyncio
import logging
import math
from collections.abc import Sequence
from typing import ClassVar

from pointit.runtime.errors import ConfigError, RefusedError, RequestError
from pointit.runtime.host.state_file import StateFile
from pointit.runtime.service.service import Context, Scope, Service
from pointit.schemas import (
    NS_PER_S,
    ButtonEvent,
    CancelLocalization,
    Done,
    Feedback,
    ImuSample,
    Interaction,
    Localization,
    PointAnchor,
    PointingOffset,
    SetOffset,
    SetPose,
    StartLocalization,
    UserPose,
    UserProfile,
)
from pointit.schemas.topics import (
    BUTTON,
    CANCEL_LOCALIZATION,
    FEEDBACK,
    IMU,
    INTERACTION,
    LOCALIZATION,
    POINT_ANCHOR,
    POSE,
    PROFILE,
    SERVICE_ALIVE,
    SET_OFFSET,
    SET_POSE,
    START_LOCALIZATION,
)
from pointit.services.supervisor.config import ProfileConfig, SupervisorConfig
from pointit.services.supervisor.life_cycle import LifeCycle
from pointit.services.supervisor.offset_messages import OFFSET_PURPOSE, offset_in_use, offset_problem
from pointit.services.supervisor.outputs import Cancel, Output, Start, StartAnchor
from pointit.services.supervisor.pose_restore import PoseRestorer
from pointit.services.supervisor.readiness import LAST_WORD_PURPOSE

log = logging.getLogger(__name__)

LONGEST_WAIT_S = 1.0
"""Wall time after which a running deadline is looked at again: the clock's speed may have changed."""


class Supervisor(Service[SupervisorConfig]):
    """Leads one person from the button to pointing and back."""

    NAME: ClassVar[str] = "supervisor"
    SCOPE: ClassVar[Scope] = "user"
    CONFIG = SupervisorConfig

    def __init__(self, config: SupervisorConfig, context: Context) -> None:
        super().__init__(config, context)
        self._cycle = LifeCycle(
            localize=config.localize,
            relocalize_each_time=config.relocalize_each_time,
            follows_robot=config.localization_method == "moving_target",
            localization_timeout_s=config.localization_timeout_s,
            imu_timeout_s=config.imu_timeout_s,
            autostart=config.autostart,
            retry_s=config.retry_s,
            resume_s=config.resume_s,
            press_while_pointing=config.press_while_pointing,
            unsure_rad=math.radians(config.unsure_yaw_deg),
        )
        self._place = PoseRestorer()
        self._requests: asyncio.Queue[Start | StartAnchor | Cancel | SetPose] = asyncio.Queue()
        self._moved = asyncio.Event()
        self._offsets = StateFile(PointingOffset, self.user, OFFSET_PURPOSE)
        self._offset = self._read_offset()
        self._setting = asyncio.Lock()
        self._profile_seq = 0
        self._profiles = self.bus.publisher(PROFILE, self.user)
        self._interactions = self.bus.publisher(INTERACTION, self.user)
        self._feedback = self.bus.publisher(FEEDBACK, self.user)
        self._put_profile()
        self._began_ns = self.clock.now_ns()
        self._kept_word = StateFile(Interaction, self.user, LAST_WORD_PURPOSE)
        self._last_word: Interaction | None = None
        self._said = asyncio.Event()
        self._take_up()
        self.bus.subscribe(INTERACTION, self._on_interaction, self.user)
        self._do(self._cycle.begin(self._began_ns))
        self.bus.subscribe(POSE, self._on_pose, self.user)
        self.bus.subscribe(LOCALIZATION, self._on_localization, self.user)
        self.bus.subscribe(IMU, self._on_imu, self.user)
        self.bus.subscribe(BUTTON, self._on_button, self.user)
        self.bus.watch(SERVICE_ALIVE, self._on_presence)
        self.bus.serve(SET_OFFSET, self._set_offset, self.user)

    async def run(self) -> None:
        """Ask the localizer, one request after the other, mind the deadlines, keep the last word."""
        async with asyncio.TaskGroup() as group:
            group.create_task(self._ask(), name=f"supervisor.{self.user} requests")
            group.create_task(self._keep_word(), name=f"supervisor.{self.user} last word")
            group.create_task(self._mind_time(), name=f"supervisor.{self.user} deadlines")

    def _on_pose(self, pose: UserPose, _user: str) -> None:
        self._place.pose(pose)
        self._do(self._cycle.pose(pose, self.clock.now_ns()))

    def _on_localization(self, news: Localization, _user: str) -> None:
        now_ns = self.clock.now_ns()
        self._place.localization(news, now_ns)
        self._do(self._cycle.localization(news, now_ns))
        word = self._last_word
        if (
            word is not None
            and word.state == self._cycle.state == "pointing"
            and news.stamp_ns > word.stamp_ns
        ):
            # of a restarted localizer, perhaps: who is here after us learns that pointing went on after it
            self._last_word = word.model_copy(update={"stamp_ns": news.stamp_ns})
            self._said.set()

    def _on_interaction(self, before: Interaction, _user: str) -> None:
        if before.stamp_ns < self._began_ns:  # else it is our own
            self._cycle.resume_from(before, self.clock.now_ns())

    def _take_up(self) -> None:
        try:
            before = self._kept_word.read()
        except ConfigError as error:
            self.bus.warn("last word", f"what the person was about is not taken up: {error}")
            return
        if before is not None:
            self._cycle.resume_from(before, self._began_ns)

    async def _keep_word(self) -> None:
        """Write what was said last, for who is here after us."""
        while True:
            await self._said.wait()
            self._said.clear()
            if self._last_word is None:
                continue
            try:
                await asyncio.to_thread(self._kept_word.write, self._last_word)
            except ConfigError as error:
                self.bus.warn("last word", f"after a restart the person has to press again: {error}")
            else:
                self.bus.clear("last word")

    def _on_presence(self, instance: str, present: bool) -> None:  # noqa: FBT001 - the bus's signature
        if instance == f"{START_LOCALIZATION.server}.{self.user}":
            self._place.localizer(self.clock.now_ns(), is_present=present)
            self._moved.set()

    def _on_imu(self, sample: ImuSample, _user: str) -> None:
        outputs = self._cycle.imu(sample, self.clock.now_ns())
        if outputs:
            self._do(outputs)

    def _on_button(self, event: ButtonEvent, _user: str) -> None:
        self._do(self._cycle.button(event, self.clock.now_ns()))

    def _do(self, outputs: Sequence[Output]) -> None:
        for output in outputs:
            match output:
                case Interaction():
                    self._interactions.put(output)
                    self._last_word = output
                    self._said.set()
                case Feedback():
                    self._feedback.put(output)
                case Start() | StartAnchor() | Cancel():
                    self._requests.put_nowait(output)
        self._moved.set()

    async def _ask(self) -> None:
        while True:
            request = await self._requests.get()
            if isinstance(request, Cancel):
                await self._cancel()
            elif isinstance(request, SetPose):
                await self._give_back(request)
            elif request.run == self._cycle.run:  # else the person has thought better of it
                await self._start(request)

    async def _start(self, request: Start | StartAnchor) -> None:
        query = StartLocalization(method=self.config.localization_method)
        try:
            if isinstance(request, StartAnchor):
                await self.bus.call(POINT_ANCHOR, PointAnchor(), self.user)
            else:
                await self.bus.call(START_LOCALIZATION, query, self.user)
        except RequestError as error:
            self._do(self._cycle.on_start_failed(request.run, str(error), self.clock.now_ns()))
        else:
            self._do(self._cycle.on_start_accepted(request.run))

    async def _cancel(self) -> None:
        try:
            await self.bus.call(CANCEL_LOCALIZATION, CancelLocalization(), self.user)
        except RequestError as error:  # it is not localizing, or not there: nothing is left to cancel
            log.debug("%s", error)
        self._cycle.on_cancel_reply(self.clock.now_ns())

    async def _give_back(self, place: SetPose) -> None:
        try:
            await self.bus.call(SET_POSE, place, self.user)
        except RequestError as error:
            self.bus.warn("place", f"the restarted localizer did not take the person's place: {error}")
            self._place.not_taken(self.clock.now_ns())
            self._moved.set()
        else:
            self.bus.clear("place")

    async def _mind_time(self) -> None:
        while True:
            now_ns = self.clock.now_ns()
            self._do(self._cycle.tick(now_ns))
            is_resting = self._cycle.state != "localizing"  # else a pose would end what the localizer does
            place = self._place.due(now_ns) if is_resting else None
            if place is not None:
                self._requests.put_nowait(place)
            self._moved.clear()
            waits = [self._cycle.deadline_ns, self._place.deadline_ns if is_resting else None]
            deadline_ns = min((wait for wait in waits if wait is not None), default=None)
            if deadline_ns is None:
                await self._moved.wait()
                continue
            left_s = max(0.0, (deadline_ns - self.clock.now_ns()) / NS_PER_S / self.clock.speed)
            try:
                async with asyncio.timeout(min(left_s, LONGEST_WAIT_S)):
                    await self._moved.wait()
            except TimeoutError:
                pass

    async def _set_offset(self, query: SetOffset, _user: str) -> Done:
        if query.offset is not None and (wrong := offset_problem(query.offset)):
            raise RefusedError(wrong)
        async with self._setting:  # what is kept is what was set last
            self._offset = query.offset
            self._put_profile()
            trouble = await self._keep_offset()
        what = "the offset is forgotten" if query.offset is None else "the offset is in use"
        return Done(message=f"{what}, but a restart brings the one of before: {trouble}" if trouble else what)

    async def _keep_offset(self) -> str:
        """Write or erase what outlives this process; return what went wrong."""
        try:
            if self._offset is None:
                await asyncio.to_thread(self._offsets.erase)
            else:
                await asyncio.to_thread(self._offsets.write, self._offset)
        except ConfigError as error:
            self.bus.warn("offset", f"the person's pointing offset is not kept: {error}")
            return str(error)
        self.bus.clear("offset")
        return ""

    def _read_offset(self) -> PointingOffset | None:
        try:
            kept = self._offsets.read()
        except ConfigError as error:
            self.bus.warn("offset", f"the person's pointing offset is not used: {error}")
            return None
        if kept is not None:
            log.info("%s", offset_in_use(self.user, kept))
        return kept

    def _put_profile(self) -> None:
        self._profile_seq += 1
        plain = profile(self.config.profile, self.clock.now_ns())
        self._profiles.put(plain.model_copy(update={"offset": self._offset, "seq": self._profile_seq}))


def profile(config: ProfileConfig, now_ns: int) -> UserProfile:
    """Return the profile as it travels."""
    return UserProfile(
        stamp_ns=now_ns,
        body=config.measures(),
        hand=config.hand,
        ray_model=config.ray_model,
        cursor_color=config.cursor_color,
        cursor_width_m=config.cursor_width_m,
        cursor_colormap=config.cursor_colormap,
        pattern=config.pattern,
    )


SERVICE = Supervisor
