"""Tokens of phones: one phone, one person, and nothing that lasts longer than it should."""

import xml.etree.ElementTree as ET

from pointit.bridges.web.wrists.pairing import UNUSED_S, Pairing, offer


def test_a_token_makes_a_phone_one_persons() -> None:
    pairing = Pairing()
    token, replaced = pairing.pair("anna", 0.0)
    assert replaced == ""
    secret = pairing.redeem(token, 1.0)
    assert secret is not None
    assert secret != token
    phone = pairing.phone(secret)
    assert phone is not None
    assert (phone.user, phone.page) == ("anna", pairing.paired("anna", 1.0))
    assert pairing.phone(token) is None
    assert pairing.phone("") is None
    assert pairing.redeem("other", 1.0) is None
    assert pairing.redeem("", 1.0) is None


def test_an_unused_token_expires_a_used_ones_phone_stays() -> None:
    pairing = Pairing()
    unused, _ = pairing.pair("anna", 0.0)
    used, _ = pairing.pair("ben", 0.0)
    secret = pairing.redeem(used, 1.0)
    late_s = UNUSED_S + 1.0
    assert pairing.paired("anna", UNUSED_S - 1.0) != ""
    assert pairing.redeem(unused, late_s) is None
    assert pairing.paired("anna", late_s) == ""
    assert secret is not None
    assert pairing.phone(secret) is not None
    assert pairing.paired("ben", late_s) != ""
    assert pairing.redeem(used, late_s) is None


def test_a_token_shown_again_moves_the_phone_to_another_browser() -> None:
    pairing = Pairing()
    token, _ = pairing.pair("anna", 0.0)
    first, second = pairing.redeem(token, 1.0), pairing.redeem(token, 2.0)
    assert first is not None
    assert second is not None
    assert pairing.phone(first) is None
    assert pairing.phone(second) is not None


def test_pairing_anew_and_unpairing_revoke() -> None:
    pairing = Pairing()
    token, _ = pairing.pair("anna", 0.0)
    secret = pairing.redeem(token, 1.0)
    assert secret is not None
    page = pairing.paired("anna", 1.0)
    newer, replaced = pairing.pair("anna", 2.0)
    assert replaced == page
    assert pairing.phone(secret) is None
    assert pairing.redeem(token, 3.0) is None
    other = pairing.redeem(newer, 3.0)
    assert other is not None
    assert pairing.unpair("anna") not in ("", page)
    assert pairing.phone(other) is None
    assert pairing.paired("anna", 3.0) == ""
    assert pairing.unpair("anna") == ""


def test_the_offer_has_a_qr_code_that_a_strict_page_may_show() -> None:
    reply = offer("https://192.168.1.20:8443/phone?token=abc", "AB:CD")
    assert (reply["url"], reply["fingerprint"]) == ("https://192.168.1.20:8443/phone?token=abc", "AB:CD")
    assert reply["expires_s"] == UNUSED_S
    drawn = ET.fromstring(reply["qr_svg"])  # noqa: S314 - our own
    assert drawn.tag == "{http://www.w3.org/2000/svg}svg"
    assert all("style" not in node.attrib for node in drawn.iter())
    assert len(reply["qr_svg"]) < 16_000
