"""Commands for authors of plug-ins: a package to start with, and checks of installed plug-ins."""
