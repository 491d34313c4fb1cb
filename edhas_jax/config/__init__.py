"""Configuration files: reading with line numbers, checking, writing, and folders of runs."""
