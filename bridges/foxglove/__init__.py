"""Read-only bridge: shows the scene in Foxglove and Lichtblick."""
