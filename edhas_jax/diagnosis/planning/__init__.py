"""What runs can reveal, and the next experiment."""
