"""How a process joins a site: addresses, identity, permissions and their options. It loads no Zenoh."""
