"""Joining the ROS graph through rclpy: creates our node, without spinning it."""

import os
from dataclasses import dataclass

from pointit.bridges.ros2.config import BackendConfig
from pointit.bridges.ros2.over_rclpy.api import Executor, Node, RosContext
from pointit.bridges.ros2.over_rclpy.library import Rclpy, loaded
from pointit.runtime.errors import ConfigError


@dataclass(frozen=True)
class RclpyNode:
    """rclpy's objects of one node."""

    rclpy: Rclpy
    context: RosContext
    node: Node
    executor: Executor

    def leave(self) -> None:
        """Leave the graph; the node must not be spinning any more."""
        self.node.destroy_node()
        self.context.try_shutdown()


def join(config: BackendConfig) -> RclpyNode:
    """Return our node; blocks for a moment.

    Raises:
        ConfigError: If rclpy is not there, or cannot join.
    """
    rclpy = loaded()
    namespace, _, name = config.node.rpartition("/")
    try:
        context = rclpy.new_context()
        # no arguments: the command line is not ROS's; no log files beside those of PointIt
        context.init([], initialize_logging=False, domain_id=config.domain_id)
        node = rclpy.new_node(
            name,
            namespace=namespace or "/",
            context=context,
            use_global_arguments=False,
            enable_rosout=False,
            start_parameter_services=False,
        )
        executor = rclpy.new_executor(context=context)
        executor.add_node(node)
    except Exception as error:  # any error of rcl, of a middleware or of their shared libraries
        why = str(error).partition("\n")[0][:300] or type(error).__name__
        raise ConfigError(
            f"backend.kind dds: rclpy cannot join the ROS graph as {config.node}, domain {config.domain_id} "
            f"({why}); check that RMW_IMPLEMENTATION={os.environ.get('RMW_IMPLEMENTATION', '')} names an "
            "installed middleware and that `ros2 node list` works in this terminal"
        ) from error
    return RclpyNode(rclpy, context, node, executor)
