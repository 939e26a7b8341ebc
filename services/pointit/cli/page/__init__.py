"""The page: its options of a run, the dashboard, recordings in it, and the browser."""
