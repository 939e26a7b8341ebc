"""Wrists and lights that pages find, connect and forget; each is a command of `pointit` in a process."""
