"""Packages entering the conveyor."""
