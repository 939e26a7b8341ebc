"""The page of a run: its service, free ports, URLs and tokens."""
