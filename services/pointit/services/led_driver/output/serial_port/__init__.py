"""Output to controllers on a serial port: expanders (UPXL), Adalight."""
