"""What a user asks for in one call: sweep, size, sensitivity, compare, fit, diagnose, plan; and the results."""
