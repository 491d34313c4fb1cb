"""What the judging cases are made of: laws, small disturbances, sensor chains and benches. Nothing is tuned with it."""
