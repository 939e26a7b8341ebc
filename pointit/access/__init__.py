"""Access control of a site: certificate authority, rules, and router configuration. Pure."""
