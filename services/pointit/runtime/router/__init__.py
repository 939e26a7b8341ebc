"""The Zenoh router of a site: its process, its log and its health."""
