"""The scene for Foxglove's and Lichtblick's viewer, who look on and cannot control anything."""
