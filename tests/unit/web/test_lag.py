"""Latency of pages."""

from pointit.bridges.web.pages.open_pages import LATENCIES_S, Latencies


def test_the_quantile_is_one_of_the_values_and_forgets() -> None:
    latencies = Latencies()
    assert latencies.p95_ms(0.0) is None
    for value in range(1, 101):
        latencies.add(float(value), 1.0)
    assert latencies.p95_ms(1.0) == 95.0
    latencies.add(7.0, 2.0)
    assert latencies.p95_ms(1.5 + LATENCIES_S) == 7.0
    assert latencies.p95_ms(3.0 + LATENCIES_S) is None
