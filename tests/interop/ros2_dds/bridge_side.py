"""Our backend on rclpy in the environment that has one, told by lines of JSON what to do; CDR is hexadecimal.

Each line on standard input is answered by one on standard output.
"""

import asyncio
import json
import sys
import threading
import time
from typing import Any

from pointit.bridges.ros2.config import BackendConfig
from pointit.bridges.ros2.graph.backend import BackendHandle, Graph, Qos, RosType, Writer
from pointit.bridges.ros2.graph.backends import opened
from pointit.bridges.ros2.map_parameters import FetchRequest, fetched
from pointit.bridges.ros2.over_rclpy import backend as rclpy_backend


class Side:
    """One node of ours, what it hears, and what it complains about."""

    def __init__(self) -> None:
        self.now: dict[str, str] = {}
        self.writers: dict[str, Writer] = {}
        self.ends: dict[str, BackendHandle] = {}
        self.heard_on: dict[str, list[str]] = {}
        self.asked: list[str] = []
        self.graph_now: Graph | None = None

    def warn(self, code: str, sentence: str, subject: str = "") -> None:
        self.now[subject or code] = sentence

    def clear(self, code: str, subject: str = "") -> None:
        self.now.pop(subject or code, None)

    async def join(self, node: str, domain: int) -> None:
        config = BackendConfig.model_validate({"kind": "dds", "node": node, "domain_id": domain})
        self.backend = await opened(config, self)
        self.backend.watch(self._look)

    def _look(self, graph: Graph) -> None:
        self.graph_now = graph

    async def advertise(self, order: dict[str, Any]) -> None:
        self.writers[order["topic"]] = self.backend.advertise(order["topic"], _kind(order), _qos(order))

    async def say(self, order: dict[str, Any]) -> None:
        for cdr in order["cdrs"]:
            self.writers[order["topic"]].put(bytes.fromhex(cdr))
            await asyncio.sleep(order.get("apart_s", 0.0))

    async def listen(self, order: dict[str, Any]) -> None:
        heard = self.heard_on[order["topic"]] = []
        self.ends[order["topic"]] = self.backend.subscribe(
            order["topic"], _kind(order), _qos(order), lambda cdr: heard.append(cdr.hex())
        )

    async def heard(self, order: dict[str, Any]) -> Any:
        return self.heard_on[order["topic"]]

    async def serve(self, order: dict[str, Any]) -> None:
        async def answer(request: bytes) -> bytes:
            self.asked.append(request.hex())
            await asyncio.sleep(order.get("after_s", 0.0))
            return bytes.fromhex(order["response"])

        self.ends[order["service"]] = self.backend.serve(order["service"], _kind(order), answer)

    async def requests(self, _order: dict[str, Any]) -> Any:
        return self.asked

    async def call(self, order: dict[str, Any]) -> Any:
        request = bytes.fromhex(order["request"])
        began_s = time.perf_counter()
        response = await self.backend.call(
            order["service"], _kind(order), request, timeout_s=order["timeout_s"]
        )
        return [response.hex(), time.perf_counter() - began_s]

    async def fetch(self, order: dict[str, Any]) -> Any:
        settings = {"kind": "dds", "node": "/pointit_map", "domain_id": int(sys.argv[2])}
        wish = FetchRequest(usual="map", **order)
        return await fetched(BackendConfig.model_validate(settings), wish)

    async def graph(self, _order: dict[str, Any]) -> Any:
        graph = self.graph_now
        assert graph is not None
        ends = [
            [each.kind, each.node, each.name, each.type.name, each.type.hash, each.is_ours]
            for each in graph.endpoints
        ]
        return {"nodes": sorted(graph.nodes), "ends": sorted(ends)}

    async def shown(self, _order: dict[str, Any]) -> Any:
        return self.now

    async def close(self, _order: dict[str, Any]) -> Any:
        await self.backend.close()
        return [each.name for each in threading.enumerate()]


def _kind(order: dict[str, Any]) -> RosType:
    return RosType(name=order["type"], hash=order["hash"])


def _qos(order: dict[str, Any]) -> Qos:
    return Qos(
        depth=order.get("depth", 10),
        reliable=order.get("reliable", True),
        latched=order.get("latched", False),
    )


async def main() -> None:
    rclpy_backend.LOOK_S = 0.1  # so that tests do not wait for seconds
    side = Side()
    await side.join(sys.argv[1], int(sys.argv[2]))
    reader = asyncio.StreamReader(limit=2**24)
    await asyncio.get_running_loop().connect_read_pipe(
        lambda: asyncio.StreamReaderProtocol(reader), sys.stdin
    )
    sys.stdout.write("{}\n")
    sys.stdout.flush()
    while line := await reader.readline():
        order = json.loads(line)
        try:
            answer: dict[str, Any] = {"value": await getattr(side, order.pop("do"))(order)}
        except Exception as error:  # noqa: BLE001 - the caller gets the error
            answer = {"error": f"{type(error).__name__}: {error}"}
        sys.stdout.write(json.dumps(answer) + "\n")
        sys.stdout.flush()


if __name__ == "__main__":
    asyncio.run(main())
