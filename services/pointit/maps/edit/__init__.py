"""Edits of a map's YAML text that leave everything else as its author wrote it: `document.edited`."""
