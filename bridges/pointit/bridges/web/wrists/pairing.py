"""Pairing phones: a token in a QR code makes one phone one person's wrist, and nothing else."""

import hashlib
import io
import secrets
from dataclasses import dataclass
from typing import Any

import segno

UNUSED_S = 600.0
"""A token opens for so long; the phone that has used it stays paired."""


@dataclass(slots=True, kw_only=True)
class Phone:
    """A paired phone, or one that is to be."""

    user: str
    page: str
    """Under which it has the person's wrist; another with every pairing."""
    expires_s: float
    token: bytes
    secret: bytes = b""
    """Of the cookie; empty: not used yet."""


def _digest(text: str) -> bytes:
    return hashlib.sha256(text.encode()).digest()


class Pairing:
    """Which phones are paired; times are of any clock that only goes forward, s."""

    def __init__(self) -> None:
        """Begin with none."""
        self._phones: dict[str, Phone] = {}
        self._count = 0

    def pair(self, user: str, now_s: float) -> tuple[str, str]:
        """Return a new token for a phone of `user` and the page id of the one that it replaces, if any."""
        replaced = self.unpair(user)
        token = secrets.token_urlsafe(24)
        self._count += 1
        self._phones[user] = Phone(
            user=user, page=f"phone{self._count}", expires_s=now_s + UNUSED_S, token=_digest(token)
        )
        return token, replaced

    def redeem(self, token: str, now_s: float) -> str | None:
        """Return the cookie's secret for a phone that shows `token`, or none.

        A token may be shown again while it opens, as when another browser of the phone takes over; the last
        one counts.
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
        return next((p for p in self._phones.values() if secrets.compare_digest(p.secret, shown)), None)

    def unpair(self, user: str) -> str:
        """Revoke token and cookie of the phone of `user`; return its page id, empty where there was none."""
        phone = self._phones.pop(user, None)
        return "" if phone is None else phone.page

    def paired(self, user: str, now_s: float) -> str:
        """Return the page id of the phone of `user`, or empty: none is paired, nor can be any more."""
        phone = self._phones.get(user)
        if phone is None or (not phone.secret and now_s >= phone.expires_s):
            return ""
        return phone.page


def offer(url: str, fingerprint: str) -> dict[str, Any]:
    """Return what the operator's page shows for a phone to be paired by opening `url`."""
    drawn = io.BytesIO()
    segno.make(url, error="m", micro=False).save(
        drawn,
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
        "qr_svg": drawn.getvalue().decode(),
        "expires_s": UNUSED_S,
        "fingerprint": fingerprint,
    }
