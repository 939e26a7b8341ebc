"""A short memory of one person's pointing, and what they mean by a word."""
