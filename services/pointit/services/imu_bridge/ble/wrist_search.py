"""Search for one wrist by its advertisements, among others of its kind."""

import asyncio
import contextlib
import functools
from collections.abc import Callable

from pointit.runtime.service.surroundings import WarningSink
from pointit.services.imu_bridge.ble.radio import Advertisement, scanning
from pointit.services.imu_bridge.ble.wrist import BleConfig, Kind

SCAN_S = 5.0
"""Duration of a scan, s. After one without a result there is a warning, and the next begins."""
COMPARE_S = 1.0
"""Time for which further wrists are searched when the first is found and no address was given, s."""
NAMED = 5
"""Number of wrists within reach that a warning names."""


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
        self._wanted = config.wanted.lower()
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
            self._warn(self._absence(advertisements))

    def _on_advertisement(
        self,
        advertisements: dict[str, Advertisement],
        next_advertisement: asyncio.Future[Advertisement],
        advertisement: Advertisement,
    ) -> None:
        if advertisement.address.lower() != self._wanted and not self._kind.includes(advertisement):
            return
        identity = self.identify(advertisement)
        advertisements[identity] = advertisement
        if (
            not next_advertisement.done()
            and identity not in self.refused
            and self._is_eligible(advertisement)
        ):
            next_advertisement.set_result(advertisement)

    def identify(self, advertisement: Advertisement) -> str:
        """Return the identity of a wrist in lower case: its address, or the identifier of its kind."""
        return self._kind.identify(advertisement).lower()

    def is_named(self, advertisement: Advertisement) -> bool:
        """Return True if the wanted text is its identity, its address, or begins its name."""
        wanted = self._wanted
        identities = (self.identify(advertisement), advertisement.address.lower())
        return wanted != "" and (wanted in identities or advertisement.name.lower().startswith(wanted))

    def _is_eligible(self, advertisement: Advertisement) -> bool:
        """Return True unless it cannot be the wanted one. Serial numbers are known when it is connected."""
        if self.used:
            return self.identify(advertisement) == self.used
        is_serial_number = self._kind.has_serial_number and not self._wanted.startswith(
            tuple(name.lower() for name in self._kind.names)
        )
        may_differ = not self._wanted or (is_serial_number and not self._is_address)
        return may_differ or self.is_named(advertisement)

    @property
    def _is_address(self) -> bool:
        """Return True if the wanted wrist is named by its address."""
        return ":" in self._wanted or self._wanted.count("-") == 4

    def _warn_others(self, used: Advertisement, advertisements: dict[str, Advertisement]) -> None:
        """Warn if other wrists are as eligible as `used`. A serial number is unique."""
        kind, is_named = self._kind, self._wanted != "" and used.name.lower().startswith(self._wanted)
        others = [
            each.label
            for identity, each in advertisements.items()
            if identity != self.identify(used) and self._is_eligible(each)
        ]
        sentence = (
            f"several wrists of the kind {kind.label} are within reach: {used.label} is used, not "
            f"{', '.join(others[:NAMED])}; set {kind.plugin}.sensor to the address of the right one"
        )
        self._warnings.warn("sensors", sentence if others and (is_named or not self._wanted) else "")

    def _absence(self, advertisements: dict[str, Advertisement]) -> str:
        what = f"no {self._kind.label}"
        wanted = (self.used if advertisements else "") or self._config.wanted
        if wanted:
            what = f"{self._kind.label} {wanted}"
        labels = [each.label for each in advertisements.values()]
        more = f" and {len(labels) - NAMED} more" if len(labels) > NAMED else ""
        others = (", ".join(labels[:NAMED]) or "none") + more
        verb = "is not heard" if wanted else "is heard"
        if wanted == self.used != "":
            others += f"; to use one of them, set {self._kind.plugin}.sensor"
        return (
            f"{what} {verb}; searching: switch it on, bring it near, and disconnect it from other programs "
            f"and phones (others within reach: {others})"
        )
