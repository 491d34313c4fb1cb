"""The commands of the program `edhas`, one module each; a command imports what it needs only when it runs."""
