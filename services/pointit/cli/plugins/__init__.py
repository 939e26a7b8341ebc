"""Commands for authors of plug-ins: a package to begin with, and checks of what is installed."""
