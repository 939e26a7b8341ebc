"""Commands of a site's administrator: members and the router."""
