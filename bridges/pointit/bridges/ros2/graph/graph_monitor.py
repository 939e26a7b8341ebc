"""The last graph of a backend, its watchers and problems."""

import functools
import logging
from collections.abc import Callable, Mapping

from pointit.bridges.ros2.graph.backend import Closable, Graph
from pointit.bridges.ros2.graph.backend_warnings import BackendWarnings
from pointit.bridges.ros2.graph.findings import Finding, Matching, findings

log = logging.getLogger(__name__)

Handler = Callable[[Graph], None]


class GraphMonitor:
    """Begins with an empty graph. In the loop."""

    def __init__(
        self, warnings: BackendWarnings, *, domain: int, distro: str, needs: str, matching: Matching
    ) -> None:
        """Report problems to `warnings`; other parameters as for `findings`."""
        self._warnings = warnings
        self._judged = functools.partial(
            findings, domain=domain, distro=distro, needs=needs, matching=matching
        )
        self._graph = Graph(nodes=frozenset(), endpoints=frozenset())
        self._findings: tuple[Finding, ...] = ()
        self._watches: list[_Watch] = []

    @property
    def notes(self) -> tuple[str, ...]:
        """Return explanations why nothing happens where nothing is wrong: no nodes, no subscribers."""
        return tuple(each.sentence for each in self._findings if each.is_note)

    def watch(self, handler: Handler) -> Closable:
        """Call `handler` with the graph now, and whenever it has changed."""
        handler(self._graph)
        return _Watch(handler, self._watches)

    def show(self, graph: Graph, wrong: Mapping[str, str]) -> None:
        """Set the graph; report its problems, and those in `wrong`."""
        self._findings = self._judged(graph)
        found = {each.about: each.sentence for each in self._findings if not each.is_note}
        self._warnings.replace_all({**found, **wrong})
        if graph == self._graph:
            return
        self._graph = graph
        for watch in tuple(self._watches):
            if watch not in self._watches:  # closed by a previous handler
                continue
            try:
                watch.handler(graph)
            except Exception:
                log.exception("a handler of the ROS graph failed")

    def close(self) -> None:
        """Remove all watchers."""
        self._watches.clear()


class _Watch:
    """A watcher of the graph."""

    def __init__(self, handler: Handler, among: "list[_Watch]") -> None:
        self.handler = handler
        self._among = among
        among.append(self)

    def close(self) -> None:
        """Remove the watcher."""
        if self in self._among:
            self._among.remove(self)
