"""The HTTP server: listeners, access, security headers and static files."""
