"""Effects of oil, valves, leakage and lines."""
