"""Pairing phones: a token in a QR code makes one phone one person's wrist, and nothing else."""

import hashlib
import io
import secrets
from dataclasses import dataclass
from typing import Any

UNUSED_S = 600.0
"""Validity of an unused token, s. A phone that has used it stays paired."""


@dataclass(slots=True, kw_only=True)
class Phone:
    """A phone that is or will be paired."""

    user: str
    page: str
    """Page id that holds the person's wrist; a new one with every pairing."""
    expires_s: float
    token: bytes
    secret: bytes = b""
    """Secret of the cookie, or `b""` until the token is used."""


def _digest(text: str) -> bytes:
    return hashlib.sha256(text.encode()).digest()


class Pairing:
    """Paired phones; times are of any monotonic clock, s."""

    def __init__(self) -> None:
        self._phones: dict[str, Phone] = {}
        self._count = 0

    def pair(self, user: str, now_s: float, token: str = "") -> tuple[str, str]:
        """Return a token for a phone of `user`, and the page id of the one it replaces, or `""`.

        The token is a new one unless it is given.
        """
        replaced = self.unpair(user)
        token = token or secrets.token_urlsafe(24)
        self._count += 1
        page = f"phone{self._count}"
        expires_s = now_s + UNUSED_S
        self._phones[user] = Phone(user=user, page=page, expires_s=expires_s, token=_digest(token))
        return token, replaced

    def redeem(self, token: str, now_s: float) -> str | None:
        """Return the cookie's secret for a phone that shows `token`, or None if it is invalid.

        A valid token may be shown again, as when another browser of the phone takes over. The last use
        counts.
        """
        shown = _digest(token)
        for phone in self._phones.values():
            if secrets.compare_digest(phone.token, shown) and now_s < phone.expires_s:
                secret = secrets.token_urlsafe(24)
                phone.secret = _digest(secret)
                return secret
        return None

    def phone(self, secret: str) -> Phone | None:
        """Return the phone whose cookie has `secret`."""
        shown = _digest(secret)
        for phone in self._phones.values():
            if secrets.compare_digest(phone.secret, shown):
                return phone
        return None

    def unpair(self, user: str) -> str:
        """Revoke token and cookie of the phone of `user`, and return its page id, or `""` if none."""
        phone = self._phones.pop(user, None)
        return "" if phone is None else phone.page

    def paired(self, user: str, now_s: float) -> str:
        """Return the page id of the phone of `user`, or `""` if none is paired or may still be."""
        phone = self._phones.get(user)
        if phone is None:
            return ""
        has_expired = not phone.secret and now_s >= phone.expires_s
        return "" if has_expired else phone.page


def offer(url: str, fingerprint: str) -> dict[str, Any]:
    """Return the QR code and its facts for the operator's page; a phone that opens `url` is paired."""
    import segno  # noqa: PLC0415 - 3 MB, only for pairing

    svg = io.BytesIO()
    code = segno.make(url, error="m", micro=False)
    code.save(
        svg,
        kind="svg",
        scale=4,
        border=4,
        light="#fff",
        dark="#000",
        xmldecl=False,
        svgclass=None,
        lineclass=None,
    )
    return {
        "url": url,
        "qr_svg": svg.getvalue().decode(),
        "expires_s": UNUSED_S,
        "fingerprint": fingerprint,
    }
