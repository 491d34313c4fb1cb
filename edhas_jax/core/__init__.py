"""Basics for every package: units, parameter declarations, files, runtime settings, HTML pages and plot colours."""
