"""Differences between a recording and its replay: messages paired, differences counted and measured."""
