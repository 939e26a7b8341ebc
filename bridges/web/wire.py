"""The wire between the server and its pages; the contract of this folder's Python with `client`'s TypeScript.

One WebSocket, `/ws`, opened with the cookie that `/?token=...` has set and with the page's own origin.

Server to page:

- text, JSON, `{"kind": ...}`: `Hello` once, first; `Status` once a second and when it changes; `Answer` to
  each `Ask`. Their fields are the models below, named as they travel.
- binary, msgpack: a *batch* of what is new on the bus since the batch before, `[n, sent_ns, speed, states,
  events, dropped]`. `n` counts batches from 1; `sent_ns` is the site's time when it was sent, which runs
  `speed` times as fast as the wall's; `states` and `events` are lists of `[topic, name, payload]`: the key
  pattern of the topic table (`users/{user}/cursor`), what stands for its placeholder (empty where there is
  none) and the message as on the bus, msgpack, itself bytes. `states` has of each key (latest and state
  topics) the newest only, and nil instead of a payload where the key's message is no longer true (its writer,
  person or scenario has gone): the page forgets it; `events` has every event in order, `dropped` counts those
  of this page that were lost because it was too slow. The first batch has the newest of everything that is
  still true; its events happened before the page came (at most `latest_values.HISTORY`, those of the
  selector's journal among them, see `history`), for its messages. States of a person may come before
  `Status.people` has them: it decides who is shown.

Page to server, JSON text, `{"kind": ...}`:

- `Ack` for every batch, once, from the animation frame that shows it. At most `IN_FLIGHT` batches are on
  their way; a page that does not acknowledge gets nothing more until it does, and then the newest. A second
  `Ack` of a batch is malformed.
- `Ask`, answered with the same `id`: a request of the table, or an action of this server (`Deed`).
  `Hello.requests` and `Hello.deeds` have those that the role may ask for; `Status.services` tells whether
  the server of a request is present.
- `AimAt`, many a second, not answered: where the mouse points to, of the person whose wrist this page has.
- `HeadsetMotion`, the same of a headset: head and hand of the person.

A page with a playback, at `/ws` of `pointit page` or at `/ws/past` of a running site, gets the
same, with the site's time and speed being those of the playback (speed 0: paused), and besides:

- `Timeline` first, and again when more of it is read; `Playing` when the page begins, and after each `Play`.
  With `Playing.has_jumped` what follows are differences to another instant, and no events from between.
- It sends `Play`, not answered. Its requests are refused.

A phone speaks `Turn` and `Ask` on `/ws/wrist`, or posts a list of them to `/wrist`; it is answered with
`Hello`, `Answer`s, and `Cue`s (see `phone`). It measures the round trip by an `Ask` for nothing, which is
refused at once. Its socket is closed with `UNPAIRED` or `REPLACED` where it is not to come back.
"""

import json
from collections.abc import Mapping
from typing import Annotated, Any, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, PrivateAttr

from pointit.schemas.base import Fraction, Name, QuaternionXyzw, Real, Vec3

Role = Literal["operator", "viewer", "wrist"]
"""Operator (control), viewer, or one person's phone."""

Mover = Literal["own", "mouse", "phone", "headset"]
"""Mover of a person's wrist: their own source, a page's mouse or headset, a phone."""

ArmSource = Literal["unknown", "none", "device", "simulation"]
"""Source of the movements of a person's arm while no page or phone has it. Unknown: not reported yet."""
