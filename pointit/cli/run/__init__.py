"""Commands that start something: run, user, dashboard, service, replay."""
