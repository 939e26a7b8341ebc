"""The server's model of the site, for pages that open later."""
