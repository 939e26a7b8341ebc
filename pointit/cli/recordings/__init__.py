"""Commands on recordings of a site."""
