"""Order of what a carrier reports: by its own count, never by a clock that may be set."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pointit.schemas import NS_PER_S, ActResult, ThingState, ThingStates
from pointit.schemas.selection import TargetState
from pointit.services.selector.acts import Acts

LIFE_NS = 1_700_000_000 * NS_PER_S


def states(state: TargetState, stamp_s: float = 1000.0, report: int = 0, life_ns: int = 0) -> ThingStates:
    things = (ThingState(id="lamp", state=state),)
    return ThingStates(stamp_ns=round(stamp_s * NS_PER_S), things=things, report=report, life_ns=life_ns)


def result(state: TargetState, stamp_s: float = 1000.0, report: int = 0, life_ns: int = 0) -> ActResult:
    return ActResult(
        stamp_ns=round(stamp_s * NS_PER_S),
        object_id="lamp",
        event_ns=1,
        result="done",
        state=state,
        report=report,
        life_ns=life_ns,
    )


def home() -> Acts:
    acts = Acts()
    acts.on_presence("home", present=True)
    return acts


def receive(acts: Acts, report: ActResult | ThingStates) -> None:
    if isinstance(report, ActResult):
        acts.on_result("home", report)
    else:
        acts.on_states("home", report)


def known_state(acts: Acts) -> str:
    ((_thing, _carrier, is_on),) = acts.reported()
    return "on" if is_on else "off"


@pytest.mark.parametrize("life_ns", [0, LIFE_NS])
@pytest.mark.parametrize(
    ("set_back_s", "later_s"), [(5.0, 3.0), (12.0, 1.0), (12.0, 3.0), (30.0, 25.0), (0.0, 0.0)]
)
def test_state_counts_when_the_clock_of_its_carrier_was_set_back(
    set_back_s: float, later_s: float, life_ns: int
) -> None:
    acts = home()
    receive(acts, states("off", 1000.0, report=1, life_ns=life_ns))
    receive(acts, states("on", 1000.0 + later_s - set_back_s, report=2, life_ns=life_ns))
    assert known_state(acts) == "on"


@st.composite
def deliveries(draw: st.DrawFn) -> tuple[list[ActResult | ThingStates], TargetState]:
    """Return counted reports as they arrive, and the state of the newest.

    The carrier's clock is set at will. Results keep their order, states keep theirs, and either overtakes.
    """
    count = draw(st.integers(1, 8))
    results: list[ActResult] = []
    listings: list[ThingStates] = [states("off", report=1, life_ns=LIFE_NS)]
    newest: TargetState = "off"
    for number in range(2, count + 2):
        newest = draw(st.sampled_from(["on", "off"]))
        stamp_s = draw(st.floats(900.0, 1100.0))
        if draw(st.booleans()):
            results.append(result(newest, stamp_s, number, LIFE_NS))
        else:
            listings.append(states(newest, stamp_s, number, LIFE_NS))
    arrived: list[ActResult | ThingStates] = [listings.pop(0)]
    while results or listings:
        source = draw(st.sampled_from([each for each in (results, listings) if each]))
        arrived.append(source.pop(0))
    return arrived, newest


@given(deliveries())
def test_newest_report_counts_whichever_arrives_first(
    delivery: tuple[list[ActResult | ThingStates], TargetState],
) -> None:
    arrived, newest = delivery
    acts = home()
    for report in arrived:
        receive(acts, report)
    assert known_state(acts) == newest


def test_late_report_of_a_former_life_does_not_count() -> None:
    acts = home()
    receive(acts, states("on", report=7, life_ns=LIFE_NS))
    receive(acts, states("off", report=1, life_ns=LIFE_NS + 5))
    receive(acts, states("on", report=8, life_ns=LIFE_NS))
    assert known_state(acts) == "off"


def test_result_of_a_carrier_that_does_not_count_overtakes_its_states_by_stamps() -> None:
    acts = home()
    receive(acts, states("off", 1000.0))
    receive(acts, result("on", 1001.0))
    receive(acts, states("off", 1000.5))
    assert known_state(acts) == "on"
