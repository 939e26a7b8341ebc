"""Connection of a process to a site: addresses, identity, permissions and their options. Loads no Zenoh."""
