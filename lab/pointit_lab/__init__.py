"""The laboratory: measures PointIt, which never imports it."""
