"""The pose between localizations."""
