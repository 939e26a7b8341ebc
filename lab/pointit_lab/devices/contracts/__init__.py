"""Harnesses of the plug-ins that come with PointIt, declared like those of any package."""
