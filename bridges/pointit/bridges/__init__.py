"""Foreign worlds: pages in browsers, viewers; each folder is a process of its own, like a service."""
