"""Who may do what on a site: its certificate authority, its rules, the configuration of its router; pure."""
