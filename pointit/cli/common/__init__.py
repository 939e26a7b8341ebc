"""Shared by commands: option types, output, the keyboard, joining a site, names of topics."""
