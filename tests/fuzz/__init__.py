"""The command line under damaged and hostile input: thousands of inputs, each run in a process apart."""
