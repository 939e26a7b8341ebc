"""The topic table for others: as an AsyncAPI 3 document and as a table for people."""

from collections.abc import Iterable, Sequence
from typing import Any

from pointit.schemas.base import MAX_ID, NAME_PATTERN, Message, Query
from pointit.schemas.codec import MEDIA_TYPE
from pointit.schemas.topics import PRESENCES, REQUESTS, TOPICS, Request, Topic

Kind = type[Message] | type[Query]

VERSION = "1.0.0"
"""Version of the set of keys. Every message has a version of its own."""
_ABOUT = (
    "What travels on PointIt's Zenoh bus. Addresses are relative to the session's namespace, "
    f"`pointit/<site>`. Payloads are msgpack maps with the field names; the Zenoh encoding is `{MEDIA_TYPE}` "
    "with the message's name and version (`ImuSample.v1`) as its schema.\n\nA `get` on `KEY/@adv/**?_anyke` "
    "returns the last value of the state `KEY` from its writer; a `get` on `KEY`, that of one that is gone. "
    "A request is a `get` on its key with the query as payload. An error reply is one sentence, UTF-8: the "
    f"reason of a refusal. Ids have at most {MAX_ID} characters. Names of people, lamps, robots, services "
    f"and carriers in messages are parts of keys, too: they match `{NAME_PATTERN}`."
)


def document() -> dict[str, Any]:
    """Return the AsyncAPI 3.0 document; schemas are referred to as `messages/<Name>.v<N>.json`."""
    kinds: dict[str, Kind] = {}
    channels: dict[str, Any] = {}
    operations: dict[str, Any] = {}
    # Topics: all are sent, and some are received, too
    for topic in TOPICS:
        name = channel_name(topic.key)
        kinds[topic.message.__name__] = topic.message
        channels[name] = _topic_channel(topic)
        about = topic.about
        operations[f"{name}.send"] = _operation("send", name, topic.message, about)
        if "external" in topic.writers:
            operations[f"{name}.receive"] = _operation("receive", name, topic.message, about)

    # Requests: an operation of the server, whose reply has the channel of the query
    for request in REQUESTS:
        name = channel_name(request.key)
        kinds[request.query.__name__] = request.query
        kinds[request.reply.__name__] = request.reply
        channels[name] = _request_channel(request)
        reply_message = f"#/channels/{name}/messages/{request.reply.__name__}"
        reply = {"channel": {"$ref": f"#/channels/{name}"}, "messages": [{"$ref": reply_message}]}
        operation = _operation("receive", name, request.query, request.about)
        operations[f"{name}.answer"] = {**operation, "reply": reply}
    info = {"title": "PointIt", "version": VERSION, "description": _ABOUT, "license": {"name": "MIT"}}
    messages = {name: _message(kind) for name, kind in kinds.items()}
    return {
        "asyncapi": "3.0.0",
        "info": info,
        "defaultContentType": MEDIA_TYPE,
        "channels": channels,
        "operations": operations,
        "components": {"messages": messages},
    }


def channel_name(key: str) -> str:
    """Return a key as an identifier: `users/{user}/imu` becomes `users.user.imu`."""
    return key.replace("{", "").replace("}", "").replace("/", ".")


def first_sentence(kind: Kind) -> str:
    """Return the first sentence of a message's docstring."""
    paragraph = (kind.__doc__ or "").split("\n\n")[0]
    text = " ".join(paragraph.split())
    return text.partition(". ")[0].removesuffix(".")


def tables() -> list[tuple[str, Sequence[str], list[Sequence[str]]]]:
    """Return title, headings and rows of the tables of topics, requests and presences."""
    topics: list[Sequence[str]] = []
    for topic in TOPICS:
        rate = "on change" if topic.rate_hz is None else f"{topic.rate_hz:g} Hz"
        writers = ", ".join(topic.writers)
        message = topic.message.schema_name()
        topics.append((topic.key, message, topic.delivery.value, rate, writers, topic.about))
    requests: list[Sequence[str]] = []
    for request in REQUESTS:
        query = request.query.schema_name()
        reply = request.reply.schema_name()
        requests.append((request.key, query, reply, request.server, request.about))
    presences: list[Sequence[str]] = [(presence.key, presence.about) for presence in PRESENCES]
    return [
        ("Topics", ("key", "message", "delivery", "rate", "written by", "about"), topics),
        ("Requests", ("key", "query", "reply", "answered by", "about"), requests),
        ("Presence", ("key", "about"), presences),
    ]


def readme() -> str:
    """Return the catalogue's front page, Markdown."""
    lines = [
        "# Catalogue of what travels",
        "",
        "Generated from `schemas/topics.py` by `pointit topic schema --write`; do not edit.",
        "",
        _ABOUT,
        "",
        "- `asyncapi.json`: all of this as an AsyncAPI 3.0 document.",
        "- `messages/`: one JSON Schema a message and version; what is here never changes.",
        "- `samples/`: one msgpack payload a message and version, every field set; today's code reads all.",
        "",
        "Messages only grow: a new field has a default and raises the message's `version` by one. Anything",
        "else is a new message. Then `pointit topic schema --write`, and commit what it wrote.",
    ]
    for title, headings, rows in tables():
        lines += ["", f"## {title}", "", *_markdown(headings, rows)]
    return "\n".join(lines) + "\n"


def _markdown(headings: Sequence[str], rows: Iterable[Sequence[str]]) -> list[str]:
    head = "| " + " | ".join(headings) + " |"
    lines = [head, "|" + "---|" * len(headings)]
    for row in rows:
        cells = [_cell(heading, text) for heading, text in zip(headings, row, strict=True)]
        lines.append("| " + " | ".join(cells) + " |")
    return lines


def _cell(heading: str, text: str) -> str:
    """Return the Markdown of a cell: names of messages are links, and keys are code."""
    if heading in {"message", "query", "reply"}:
        return f"[{text}](messages/{text}.json)"
    if heading == "key":
        return f"`{text}`"
    return text


def _topic_channel(topic: Topic[Any]) -> dict[str, Any]:
    channel = _channel(topic.key, topic.placeholder, [topic.message], topic.about)
    return {
        **channel,
        "x-delivery": topic.delivery.value,
        "x-max-bytes": topic.message.max_bytes,
        "x-rate-hz": topic.rate_hz,
        "x-writers": list(topic.writers),
    }


def _request_channel(request: Request[Any, Any]) -> dict[str, Any]:
    kinds = [request.query, request.reply]
    channel = _channel(request.key, request.placeholder, kinds, request.about)
    return {
        **channel,
        "x-delivery": "request",
        "x-max-bytes": request.query.max_bytes,
        "x-server": request.server,
    }


def _channel(key: str, placeholder: str, kinds: Iterable[Kind], about: str) -> dict[str, Any]:
    messages: dict[str, Any] = {}
    for kind in kinds:
        messages[kind.__name__] = {"$ref": f"#/components/messages/{kind.__name__}"}
    channel: dict[str, Any] = {"address": key, "description": about, "messages": messages}
    if placeholder:
        channel["parameters"] = {placeholder: {"description": f"name of the {placeholder}"}}
    return channel


def _operation(action: str, channel: str, kind: Kind, about: str) -> dict[str, Any]:
    message = f"#/channels/{channel}/messages/{kind.__name__}"
    return {
        "action": action,
        "channel": {"$ref": f"#/channels/{channel}"},
        "messages": [{"$ref": message}],
        "summary": about,
    }


def _message(kind: Kind) -> dict[str, Any]:
    name = kind.schema_name()
    return {
        "name": name,
        "summary": first_sentence(kind),
        "payload": {"$ref": f"messages/{name}.json"},
    }
