"""A site for assistants: tools and resources of the Model Context Protocol, on the public API."""
