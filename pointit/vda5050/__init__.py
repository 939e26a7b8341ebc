"""VDA 5050: what automated guided vehicles tell a broker."""
