"""Cost of one hop through a genuine ROS 2 node, to compare a hop of ours and the whole chain with.

As a program it runs in the environment `.venv-rclpy`, which the tests of `tests/interop` make, and imports
nothing of ours. `rclpy_relay.py relay` publishes again what it subscribes to until its input closes;
`rclpy_relay.py drive RATE SECONDS` publishes RATE orientations a second, and prints as JSON how many it
sent and how many came back.
"""

import importlib
import json
import os
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path
from typing import Any

PYTHON = Path(__file__).parents[3] / ".venv-rclpy" / "bin" / "python"
THERE = "relayed"
BACK = "returned"
DEPTH = 100
READY_S = 20.0
SETTLE_S = 1.0


def is_available() -> bool:
    """Return True if the environment with rclpy is there."""
    return PYTHON.exists()


def measure_cost(rate_hz: float, duration_s: float) -> dict[str, Any]:
    """Return the CPU time of the relay per message (µs), messages, and how many were lost.

    Raises:
        subprocess.CalledProcessError: rclpy failed.
    """
    import psutil  # noqa: PLC0415 - the environment with rclpy lacks it

    with tempfile.TemporaryDirectory() as folder:
        # A domain of its own: other ROS nodes of this machine must neither hear it nor be heard.
        command = [f"{PYTHON}", __file__]
        domain = 10 + os.getpid() % 90
        graph = {"ROS_DOMAIN_ID": f"{domain}", "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
        environment = os.environ | graph | {"HOME": folder, "ROS_HOME": folder}
        with (
            subprocess.Popen([*command, "relay"], env=environment, stdin=subprocess.PIPE) as relay,
            subprocess.Popen(
                [*command, "drive", f"{rate_hz}", f"{duration_s}"],
                env=environment,
                stdout=subprocess.PIPE,
                text=True,
            ) as drive,
        ):
            # The driver says when it begins, and when it is done: the CPU time is that between both lines.
            output = drive.stdout
            process = psutil.Process(relay.pid)
            try:
                answer = ""
                is_ready = output is not None and output.readline() == "ready\n"
                before = process.cpu_times()
                if output is not None and is_ready:
                    answer = output.readline()
                after = process.cpu_times()
            finally:
                relay.kill()  # on SIGTERM rclpy ends, but not the process
        if drive.returncode or not answer:
            raise subprocess.CalledProcessError(drive.returncode, drive.args)
    counts = json.loads(answer)
    sent = counts["sent"]
    cpu_s = after.user + after.system - before.user - before.system
    us_per_message = round(cpu_s / sent * 1e6, 1)
    lost = sent - counts["returned"]
    return {"us_per_message": us_per_message, "messages": sent, "lost": lost}


def _open_node(name: str) -> tuple[Any, Any]:
    rclpy = importlib.import_module("rclpy")
    rclpy.init()
    message = importlib.import_module("geometry_msgs.msg").QuaternionStamped
    return rclpy.create_node(name), message


def relay() -> None:
    """Publish again what comes, until the standard input closes."""
    rclpy = importlib.import_module("rclpy")
    node, message = _open_node("relay")
    publisher = node.create_publisher(message, BACK, DEPTH)
    node.create_subscription(message, THERE, publisher.publish, DEPTH)
    threading.Thread(target=rclpy.spin, args=(node,), daemon=True).start()
    sys.stdin.read()


def drive(rate_hz: float, duration_s: float) -> None:
    """Publish orientations and print how many were sent and came back."""
    rclpy = importlib.import_module("rclpy")
    node, message = _open_node("driver")
    publisher = node.create_publisher(message, THERE, DEPTH)
    returned: list[Any] = []
    node.create_subscription(message, BACK, returned.append, DEPTH)
    threading.Thread(target=rclpy.spin, args=(node,), daemon=True).start()

    # Nodes need seconds to discover each other. What is published before is lost, and is not counted.
    end_s = time.monotonic() + READY_S
    while not returned and time.monotonic() < end_s:
        publisher.publish(message())
        time.sleep(0.1)
    time.sleep(SETTLE_S)
    returned.clear()
    print("ready", flush=True)
    sent = 0
    due_s = time.monotonic()
    start_s = due_s
    end_s = start_s + duration_s
    while due_s < end_s:
        wait_s = due_s - time.monotonic()
        time.sleep(max(0.0, wait_s))
        publisher.publish(message())
        sent += 1
        due_s = start_s + sent / rate_hz
    time.sleep(SETTLE_S)
    counts = json.dumps({"sent": sent, "returned": len(returned)})
    print(counts, flush=True)
    os._exit(0)  # rclpy's thread spins


if __name__ == "__main__":
    if sys.argv[1] == "relay":
        relay()
    else:
        drive(*map(float, sys.argv[2:]))
