"""Reads a device, a recording or a simulation, writes samples of the arm's orientation and button events."""

import asyncio
import math
from pathlib import Path
from typing import ClassVar

from pointit.runtime import ConfigError, Context, RefusedError, Service
from pointit.runtime.service import Scope
from pointit.runtime.state import StateFile
from pointit.schemas import (
    ButtonEvent,
    Done,
    ImuSample,
    SetMounting,
    SetMountingReply,
    SetYawOrigin,
)
from pointit.schemas.topics import BUTTON, IMU, SET_MOUNTING, SET_YAW_ORIGIN
from pointit.services.imu_bridge.arm_frame import ArmFrame
from pointit.services.imu_bridge.config import ImuBridgeConfig
from pointit.services.imu_bridge.kept_mounting import PURPOSE, KeptMountings, Wearing
from pointit.services.imu_bridge.reading import Item, Press, Reading, Reconnected, Source
from pointit.services.imu_bridge.replay_source import ReplaySource
from pointit.services.imu_bridge.serial_source import SerialSource
from pointit.services.imu_bridge.simulated import SimulatedSource
from pointit.services.imu_bridge.yaw_epoch import YawEpoch
from pointit.sim.recordings import read_imu_csv


class ImuBridge(Service[ImuBridgeConfig]):
    """Publishes the orientation of one person's arm from a serial device, a recording or a simulation."""

    NAME: ClassVar[str] = "imu-bridge"
    SCOPE: ClassVar[Scope] = "user"
    CONFIG = ImuBridgeConfig

    def __init__(self, config: ImuBridgeConfig, context: Context) -> None:
        """Open nothing yet but a recording.

        Raises:
            ConfigError: the source lacks its port or recording, or the recording cannot be used.
        """
        super().__init__(config, context)
        _check_named(config)
        self._state = StateFile(KeptMountings, self.user, PURPOSE)
        self._setting = asyncio.Lock()
        self._wearing = Wearing(config, self._read_state())
        self._tell("mounting", self._wearing.warning)
        self._frame = ArmFrame(self._wearing.sensor_from_arm, math.radians(config.yaw_origin_deg))
        self._epoch = YawEpoch()
        self._newest: Reading | None = None
        self._sample_count = 0
        self._button_count = 0
        self._source = self._make_source()
        self._samples = self.bus.publisher(IMU, self.user)
        self._buttons = self.bus.publisher(BUTTON, self.user)
        self.bus.serve(SET_YAW_ORIGIN, self._set_yaw_origin, self.user)
        self.bus.serve(SET_MOUNTING, self._set_mounting, self.user)

    @classmethod
    def check(cls, config: ImuBridgeConfig) -> None:
        """Refuse a source without its port, or without a recording that can be read."""
        _check_named(config)
        if config.source == "replay":
            read_imu_csv(Path(config.replay.recording))

    async def run(self) -> None:
        """Hand on what the source reads."""
        await self._source.run(self._deliver)

    def _make_source(self) -> Source:
        config = self.config
        if config.source == "serial":
            return SerialSource(config.serial, self.clock, self.bus)
        if config.source == "replay":
            return ReplaySource(config.replay, self.clock)
        return SimulatedSource(config.simulated, config.configured_mounting, self.clock)

    def _deliver(self, item: Item) -> None:
        if isinstance(item, Reconnected):
            self._epoch.reconnected()
            return
        if isinstance(item, Press):
            self._button_count += 1
            self._buttons.put(
                ButtonEvent(stamp_ns=item.stamp_ns, seq=self._button_count, gesture=item.gesture)
            )
            return
        self._newest = item
        self._sample_count += 1
        device_time_ns = self._epoch.read(item.device_time_ns)
        self._samples.put(
            ImuSample(
                stamp_ns=item.stamp_ns,
                seq=self._sample_count,
                orientation_xyzw=self._frame.orientation(item.world_from_sensor),
                device_time_ns=device_time_ns,
                yaw_epoch=self._epoch.count,
            )
        )

    async def _set_yaw_origin(self, query: SetYawOrigin, _user: str) -> Done:
        if self._newest is None:
            raise RefusedError("the IMU has sent nothing yet: connect it and ask again")
        try:
            self._frame.turn_to(query.yaw_rad, self._newest.world_from_sensor)
        except ValueError as error:
            raise RefusedError(str(error)) from error
        self._epoch.set_anew()
        return Done(message=f"the arm's yaw is {math.degrees(query.yaw_rad):.1f}° now")

    async def _set_mounting(self, query: SetMounting, _user: str) -> SetMountingReply:
        async with self._setting:  # what is kept is what was set last
            before = self._wearing.sensor_from_arm
            kept = self._wearing.set(query, self.clock.now_ns())
            self._frame.set_mounting(self._wearing.sensor_from_arm)
            if self._wearing.sensor_from_arm != before:
                self._epoch.set_anew()
            self._tell("mounting", self._wearing.warning)
            trouble = "" if kept is None else await self._keep(kept)
        message = self._wearing.describe() + (f"; it is used now, but not kept: {trouble}" if trouble else "")
        return SetMountingReply(message=message, sensor_from_arm_xyzw=self._wearing.sensor_from_arm)

    def _read_state(self) -> KeptMountings | None:
        try:
            return self._state.read()
        except ConfigError as error:
            self.bus.warn("state", f"the person's measured mounting is not used: {error}")
            return None

    async def _keep(self, kept: KeptMountings) -> str:
        """Write or erase what outlives this process; return what went wrong."""
        try:
            if kept.by_source:
                await asyncio.to_thread(self._state.write, kept)
            else:
                await asyncio.to_thread(self._state.erase)
        except ConfigError as error:
            self.bus.warn("state", f"the person's mounting is used, but will be lost at the end: {error}")
            return str(error)
        self.bus.clear("state")
        return ""

    def _tell(self, topic: str, warning: str) -> None:
        if warning:
            self.bus.warn(topic, warning)
        else:
            self.bus.clear(topic)


def _check_named(config: ImuBridgeConfig) -> None:
    if config.source == "serial" and not config.serial.port:
        raise ConfigError("serial.port: is missing; name the device's port, as in serial.port=/dev/ttyUSB0")
    if config.source == "replay" and not config.replay.recording:
        raise ConfigError("replay.recording: is missing; name a CSV file with columns t, qw, qx, qy, qz")


SERVICE = ImuBridge
