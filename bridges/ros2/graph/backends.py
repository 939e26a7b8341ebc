"""Joining the ROS graph through the backend that the configuration names.

No core: it joins a network.
"""

import asyncio
import functools
import logging
from collections.abc import Callable
from typing import Literal

from pointit.bridges.ros2.config import BackendConfig
from pointit.bridges.ros2.graph.backend import Backend
from pointit.bridges.ros2.graph.node_backend import BackendWarnings
from pointit.bridges.ros2.over_rclpy.backend import opened_rclpy
from pointit.bridges.ros2.over_zenoh.backend import ZenohBackend
from pointit.bridges.ros2.over_zenoh.rmw_zenoh import BRIDGE, RmwZenoh
from pointit.bridges.ros2.over_zenoh.token import ENCLAVE
from pointit.runtime.address_config import MAX_PORT, is_loopback, parse_address
from pointit.runtime.errors import ConfigError
from pointit.runtime.foreign_zenoh import RawLink, open_raw_session
from pointit.runtime.link.link import ENDPOINT
from pointit.runtime.machine import this_machine
from pointit.runtime.service.plugin_guard import WarningSink

log = logging.getLogger(__name__)

REMEDY = "start one with `ros2 run rmw_zenoh_cpp rmw_zenohd`, or set mode to router to be it"

ANSWER_S = 1.0
"""Time (s) within which a router on this machine accepts a connection."""


def check_endpoint(endpoint: str) -> None:
    """Check that `endpoint` can be an address of ROS's router.

    Raises:
        ConfigError: If it is no address; names the parameter.
    """
    address = ENDPOINT.fullmatch(endpoint)
    port = 0 if address is None else int(address["port"] or 0)
    if address is None or port > MAX_PORT:
        raise ConfigError(
            f"backend.endpoint: {endpoint!r} is no address; write one like tcp/127.0.0.1:7447, where ROS's "
            "router is"
        )


async def opened(
    config: BackendConfig,
    warnings: WarningSink,
    *,
    now_ns: Callable[[], int] | None = None,
    patience_s: float | None = None,
    is_bridge: bool = False,
) -> Backend:
    """Return our node in the ROS graph. May be cancelled at any time.

    Args:
        config: address, name and kind of the graph.
        warnings: shows incompatibilities with other nodes, and their remedies.
        now_ns: clock for messages sent.
        patience_s: timeout of a client for its router, s. None: no timeout, with one log line.
        is_bridge: mark the node as a PointIt bridge, so that other bridges ignore its messages. Only
            `rmw_zenoh` supports that.

    Raises:
        ConfigError: If the endpoint is no address, or for `dds`, rclpy is not installed.
        ListenError: If the router's address is taken.
        ConnectError: If no router answers the client within `patience_s`.
    """
    if config.kind == "dds":
        return await opened_rclpy(config, warnings)

    # Of two bridges with `auto` on one machine the first is the router
    mode = config.mode
    if mode == "auto":
        mode = await _mode_at(config.endpoint)
        if mode == "router":
            log.info("no ROS router answers at %s: this is it now, start no other", config.endpoint)

    # A client may wait for its router, which is then a warning
    waiting = BackendWarnings(warnings)
    on_wait = functools.partial(waiting.show, "router")
    try:
        link = RawLink(endpoint=config.endpoint, mode=mode, remedy=REMEDY)
        session = await open_raw_session(link, patience_s=patience_s, on_wait=on_wait)
    finally:
        waiting.close()

    # The session is ours until the backend has it
    try:
        enclave = BRIDGE if is_bridge else ENCLAVE
        rmw = RmwZenoh(session=session.zid, node=config.node, domain=config.domain_id, enclave=enclave)
        return ZenohBackend(session, rmw, warnings, config, now_ns or this_machine().now_ns)
    except BaseException:
        await session.close()
        raise


async def _mode_at(endpoint: str) -> Literal["peer", "router"]:
    """Return the mode for `auto` at `endpoint`; whatever answers there is assumed to be the router."""
    try:
        host, port = parse_address(endpoint.partition("/")[2])
    except ValueError:  # with Zenoh's options
        return "peer"
    if not is_loopback(host) or port is None:
        return "peer"
    try:
        async with asyncio.timeout(ANSWER_S):
            _, writer = await asyncio.open_connection(host, port)
    except OSError:
        return "router"
    writer.close()
    return "peer"
