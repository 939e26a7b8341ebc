"""Experiments with people who point: plan, trials, tidy data. Built on the public API alone."""
