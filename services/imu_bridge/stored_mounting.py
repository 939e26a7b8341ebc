"""Selection of the mounting: the configured one, or one that was measured and stored."""

import math

from pydantic import Field

from pointit.geometry import rotation
from pointit.runtime.host.advised_commands import advised_commands
from pointit.schemas import SetMounting
from pointit.schemas.base import Ns, QuaternionXyzw, SchemaModel
from pointit.services.imu_bridge.config import ImuBridgeConfig, MountingName

PURPOSE = "mounting"
"""Name of the state file of each person."""
PHONE = "phone"
"""Key of a page's phone among the sources, whatever the source of imu-bridge itself is."""


class StoredMounting(SchemaModel):
    """A measured mounting, and the configuration at that time."""

    sensor_from_arm_xyzw: QuaternionXyzw
    configured: MountingName
    set_ns: Ns


class StoredMountings(SchemaModel):
    """Stored mountings of a person, one for each kind of source, since each is another device."""

    by_source: dict[str, StoredMounting] = Field(default_factory=dict[str, StoredMounting])


class MountingSelection:
    """The mounting in use: the stored one, or the configured one."""

    def __init__(
        self,
        config: ImuBridgeConfig,
        stored_mountings: StoredMountings | None = None,
        *,
        key: str | None = None,
    ) -> None:
        """Select between the configured and the `stored_mountings` mounting of `key`. None: the source's."""
        self._config = config
        self._key = key or config.source
        self.stored_mountings = stored_mountings or StoredMountings()
        """Stored mountings of all kinds of sources."""
        self.sensor_from_arm = config.configured_mounting
        self.is_measured = False
        """True if it differs from the configured one."""
        self.warning = ""
        """Warning that a stored mounting is not used, or `""`."""

        # The measurement is of one device, which the configured mounting tells apart
        own = self.stored_mountings.by_source.get(self._key)
        if own is None:
            return
        if own.configured != config.mounting:
            calibrate = advised_commands().command("pointit person calibrate mounting USER", "USER")
            self.warning = (
                f"a mounting was measured while {own.configured} was configured, now it is "
                f"{config.mounting}, as for another device: the measurement is not used; run {calibrate} "
                "again"
            )
        else:
            self.sensor_from_arm = rotation.normalized(own.sensor_from_arm_xyzw)
            self.is_measured = True

    @classmethod
    def of_phone(cls, stored_mountings: StoredMountings | None = None) -> "MountingSelection":
        """Return the mounting of a page's phone."""
        return cls(ImuBridgeConfig(source="page", mounting="phone"), stored_mountings, key=PHONE)

    @property
    def label(self) -> str:
        """Return the source and its mounting, as in `ImuSample`; a rotation in thousandths, with w >= 0."""
        if not self.is_measured:
            return f"{self._key} {self._config.mounting}"
        sign = math.copysign(1.0, self.sensor_from_arm[3])  # q and -q are the same rotation
        numbers = " ".join(f"{sign * value:.3f}" for value in self.sensor_from_arm)
        return f"{self._key} {numbers}"

    def set(self, query: SetMounting, now_ns: int) -> StoredMountings | None:
        """Set the requested mounting. Return the mountings to store, or None if they are unchanged.

        A relative rotation by 0 changes nothing and serves as a query.
        """
        requested = query.sensor_from_arm_xyzw
        others = dict(self.stored_mountings.by_source)
        others.pop(self._key, None)

        # No mounting: return to the configured one
        if requested is None:
            self.sensor_from_arm = self._config.configured_mounting
            self.is_measured = False
            self.warning = ""
            self.stored_mountings = StoredMountings(by_source=others)
            return self.stored_mountings

        # A mounting, relative to the present one or to the sensor
        if query.is_relative:
            if requested[:3] == (0.0, 0.0, 0.0):
                return None
            self.sensor_from_arm = rotation.normalized(rotation.multiply(self.sensor_from_arm, requested))
        else:
            self.sensor_from_arm = rotation.normalized(requested)
        self.is_measured = True
        self.warning = ""
        own = StoredMounting(
            sensor_from_arm_xyzw=self.sensor_from_arm, configured=self._config.mounting, set_ns=now_ns
        )
        self.stored_mountings = StoredMountings(by_source={**others, self._key: own})
        return self.stored_mountings

    def describe(self) -> str:
        """Return a message about the mounting in use."""
        x, y, z, w = self.sensor_from_arm
        if self.is_measured:
            return f"the mounting is as measured (x {x:.3f}, y {y:.3f}, z {z:.3f}, w {w:.3f})"
        return f"the mounting is as configured ({self._config.mounting})"
