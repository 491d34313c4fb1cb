"""What everything else stands on: units, parameter declarations, files, runtime settings, pages and plots."""
