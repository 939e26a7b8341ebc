"""Wrists that send datagrams: SlimeVR trackers, and apps of phones and watches."""
