"""Files of LED programs: tables of pixels, WLED's JSON, and strips through pixels."""
