"""Sessions of Zenoh, and the typed bus on them. Only this room, `router` and `foreign_zenoh` import it."""
