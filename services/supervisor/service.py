"""The interaction of one person: button, wrist and localization in; its state, profile and cues out."""

import asyncio
import logging
from collections.abc import Sequence
from typing import ClassVar

from pointit.runtime.clock import wait_until
from pointit.runtime.errors import ConfigError, RefusedError, RequestError
from pointit.runtime.host.state_file import StateFile
from pointit.runtime.service.service import Context, Scope, Service
from pointit.schemas import (
    Announced,
    ButtonEvent,
    CancelLocalization,
    Done,
    Feedback,
    ImuSample,
    Interaction,
    Localization,
    PointAnchor,
    PointingOffset,
    Say,
    SelectionManner,
    SetOffset,
    SetPose,
    StartLocalization,
    UserPose,
    UserProfile,
    topics,
)
from pointit.schemas.problems import UNWRITABLE
from pointit.services.supervisor.config import ProfileConfig, SupervisorConfig
from pointit.services.supervisor.life_cycle import (
    LAST_WORD_PURPOSE,
    Cancel,
    Guidance,
    LifeCycle,
    Output,
    Start,
)
from pointit.services.supervisor.pose_restore import PoseRestorer
from pointit.services.supervisor.transitions import OFFSET_PURPOSE, offset_in_use, offset_problem

log = logging.getLogger(__name__)


class Supervisor(Service[SupervisorConfig]):
    """The state machine of one person's interaction, from the button to pointing and back."""

    NAME: ClassVar[str] = "supervisor"
    SCOPE: ClassVar[Scope] = "user"
    CONFIG = SupervisorConfig

    def __init__(self, config: SupervisorConfig, context: Context) -> None:
        super().__init__(config, context)
        self._cycle = LifeCycle(config)
        self._restorer = PoseRestorer()
        self._requests: asyncio.Queue[Start | Cancel | SetPose] = asyncio.Queue()
        self._deadline_changed = asyncio.Event()
        self._offset_file = StateFile(PointingOffset, self.user, OFFSET_PURPOSE)
        self._offset = self._read_offset()
        self._setting = asyncio.Lock()
        self._profile_seq = 0
        self._profiles = self.bus.publisher(topics.PROFILE, self.user)
        self._interactions = self.bus.publisher(topics.INTERACTION, self.user)
        self._feedback = self.bus.publisher(topics.FEEDBACK, self.user)
        self._publish_profile()

        # What an earlier supervisor has left, before the first state of this one
        self._began_ns = self.clock.now_ns()
        self._stored_last = StateFile(Interaction, self.user, LAST_WORD_PURPOSE)
        self._last: Interaction | None = None
        self._has_last = asyncio.Event()
        self._restore_last()
        self.bus.subscribe(topics.INTERACTION, self._on_interaction, self.user)
        self.bus.subscribe(topics.BUTTON, self._on_button, self.user)  # a press may answer the first state
        self._process_outputs(self._cycle.begin(self._began_ns))

        # All else comes after the first state
        self.bus.subscribe(topics.POSE, self._on_pose, self.user)
        self.bus.subscribe(topics.LOCALIZATION, self._on_localization, self.user)
        self.bus.subscribe(topics.IMU, self._on_imu, self.user)
        self.bus.subscribe(topics.MANNER, self._on_manner)
        self.bus.subscribe(topics.ANNOUNCED, self._on_announced, self.user)
        self.bus.watch(topics.SERVICE_ALIVE, self._on_presence)
        self.bus.serve(topics.SET_OFFSET, self._set_offset, self.user)
        self.bus.serve(topics.SAY, self._say, self.user)

    async def run(self) -> None:
        """Send requests to the localizer one by one, watch the deadlines, and store the last interaction."""
        async with asyncio.TaskGroup() as group:
            group.create_task(self._send_requests(), name=f"supervisor.{self.user} requests")
            group.create_task(self._store_last(), name=f"supervisor.{self.user} last word")
            group.create_task(self._run_deadlines(), name=f"supervisor.{self.user} deadlines")

    def _on_pose(self, pose: UserPose, _user: str) -> None:
        self._restorer.pose(pose)
        self._process_outputs(self._cycle.pose(pose, self.clock.now_ns()))

    def _on_localization(self, localization: Localization, _user: str) -> None:
        now_ns = self.clock.now_ns()
        self._restorer.localization(localization, now_ns)
        self._process_outputs(self._cycle.localization(localization, now_ns))
        last = self._last
        if last is None or localization.stamp_ns <= last.stamp_ns:
            return
        if last.state == self._cycle.state == "pointing":
            # a restarted localizer perhaps: a later supervisor must see that pointing continued after it
            self._last = last.model_copy(update={"stamp_ns": localization.stamp_ns})
            self._has_last.set()

    def _on_interaction(self, interaction: Interaction, _user: str) -> None:
        if interaction.stamp_ns < self._began_ns:  # otherwise it is our own
            self._cycle.resume_from(interaction, self.clock.now_ns())

    def _restore_last(self) -> None:
        try:
            interaction = self._stored_last.read()
        except ConfigError as error:
            self.bus.warn("last-word", f"the last interaction is not resumed: {error}")
            return
        if interaction is not None:
            self._cycle.resume_from(interaction, self._began_ns)

    async def _store_last(self) -> None:
        while True:
            await self._has_last.wait()
            self._has_last.clear()
            if self._last is None:
                continue
            try:
                await asyncio.to_thread(self._stored_last.write, self._last)
            except ConfigError as error:
                self.bus.warn(UNWRITABLE, f"after a restart the person has to press again: {error}")
            else:
                self.bus.clear("last-word")
                self.bus.clear(UNWRITABLE)

    def _on_presence(self, instance: str, *, present: bool) -> None:
        if instance == topics.CLEAR_SELECTION.server and not present:
            self._process_outputs(self._cycle.manner(None, self.clock.now_ns()))
        if not present:
            self._process_outputs(self._cycle.end_advice(instance, self.clock.now_ns()))
        if instance == f"{topics.START_LOCALIZATION.server}.{self.user}":
            self._restorer.localizer(self.clock.now_ns(), is_present=present)
            self._deadline_changed.set()

    def _on_manner(self, manner: SelectionManner, _name: str) -> None:
        self._process_outputs(self._cycle.manner(manner, self.clock.now_ns()))

    def _on_announced(self, _announced: Announced, _user: str) -> None:
        self._process_outputs(self._cycle.hear_names(self.clock.now_ns()))

    def _on_imu(self, sample: ImuSample, _user: str) -> None:
        outputs = self._cycle.imu(sample, self.clock.now_ns())
        if outputs:
            self._process_outputs(outputs)

    def _on_button(self, event: ButtonEvent, _user: str) -> None:
        self._process_outputs(self._cycle.button(event, self.clock.now_ns()))

    def _process_outputs(self, outputs: Sequence[Output]) -> None:
        for output in outputs:
            match output:
                case Interaction():
                    self._interactions.put(output)
                    self._last = output
                    self._has_last.set()
                case Feedback():
                    self._feedback.put(output)
                case Start() | Cancel():
                    self._requests.put_nowait(output)
        self._deadline_changed.set()

    async def _send_requests(self) -> None:
        while True:
            request = await self._requests.get()
            if isinstance(request, Cancel):
                await self._cancel()
            elif isinstance(request, SetPose):
                await self._restore_pose(request)
            elif request.run == self._cycle.run:  # otherwise the person has cancelled
                await self._start(request)

    async def _start(self, request: Start) -> None:
        query = StartLocalization(method=self.config.localization_method)
        try:
            if request.is_anchor:
                await self.bus.call(topics.POINT_ANCHOR, PointAnchor(), self.user)
            else:
                await self.bus.call(topics.START_LOCALIZATION, query, self.user)
        except RequestError as error:
            outputs = self._cycle.on_start_failed(request.run, str(error), self.clock.now_ns())
            self._process_outputs(outputs)
        else:
            self._process_outputs(self._cycle.on_start_accepted(request.run))

    async def _cancel(self) -> None:
        try:
            await self.bus.call(topics.CANCEL_LOCALIZATION, CancelLocalization(), self.user)
        except RequestError as error:  # not localizing or absent: nothing to cancel
            log.debug("%s", error)
        self._cycle.on_cancel_reply(self.clock.now_ns())

    async def _restore_pose(self, place: SetPose) -> None:
        try:
            await self.bus.call(topics.SET_POSE, place, self.user)
        except RequestError as error:
            sentence = f"the restarted localizer did not accept the person's pose: {error}"
            self.bus.warn("place", sentence, "localizer")
            self._restorer.renew(self.clock.now_ns())
            self._deadline_changed.set()
        else:
            self.bus.clear("place", "localizer")

    async def _run_deadlines(self) -> None:
        while True:
            now_ns = self.clock.now_ns()
            self._process_outputs(self._cycle.tick(now_ns))
            is_resting = self._cycle.state != "localizing"  # a pose would end the localization
            place = self._restorer.due(now_ns) if is_resting else None
            if place is not None:
                self._requests.put_nowait(place)
            self._deadline_changed.clear()
            deadlines_ns = [self._cycle.deadline_ns]
            if is_resting:
                deadlines_ns.append(self._restorer.deadline_ns)
            known_ns = [deadline_ns for deadline_ns in deadlines_ns if deadline_ns is not None]
            deadline_ns = min(known_ns, default=None)
            await wait_until(self.clock, deadline_ns, self._deadline_changed)

    async def _set_offset(self, query: SetOffset, _user: str) -> Done:
        if query.offset is not None:
            problem = offset_problem(query.offset)
            if problem:
                raise RefusedError(problem)
        async with self._setting:  # the stored offset must be the last one set
            self._offset = query.offset
            self._publish_profile()
            problem = await self._store_offset()
        message = "the offset is forgotten" if query.offset is None else "the offset is in use"
        if problem:
            message = f"{message}, but a restart restores the previous one: {problem}"
        return Done(message=message)

    async def _say(self, query: Say, _user: str) -> Done:
        now_ns = self.clock.now_ns()
        if query.is_over:
            self._process_outputs(self._cycle.end_advice(query.service, now_ns, query.text))
            return Done(message=f"{self.user} is not advised so any longer")
        if query.stays and query.guides:
            guidance = Guidance(query.text, query.choices)
            self._process_outputs(self._cycle.guide(guidance, now_ns, query.service))
        elif query.stays:
            self._process_outputs(self._cycle.advise(query.text, now_ns, query.service))
        else:
            self._process_outputs(self._cycle.cue_of_text(query.text, now_ns))
        return Done(message=f"{self.user} is told")

    async def _store_offset(self) -> str:
        try:
            if self._offset is None:
                await asyncio.to_thread(self._offset_file.erase)
            else:
                await asyncio.to_thread(self._offset_file.write, self._offset)
        except ConfigError as error:
            self.bus.warn(UNWRITABLE, f"the person's pointing offset is not stored: {error}", "offset")
            return str(error)
        self.bus.clear("offset")
        self.bus.clear(UNWRITABLE, "offset")
        return ""

    def _read_offset(self) -> PointingOffset | None:
        try:
            offset = self._offset_file.read()
        except ConfigError as error:
            self.bus.warn("offset", f"the person's pointing offset is not used: {error}")
            return None
        if offset is not None:
            log.info("%s", offset_in_use(self.user, offset))
        return offset

    def _publish_profile(self) -> None:
        self._profile_seq += 1
        message = profile(self.config.profile, self.clock.now_ns())
        update = {"offset": self._offset, "seq": self._profile_seq}
        self._profiles.put(message.model_copy(update=update))


def profile(config: ProfileConfig, now_ns: int) -> UserProfile:
    """Return the profile as a message."""
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
