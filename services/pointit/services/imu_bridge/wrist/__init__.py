"""Treatment of the readings of any device: time, fusion, and the report in health."""
