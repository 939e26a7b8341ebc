"""The ROS graph as a backend saw it last: who wants to know it, and what in it will not work."""

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
        self, complaints: BackendWarnings, *, domain: int, distro: str, needs: str, matching: Matching
    ) -> None:
        """Tell `complaints` what will not work; the others are what `findings` takes."""
        self._complaints = complaints
        self._judged = functools.partial(
            findings, domain=domain, distro=distro, needs=needs, matching=matching
        )
        self._graph = Graph(nodes=frozenset(), endpoints=frozenset())
        self._findings: tuple[Finding, ...] = ()
        self._watches: list[_Watch] = []

    @property
    def notes(self) -> tuple[str, ...]:
        """Return why nothing happens where nothing is wrong: nobody is there, nobody subscribes."""
        return tuple(each.sentence for each in self._findings if each.is_note)

    def watch(self, handler: Handler) -> Closable:
        """Call `handler` with the graph now, and whenever it has changed."""
        handler(self._graph)
        return _Watch(handler, self._watches)

    def show(self, graph: Graph, wrong: Mapping[str, str]) -> None:
        """Take the graph as it is now; complain of what will not work in it, and of what else is `wrong`."""
        self._findings = self._judged(graph)
        found = {each.about: each.sentence for each in self._findings if not each.is_note}
        self._complaints.replace_all({**found, **wrong})
        if graph == self._graph:
            return
        self._graph = graph
        for watch in tuple(self._watches):
            if watch not in self._watches:  # a handler before this one has closed it
                continue
            try:
                watch.handler(graph)
            except Exception:
                log.exception("a handler of the ROS graph failed")

    def close(self) -> None:
        """Tell nobody any more."""
        self._watches.clear()


class _Watch:
    """One who wants to know the graph."""

    def __init__(self, handler: Handler, among: "list[_Watch]") -> None:
        self.handler = handler
        self._among = among
        among.append(self)

    def close(self) -> None:
        """Hear no more."""
        if self in self._among:
            self._among.remove(self)
