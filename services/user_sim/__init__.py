"""A simulated person: looks, decides, reaches, holds, and wears a wristband."""
