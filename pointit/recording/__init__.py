"""Recordings of a site as MCAP files with JSON messages: what stands in them, written and read."""
