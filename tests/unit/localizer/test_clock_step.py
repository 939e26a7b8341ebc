"""The drift filter follows a time that is set back."""

from pointit.services.localizer.drift.filter import DriftFilter
from tests.unit.localizer.test_drift_filter import LAMPS as PLACES
from tests.unit.localizer.test_drift_filter import MINUTE_NS, PERSON, RATE_RADPS, calibrated, drifted, point

S = 1_000_000_000


def test_every_entry_of_the_filter_follows() -> None:
    now_ns = 20 * S
    late = now_ns - S
    direction = PERSON.direction(PLACES[0])

    def filters() -> DriftFilter:
        return calibrated(PERSON)

    drift = filters()
    refused = point(drift, drifted(PERSON, 3 * MINUTE_NS), PLACES[0], late)
    assert "old" in refused.reason
    drift.set_time(now_ns)
    assert point(drift, drifted(PERSON, 3 * MINUTE_NS), PLACES[0], late).accepted
    drift = filters()
    origin = (0.0, 0.0, 1.64)
    taken = drift.update_anchor(late, PLACES[0], origin, direction, now_ns=now_ns)
    assert "old" not in taken.reason
    assert filters().update_heading(late, 0.0, (1.0, 0.0, 0.0), now_ns=now_ns).accepted
    assert not filters().update_heading(late, 0.0, (1.0, 0.0, 0.0)).accepted
    assert filters().update_rest_rate(late, RATE_RADPS, 0.01, now_ns=now_ns).accepted
    assert not filters().update_rest_rate(late, RATE_RADPS, 0.01).accepted
    drift = filters()
    drift.reset_yaw(now_ns, is_restarted=False)
    assert drift.at(now_ns).stamp_ns == now_ns
