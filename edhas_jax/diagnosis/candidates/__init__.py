"""What a model may lack: effects, faults of sensors, free terms, and deviations of laws from the library's."""
