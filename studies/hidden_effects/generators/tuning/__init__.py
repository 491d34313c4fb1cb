"""What the tuning cases are made of: laws, small disturbances, sensor chains and benches."""
