"""Packages that `pointit plugin new` writes. Their Python is ours, so that every gate reads it."""
