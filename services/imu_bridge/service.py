"""Reads a device, a recording, a simulation or a page, and writes the arm's orientation and button events."""

import asyncio
import itertools
import logging
import math
from dataclasses import replace
from typing import ClassVar

from pointit.runtime.bus.instrumented import steady_time
from pointit.runtime.clock import Timer
from pointit.runtime.errors import ConfigError, RefusedError
from pointit.runtime.host.state_file import StateFile
from pointit.runtime.service.plugin_guard import NullHealth, PluginGuard, guard_of, part_of
from pointit.runtime.service.service import Context, Scope, Service
from pointit.schemas import (
    WRIST_PATIENCE_S,
    ButtonEvent,
    Done,
    Feedback,
    ImuSample,
    SetMounting,
    SetMountingReply,
    SetYawOrigin,
    Step,
    WristSample,
    topics,
)
from pointit.schemas.problems import IDLE_ARM, NO_DATA, UNWRITABLE
from pointit.schemas.system import OWN_SOURCE
from pointit.services.imu_bridge.arm_frame import ArmFrame, YawEpoch
from pointit.services.imu_bridge.config import ImuBridgeConfig
from pointit.services.imu_bridge.device_wrist import DeviceWrist, SensorSample
from pointit.services.imu_bridge.page_wrist import PageWrist, figures, mover_name, warnings
from pointit.services.imu_bridge.sources import SOURCES, CueSource, Item, Press, Source, StepGesture
from pointit.services.imu_bridge.stored_mounting import PURPOSE, MountingSelection, StoredMountings

log = logging.getLogger(__name__)
REPORT_S = 1.0
"""Time between two reports on the device, s."""


class ImuBridge(Service[ImuBridgeConfig]):
    """Publishes the orientation of one person's arm from a device, a recording, a simulation, or a page.

    While a page or ROS moves the wrist, its samples replace those of the own source.
    """

    NAME: ClassVar[str] = "imu-bridge"
    SCOPE: ClassVar[Scope] = "user"
    CONFIG = ImuBridgeConfig
    TIME_MAY_STEP: ClassVar[bool] = True

    def __init__(self, config: ImuBridgeConfig, context: Context) -> None:
        """Open nothing yet but a recording.

        Raises:
            ConfigError: If the source lacks its port or recording, or the recording cannot be used.
        """
        super().__init__(config, context)
        self._state = StateFile(StoredMountings, self.user, PURPOSE)
        self._setting_lock = asyncio.Lock()
        stored_mountings = self._read_state()
        self._mounting = MountingSelection(config, stored_mountings)
        self._phone_mounting = MountingSelection.of_phone(stored_mountings)
        self.bus.warn("mounting", self._mounting.warning)

        # The own source: its samples in the arm's frame
        self._frame = ArmFrame(self._mounting.sensor_from_arm, math.radians(config.yaw_origin_deg))
        epoch_numbers = itertools.count(1)  # the two share them: no epoch occurs twice
        self._guard = guard_of(SOURCES, config.source, self.bus)
        self._wrist = DeviceWrist(
            f"{self.user}'s wrist ({config.source})",
            self._guard.label,
            YawEpoch(epoch_numbers),
            silence_s=config.silence_s,
            has_steady_time=self.clock.speed == 1.0,
        )
        self._source: Source = self._guard.made(self._make_source)
        self._is_made = True
        """False once the source has run: then a new one is made for the next run."""

        # What may replace it: a page, ROS, another service
        self._page = PageWrist(self._phone_mounting.sensor_from_arm, epoch_numbers)
        self._moved_by = ""
        """Name of the page's device (or ROS) that moves the wrist, or `""` for the own source."""
        self._release_timer = Timer(self.bus.call_later, self._on_release)
        self._other_writers: set[str] = set()
        """Other services that write this wrist's samples."""

        self._sample_numbers = itertools.count(1)

        # What it publishes, reports and serves
        self._button_numbers = itertools.count(1)
        self._step_numbers = itertools.count(1)
        self._samples = self.bus.publisher(topics.IMU, self.user)
        self._buttons = self.bus.publisher(topics.BUTTON, self.user)
        self._steps = self.bus.publisher(topics.STEP, self.user)
        self._time_s = steady_time()
        self._report_timer = Timer(self.bus.call_later, self._show_wrist)
        self._report_timer.start(REPORT_S)
        self._show_own_source()
        self.bus.serve(topics.SET_YAW_ORIGIN, self._set_yaw_origin, self.user)
        self.bus.serve(topics.SET_MOUNTING, self._set_mounting, self.user)
        self.bus.watch(topics.SERVICE_ALIVE, self._on_service)
        self.bus.subscribe(topics.WRIST, self._on_wrist, self.user)
        self.bus.subscribe(topics.FEEDBACK, self._on_feedback, self.user)

    @classmethod
    def validate_config(cls, config: ImuBridgeConfig) -> None:
        """Check the parameters of the source."""
        source = SOURCES.get(config.source)
        parameters = config.section(config.source)
        guard = PluginGuard(SOURCES.label(config.source), NullHealth())
        guard.made(lambda: source.check(parameters))

    async def run(self) -> None:
        """Publish the readings of the source. If it fails, a new one is made."""
        await self._guard.keep_running(self._run_source)

    async def _run_source(self) -> None:
        if not self._is_made:
            self._source = self._make_source()
        self._is_made = False
        try:
            await self._source.run(self._deliver)
        finally:
            self._wrist.monitor.on_disconnected("")

    def _make_source(self) -> Source:
        self.validate_config(self.config)
        name = self.config.source
        surroundings = self.surroundings(SOURCES.kind, name)
        surroundings = replace(surroundings, sensor_from_arm=self.config.configured_mounting)
        return SOURCES.get(name).make(self.config.section(name), surroundings)

    def _on_feedback(self, cue: Feedback, _user: str) -> None:
        source = self._source
        if isinstance(source, CueSource):
            self._guard.call("cue", lambda: source.cue(cue))

    def _deliver(self, item: Item) -> None:
        wrist = self._wrist
        sample = wrist.process_item(item, self.clock.now_ns(), self._time_s())
        has_page = self._has_page
        if sample is not None and not has_page:
            self._publish_sample(sample)
        if wrist.has_changed:
            self._show_warnings()
        if has_page or wrist.is_refused:
            return
        if isinstance(item, Press):
            seq = next(self._button_numbers)
            self._buttons.put(ButtonEvent(stamp_ns=item.stamp_ns, seq=seq, gesture=item.gesture))
        elif isinstance(item, StepGesture):
            seq = next(self._step_numbers)
            self._steps.put(Step(stamp_ns=item.stamp_ns, seq=seq, by=item.by))

    def _publish_sample(self, sample: SensorSample) -> None:
        self._samples.put(
            ImuSample(
                stamp_ns=sample.stamp_ns,
                seq=next(self._sample_numbers),
                orientation_xyzw=self._frame.orientation(sample.world_from_sensor),
                device_time_ns=sample.device_time_ns,
                battery=self._wrist.monitor.battery,
                yaw_epoch=self._wrist.epoch.count,
                mounting=self._mounting.label,
                latency_sigma_s=self.config.latency_sigma_s,
            )
        )

    def _show_wrist(self) -> None:
        self._report_timer.start(REPORT_S)
        for name, value, unit in self._wrist.report(self._time_s()):
            self.bus.set_metric(name, value, unit)
        self._show_warnings()

    def _show_own_source(self) -> None:
        """Report whether the arm moves without a page, phone or headset."""
        has_own_source = self.config.source != "page" or bool(self._other_writers)
        self.bus.set_metric(OWN_SOURCE, float(has_own_source), "")

    def _show_warnings(self) -> None:
        part = part_of(self.config.source)
        is_explained = any(self.bus.has_warning(code, part) for code in NO_DATA)
        for topic, message in self._wrist.warnings(self._time_s(), is_explained=is_explained):
            self.bus.warn(topic, message)
        idle_note = ""
        if self.config.source == "page" and not self._has_page and not self._other_writers:
            idle_note = (
                f"nobody moves the arm of {self.user} yet: take it in the page, by mouse or phone, or with a "
                "headset"
            )
        self.bus.warn(IDLE_ARM, idle_note, severity="note")

    @property
    def _has_page(self) -> bool:
        return self._page.is_active(self.clock.now_ns(), self.clock.speed)

    def _on_wrist(self, sample: WristSample, _user: str) -> None:
        orientation = self._page.process_sample(
            sample, self.clock.now_ns(), home=self._home_epoch(), speed=self.clock.speed
        )
        self._report_page(sample)
        self._release_timer.start(WRIST_PATIENCE_S)
        if orientation is None:
            return
        mounting = f"page {mover_name(sample)}"
        if sample.device == "phone":
            mounting = self._phone_mounting.label
        self._samples.put(
            ImuSample(
                stamp_ns=sample.stamp_ns,
                seq=next(self._sample_numbers),
                orientation_xyzw=orientation.orientation_xyzw,
                device_time_ns=orientation.device_time_ns,
                battery=sample.battery,
                yaw_epoch=orientation.yaw_epoch,
                mounting=mounting,
            )
        )

    def _home_epoch(self) -> int | None:
        """Return the number of the yaw origin while no page moves the wrist, or None if nothing else does."""
        if self._wrist.newest is None and not self._other_writers:
            return None
        return self._wrist.epoch.count

    def _on_service(self, instance: str, *, present: bool) -> None:
        service, _, user = instance.partition(".")
        if user != self.user or service == self.NAME:
            return
        if service not in topics.IMU.writers:
            return
        if present:
            self._other_writers.add(service)
        else:
            self._other_writers.discard(service)
        self._show_own_source()

    def _on_release(self) -> None:
        if self._has_page:
            self._release_timer.start(WRIST_PATIENCE_S)
        else:
            self._report_page(None)

    def _report_page(self, sample: WristSample | None) -> None:
        moved_by = mover_name(sample)
        if moved_by and moved_by != self._moved_by:
            log.info("%s: a page's %s moves the wrist", self.user, moved_by)
        elif moved_by != self._moved_by:
            log.info("%s: a page's %s has released the wrist", self.user, self._moved_by)
        self._moved_by = moved_by
        for name, value, unit in figures(self._page, sample):
            self.bus.set_metric(name, value, unit)
        for topic, message in warnings(self.user, self._page, sample):
            self.bus.warn(topic, message)

    async def _set_yaw_origin(self, query: SetYawOrigin, _user: str) -> Done:
        newest = self._wrist.newest
        try:
            if self._has_page:
                self._page.turn_to(query.yaw_rad)
            elif newest is not None:
                self._frame.set_azimuth(query.yaw_rad, newest)
                self._wrist.epoch.start_new_epoch()
            elif self.config.source == "page":
                raise RefusedError("nothing moves the wrist: connect a phone on a page and ask again")
            else:
                raise RefusedError("the IMU has sent nothing yet: connect it and ask again")
        except ValueError as error:
            raise RefusedError(str(error)) from error
        return Done(message=f"the arm's yaw is {math.degrees(query.yaw_rad):.1f}° now")

    async def _set_mounting(self, query: SetMounting, _user: str) -> SetMountingReply:
        async with self._setting_lock:  # so that the last setting is stored
            selection = self._selected_mounting()
            previous = selection.sensor_from_arm
            stored_mountings = selection.set(query, self.clock.now_ns())

            # Use it. A new one turns the samples, which begins an epoch of the yaw.
            is_new = selection.sensor_from_arm != previous
            if selection is self._phone_mounting:
                if is_new:
                    self._page.set_phone_mounting(selection.sensor_from_arm)
            else:
                self._frame.set_mounting(selection.sensor_from_arm)
                if is_new:
                    self._wrist.epoch.start_new_epoch()
                self.bus.warn("mounting", selection.warning)

            problem = ""
            if stored_mountings is not None:
                self._mounting.stored_mountings = stored_mountings
                self._phone_mounting.stored_mountings = stored_mountings
                problem = await self._store_mountings(stored_mountings)
        message = selection.describe()
        if problem:
            message += f"; it is used now, but not stored: {problem}"
        return SetMountingReply(message=message, sensor_from_arm_xyzw=selection.sensor_from_arm)

    def _selected_mounting(self) -> MountingSelection:
        """Return the mounting of the device that moves the wrist.

        Raises:
            RefusedError: If it is a page's mouse, or ROS.
        """
        if not self._has_page:
            return self._phone_mounting if self.config.source == "page" else self._mounting
        if self._page.device == "arm":
            raise RefusedError(
                "a page's mouse or ROS moves the wrist, and nothing is mounted on it: release it in the "
                "page, or stop its publisher in ROS, first"
            )
        return self._phone_mounting

    def _read_state(self) -> StoredMountings | None:
        try:
            return self._state.read()
        except ConfigError as error:
            self.bus.warn("state", f"the person's measured mounting is not used: {error}")
            return None

    async def _store_mountings(self, stored_mountings: StoredMountings) -> str:
        try:
            if stored_mountings.by_source:
                await asyncio.to_thread(self._state.write, stored_mountings)
            else:
                await asyncio.to_thread(self._state.erase)
        except ConfigError as error:
            self.bus.warn(UNWRITABLE, f"the person's mounting is used, but will be lost at the end: {error}")
            return str(error)
        self.bus.clear("state")
        self.bus.clear(UNWRITABLE)
        return ""


SERVICE = ImuBridge
