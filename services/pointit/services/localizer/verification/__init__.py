"""Verification of poses before they are taken: rays follow the target, pointings agree."""
