"""Which mounting is in use: the configured one, or one that was measured and kept."""

from pydantic import Field

from pointit.geometry import rotation
from pointit.schemas import SetMounting
from pointit.schemas.base import Ns, QuaternionXyzw, SchemaModel
from pointit.services.imu_bridge.config import ImuBridgeConfig, MountingName

PURPOSE = "mounting"
"""Under this name it is kept, a file for each person."""

PHONE = "phone"
"""Among the kinds of sources: a page's phone, whatever the source of imu-bridge itself is."""


class StoredMounting(SchemaModel):
    """A measured mounting, and what was configured then."""

    sensor_from_arm_xyzw: QuaternionXyzw
    configured: MountingName
    set_ns: Ns


class StoredMountings(SchemaModel):
    """What is kept for a person: a mounting for each kind of source, as each is another device."""

    by_source: dict[str, StoredMounting] = Field(default_factory=dict[str, StoredMounting])


class MountingSelection:
    """How the person wears the sensor now; a rotation in the configuration wins over one that was kept."""

    def __init__(
        self, config: ImuBridgeConfig, kept: StoredMountings | None = None, *, key: str | None = None
    ) -> None:
        """Take what is configured and `kept`, there under `key`; none: under the source."""
        self._config = config
        self._key = key or config.source
        self.kept = kept or StoredMountings()
        """Of all kinds of sources."""
        self.sensor_from_arm = config.configured_mounting
        self.is_measured = False
        """Whether it is other than configured."""
        self.warning = ""
        """One sentence when something is kept and not used; empty when not."""
        own = self.kept.by_source.get(self._key)
        if own is None:
            return
        if config.explicit_mounting is not None:
            self.warning = (
                "a mounting was measured, but mounting_xyzw or mounting_rpy_deg is configured and wins: take "
                "it out of the configuration, or forget what was measured with `pointit calibrate mounting "
                "USER --erase`"
            )
        elif own.configured != config.mounting:
            self.warning = (
                f"a mounting was measured while {own.configured} was configured, now it is "
                f"{config.mounting}, as for another device: what was measured is not used; run "
                "`pointit calibrate mounting USER` again"
            )
        else:
            self.sensor_from_arm = rotation.normalized(own.sensor_from_arm_xyzw)
            self.is_measured = True

    @classmethod
    def of_phone(cls, kept: StoredMountings | None = None) -> "MountingSelection":
        """Return how a page's phone is worn."""
        return cls(ImuBridgeConfig(source="page", mounting="phone"), kept, key=PHONE)

    def set(self, query: SetMounting, now_ns: int) -> StoredMountings | None:
        """Take what was asked for; return what is to be kept from now on, or none when that is as before.

        A relative rotation that turns nothing only asks: it changes nothing.
        """
        wanted = query.sensor_from_arm_xyzw
        others = {name: kept for name, kept in self.kept.by_source.items() if name != self._key}
        if wanted is None:
            self.sensor_from_arm = self._config.configured_mounting
            self.is_measured = False
            self.warning = ""
            self.kept = StoredMountings(by_source=others)
            return self.kept
        if query.is_relative:
            if wanted[:3] == (0.0, 0.0, 0.0):
                return None
            self.sensor_from_arm = rotation.normalized(rotation.multiply(self.sensor_from_arm, wanted))
        else:
            self.sensor_from_arm = rotation.normalized(wanted)
        self.is_measured = True
        self.warning = ""
        own = StoredMounting(
            sensor_from_arm_xyzw=self.sensor_from_arm, configured=self._config.mounting, set_ns=now_ns
        )
        self.kept = StoredMountings(by_source={**others, self._key: own})
        return self.kept

    def describe(self) -> str:
        """Return one sentence on what is in use."""
        x, y, z, w = self.sensor_from_arm
        which = f"x {x:.3f}, y {y:.3f}, z {z:.3f}, w {w:.3f}"
        config = self._config
        if self.is_measured:
            wins = config.explicit_mounting is not None
            until = ", until the next start, where the configured rotation wins" if wins else ""
            return f"the mounting is as measured ({which}){until}"
        by_name = config.explicit_mounting is None
        return f"the mounting is as configured ({config.mounting if by_name else which})"
