"""The typed bus over Zenoh. Only this package and `foreign_zenoh` import `zenoh`."""
