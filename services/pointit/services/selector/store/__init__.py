"""The selector's journal on disk."""
