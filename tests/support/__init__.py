"""Builders and benches that tests share; a package of its own, because nothing imports from a conftest."""
