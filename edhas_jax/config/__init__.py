"""Configuration files: YAML reader with line numbers, checks, writer, JSON schema, recorded signals, run folders."""
