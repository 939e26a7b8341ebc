"""Zenoh keys of rmw_zenoh for the data of topics and services, and for tokens."""

import re

from pointit.bridges.ros2.graph.backend import RosType

PRESENCE = "@ros2_lv"
"""First chunk of the tokens of nodes and their endpoints."""

EVERY_TOKEN = f"{PRESENCE}/**"

NAME = re.compile(r"(?:/[A-Za-z_][A-Za-z0-9_]*)+")
DDS_TYPE = re.compile(r"(\w+)::(\w+)::dds_::(\w+)_", re.ASCII)
HASH = re.compile(r"\w+", re.ASCII)


def data_key(domain: int, name: str, kind: RosType) -> str:
    """Return the key of topic or service `name` (resolved: `/user1/pointing_ray`) in `domain`.

    Raises:
        ValueError: If `name` is not a resolved ROS name.
    """
    return f"{domain}/{resolved(name)[1:]}/{kind.dds_name}/{kind.hash}"


def resolved(name: str) -> str:
    """Return `name`, of a node, topic or service.

    Raises:
        ValueError: If it is not resolved (`/user1/pointing_ray`); its key would mean something else.
    """
    if not NAME.fullmatch(name):
        raise ValueError(
            f"{name!r} is not a full ROS name: chunks of letters, digits and underscores, each after a slash "
            "and beginning with no digit, such as /user1/pointing_ray"
        )
    return name


def dds_type(text: str, type_hash: str) -> RosType:
    """Return the type that middlewares write as `text` (`std_msgs::msg::dds_::Bool_`).

    Raises:
        ValueError: If it , or the hash, is not written that way.
    """
    found = DDS_TYPE.fullmatch(text)
    if found is None or not HASH.fullmatch(type_hash):
        raise ValueError(f"{text!r} with the hash {type_hash!r} is not a type as DDS writes it")
    return RosType(name="/".join(found.groups()), hash=type_hash)
