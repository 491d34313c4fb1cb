"""Further laws for development: they show whether a method that was tuned to the tuning laws works with other laws."""
