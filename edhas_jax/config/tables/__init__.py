"""Tables of measured numbers in the files that data loggers write."""
