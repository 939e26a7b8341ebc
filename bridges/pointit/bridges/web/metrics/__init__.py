"""Metrics of a site for Prometheus."""
