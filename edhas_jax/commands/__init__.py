"""The commands of the command line, one module each; what is slow to import waits until it is needed."""
