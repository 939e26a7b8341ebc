"""Names that are announced, spoken by the loudspeaker of this machine."""
