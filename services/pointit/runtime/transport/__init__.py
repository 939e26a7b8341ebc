"""Bytes on Zenoh: sessions, declarations, queries and presence, under the typed bus and foreign sessions."""
