"""Parameters from YAML, the environment and options, and messages about invalid ones."""
