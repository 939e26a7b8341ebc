"""Cursors that rest on objects to selections."""
