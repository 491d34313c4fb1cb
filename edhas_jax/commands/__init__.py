"""The program `edhas`: one table of its commands, and modules with what runs them, imported only when they run."""
