"""Diagnosis of a running site from its services' reports. Pure."""
