"""The command that serves a site to assistants."""
