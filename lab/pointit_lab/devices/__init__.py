"""Devices of PointIt's own plug-ins in software, with which `pointit plugin check` and tests try them."""
